//! The substep on a GPU, forwards and backwards, in `f32`.
//!
//! A substep is a chain of dispatches; nothing is read back between substeps. Particles are sorted by cell, so that both
//! transfers are gathers: a node reads the particles around it, a particle the nodes around it, each in a fixed order. No
//! floating-point number is added atomically, and the same rollout gives the same bits.
//!
//! ```text
//! forwards   count → scan → scan → arrive → settle → material … → grid → advance
//! backwards  count → scan → scan → arrive → settle → material … → lift → grid_vjp → pull → material_vjp …
//! ```
//!
//! The box of the grid follows the particles: a substep marks, with integer atomics, which cells the next one needs. What is
//! wrong is marked, too, stops all later substeps, and becomes an error when the marks are read at the end.

mod buffers;
mod kernels;
mod law;
mod marks;
mod obstacles;
mod portion;
mod simulation;
mod trajectory;
mod words;

pub(crate) use law::LawKernels;
pub use simulation::GpuSimulation;
pub(crate) use trajectory::Kept;
