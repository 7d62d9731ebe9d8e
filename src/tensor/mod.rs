//! Tensors: contiguous, row-major arrays whose dtype and device are known at run time.
//!
//! A [`Tensor`] is a [`Shape`], a [`DType`] and shared storage; cloning it copies a pointer. Nothing changes a tensor after
//! it was made, so that a tape can keep its inputs without copying them. Reshaping is free; everything else makes a new one.
//! The dtype is dynamic, so that the same model runs in `f32` in production and in `f64` under a gradient check.

mod array;
mod convert;
mod debug;
mod device;
mod dtype;
mod shape;
mod storage;

pub use array::Tensor;
pub use device::Device;
pub(crate) use dtype::for_real;
pub use dtype::{DType, Element};
pub use shape::{Shape, Spec};
pub(crate) use storage::Role;
