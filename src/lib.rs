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
pub use tape::{Backward, Forward, Gradients, Memory, Op, Operands, Profile, ProfileRow, Reads, Tape, Var};
pub use tensor::{DType, Device, Element, Shape, Spec, Tensor};

/// The name of the instruction set that the CPU kernels of this process run with: `scalar`, `avx2`, `avx512` or `neon`.
///
/// It is the widest that the processor has, or the one that the environment variable `GRADREEL_ISA` names; see
/// [`scalar::Path`]. Libraries that the crate calls for small dense systems choose for themselves.
///
/// # Panics
/// When `GRADREEL_ISA` names one that this processor cannot run; [`scalar::Path::of_environment`] returns that as an error.
pub fn isa() -> &'static str {
    scalar::Path::best().name()
}

/// The program in the README runs as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
