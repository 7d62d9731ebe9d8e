//! Searches: Gauss–Newton, which asks for evaluations in batches that run side by side, and L-BFGS on the tape.

mod drive;
mod evaluations;
mod gauss_newton;
pub(super) mod lbfgs;
mod step;

pub(crate) use drive::drive;
pub(crate) use evaluations::{Answer, Evaluations, Request, Setting, Threads};
pub(crate) use gauss_newton::GaussNewton;
#[cfg(test)]
pub(crate) use gauss_newton::Point;
