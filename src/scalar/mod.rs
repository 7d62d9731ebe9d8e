//! Scalar programs: write a pointwise function once, differentiate it, run it anywhere.

mod derivative;
mod evaluate;
mod exp_ln;
mod graph;
mod handle;
mod instruction;
mod kernel;
mod lanes;
mod lower;
mod mat3;
mod operators;
mod portable;
mod program;
mod real;
mod simplify;
mod sin_cos;
#[cfg(test)]
mod tests;
mod trace;
mod vec3;
mod wgsl;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use evaluate::Lanes;
pub use handle::{Condition, Scalar};
pub use mat3::Mat3;
pub use program::Program;
pub use real::Real;
pub use vec3::Vec3;
pub use wgsl::wgsl_module;
