//! Searches that ask for evaluations in batches: Gauss–Newton, run side by side.

mod drive;
mod evaluations;
mod gauss_newton;
mod step;

pub(crate) use drive::drive;
pub(crate) use evaluations::{Answer, Evaluations, Request, Setting, Threads};
pub(crate) use gauss_newton::GaussNewton;
#[cfg(test)]
pub(crate) use gauss_newton::Point;
