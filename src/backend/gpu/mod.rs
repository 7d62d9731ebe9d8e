//! The WGSL backend: one wgpu adapter, its queue, and buffers on it.
//!
//! Kernels are WGSL text under `kernels/`, validated by naga; they keep to WebGPU's guaranteed limits (eight storage buffers,
//! 256 invocations, 128 MiB a binding). Work is submitted without waiting; only [`GpuBuffer::read`] waits.

mod buffer;
mod device;

pub use buffer::GpuBuffer;
pub use device::Gpu;
