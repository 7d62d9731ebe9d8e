//! The substep on a GPU, forwards and backwards, in `f32`.
//!
//! A substep is a chain of dispatches; nothing is read back between substeps. Particles are sorted by cell, so that
//! both transfers are gathers in a fixed order: a node reads the particles around it, a particle the nodes around it.
//! There are no floating-point atomics, so that a rollout is bitwise reproducible.
//!
//! ```text
//! forwards   count → scan → scan → arrive → settle → material … → grid → advance
//! backwards  count → scan → scan → arrive → settle → material … → lift → grid_vjp → pull → material_vjp …
//! ```
//!
//! The box of the grid follows the particles: each substep marks, with integer atomics, the cells that the next one
//! needs. Failures are marked as well; they stop all later substeps and become an error when the marks are read at the
//! end.

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
