//! Backends: the CPU, which is the reference and must be fast, and WGSL through wgpu.

pub mod cpu;
pub mod gpu;
