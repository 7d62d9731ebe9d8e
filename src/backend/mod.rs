//! Backends: the CPU, which is the reference and must be fast, and WGSL through wgpu.

pub(crate) mod cpu;
pub mod gpu;
