//! Optimisers: they act on a [`Params`] store, or on a plain vector of numbers with its derivatives.
//!
//! [`Sgd`], [`Adam`] and [`Muon`] are for many parameters, with rates and weight decays by path, a [`Schedule`] and a [`Clip`]; their
//! states go into the same file as the parameters, and training goes on from it bit for bit. [`Lbfgs`] is for a smooth
//! function of up to a few thousand numbers, [`LevenbergMarquardt`] for few numbers and many residuals.

mod adam;
mod bound;
mod clip;
mod ema;
mod lbfgs;
mod levenberg_marquardt;
mod load;
mod muon;
mod params;
mod prefix;
mod schedule;
mod sgd;
mod state;
mod update;

pub use adam::Adam;
pub use bound::{Bound, BoundScope};
pub use clip::Clip;
pub use ema::Ema;
pub use lbfgs::{Lbfgs, LbfgsStep};
pub use levenberg_marquardt::{Fit, LevenbergMarquardt, Residuals, Stop};
pub use load::{Load, TensorSource};
pub use muon::Muon;
pub use params::{Params, Scope};
use prefix::ByPrefix;
pub use schedule::Schedule;
pub use sgd::Sgd;
pub use update::Update;
