//! The WGSL backend: one wgpu adapter, its queue, and kernels over buffers on it.
//!
//! Kernels are WGSL text under `kernels/`, parsed and validated by naga before any driver sees them; bindings,
//! workgroup sizes and constants are read from the validated module ([`Kernel::reflect`]). They keep to WebGPU's
//! guaranteed limits (eight storage buffers, 256 invocations, 16 KiB of workgroup memory). Work is recorded and
//! submitted in batches; only [`crate::Tensor::to_device`] waits for it. Buffers of
//! results return to a pool when their last tensor is dropped.

mod buffer;
mod cast;
mod device;
mod kernel;
mod launch;
mod limits;
mod pool;
mod recorder;
mod sort;
mod source;
mod strides;
mod windows;

pub(crate) use buffer::GpuBuffer;
pub(crate) use cast::{NARROW, WIDEN};
pub use device::Gpu;
pub use kernel::{Binding, Kernel, Reflection};
pub use launch::Work;
pub use limits::GpuLimits;
pub(crate) use sort::{SORT_BLOCKS, SORT_STEPS, SORT_TAILS, sorted_pairs};
pub(crate) use strides::{STRIDED, Strides, words};
