//! Scalar programs: write a pointwise function once, differentiate it, run it anywhere.
//!
//! An activation, a loss term, a boundary rule or the law of a material is an ordinary Rust function over [`Scalar`]s,
//! [`Vec3`]s and [`Mat3`]s. [`Program::trace`] calls it *once*, with symbolic inputs, and keeps the operations it
//! performed:
//!
//! ```text
//!  fn(Scalar) ──trace──▶ Program ──vjp, jvp──▶ Program        derivatives are programs too
//!                           ├──run────▶ f32 or f64 over lanes  SIMD chosen at run time, no allocation once warm
//!                           ├──wgsl───▶ text of a function     for the kernels of a GPU
//!                           └──{}─────▶ listing                for people
//! ```
//!
//! ```
//! use gradreel::scalar::{Lanes, Mat3, Program};
//!
//! // The elastic energy density ψ = μ/2 (tr FᵀF − 3) − μ ln J + λ/2 ln² J of a neo-Hookean solid [Pa] …
//! const F: [&str; 9] = ["f00", "f01", "f02", "f10", "f11", "f12", "f20", "f21", "f22"];
//! let (mu, lambda) = (2.0, 3.0);
//! let energy = Program::trace("energy", &F, &["psi"], |x| {
//!     let f = Mat3::from_slice(x);
//!     let log_j = f.det().ln();
//!     vec![0.5 * mu * (f.ddot(f) - 3.0) - mu * log_j + 0.5 * lambda * log_j.square()]
//! });
//!
//! // … whose adjoint with cotangent 1 is the first Piola-Kirchhoff stress. Four particles at rest feel none:
//! let stress = energy.vjp();
//! let inputs: Vec<Lanes<'_, f32>> =
//!     (0..10).map(|n| Lanes::Same(if [0, 4, 8, 9].contains(&n) { 1.0 } else { 0.0 })).collect();
//! let mut p = [[9.0_f32; 4]; 9];
//! stress.run(4, &inputs, &mut p.each_mut().map(|entry| &mut entry[..]));
//! assert_eq!(p, [[0.0; 4]; 9]);
//! ```
//!
//! # What a traced function can and cannot do
//! Loops over fixed counts, calls, matrices and closures all work: they have run by the time tracing ends. What depends
//! on a *value* has to be an operation: a comparison gives a [`Condition`], and [`Condition::select`] takes one of two
//! results, both of which are computed. There is no loop whose length depends on a value.
//!
//! # How it is kept
//! A program is a list of nodes, operands first. Every new node is simplified against the ones before it and looked up
//! among them, so that an expression written twice is computed once; what no output needs is dropped at the end.
//! Derivatives replay the list in a new trace with the rules of `derivative.rs`, written in the same operators. For the
//! CPU the list is lowered to register code (`lower.rs`) that is interpreted over blocks of 256 lanes (`evaluate.rs`),
//! one pass over the block per instruction (`execute.rs`), with the widest vectors the processor has (`lanes.rs`). The cost of
//! interpreting is spread over 256 lanes and vanishes beside the arithmetic.
//!
//! # NaN and infinity
//! They travel as IEEE 754 says; `min` and `max` pass NaN on from either side. Only a product with the constant 0 is
//! simplified to 0.

mod derivative;
mod erf;
mod evaluate;
mod execute;
mod exp_ln;
mod frames;
mod graph;
mod handle;
mod instruction;
mod kernel;
mod lanes;
mod lower;
mod mat3;
#[cfg(target_arch = "aarch64")]
mod neon;
mod operators;
mod path;
mod portable;
mod principal;
mod program;
mod real;
mod simplify;
mod sin_cos;
mod slope;
mod svd;
#[cfg(test)]
mod tests;
mod trace;
mod vec3;
mod wgsl;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use evaluate::Lanes;
pub use handle::{Condition, Scalar};
pub(crate) use kernel::Job;
pub(crate) use lanes::Lane;
pub use mat3::Mat3;
pub use path::Path;
pub use principal::Principal;
pub use program::Program;
pub use real::Real;
pub use vec3::Vec3;
pub use wgsl::wgsl_module;
