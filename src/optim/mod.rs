//! Optimisers: they act on a [`Params`] store, or on a plain vector of numbers with its gradient.

mod adam;
mod lbfgs;
mod params;

pub use adam::Adam;
pub use lbfgs::{Lbfgs, LbfgsStep};
pub use params::{Bound, Params};
