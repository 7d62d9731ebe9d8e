//! The inference by a pool of hypotheses: from a body in flight to the posterior of its material.

mod posterior;
mod reshape;
mod run;
mod rung;

pub(crate) use posterior::{Survey, known};
