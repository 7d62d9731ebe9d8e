//! gradreel: a differentiable core for going from the pixels of a video to the material of the thing filmed.

mod error;
pub mod scalar;

pub use error::{Error, ErrorKind, Result};
