//! gradreel: a differentiable core for going from the pixels of a video to the material of the thing filmed.

pub mod backend;
mod error;
pub mod io;
pub mod ops;
pub mod optim;
mod random;
pub mod scalar;
pub mod tape;
pub mod tensor;

pub use error::{Error, ErrorKind, Result};
pub use random::Key;
pub use tape::devicecheck::{DeviceReport, DeviceRow, devicecheck};
pub use tape::gradcheck::{GradCheck, GradReport, gradcheck};
pub use tape::{Backward, Forward, Gradients, Memory, Op, Profile, ProfileRow, Reads, Tape, Var};
pub use tensor::{DType, Device, Element, Shape, Spec, Tensor};

/// The program in the README runs as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
