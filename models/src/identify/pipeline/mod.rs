//! The stages in order: the body in flight, the pool of hypotheses, the shape in motion, the posterior.

pub(super) mod bounces;
pub(super) mod context;
mod posterior;
pub(super) mod reconstruct;
mod reshape;
mod run;
mod rung;
mod sharpness;
mod shutter;
pub(super) mod stage;
pub(super) mod temporal_start;
mod velocity;

pub(crate) use posterior::{Survey, known};
