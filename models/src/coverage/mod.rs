//! Coverage: how far the estimates of many small random clips are off, and how often their intervals hold the truth.
//!
//! A clip is drawn from a [`Split`] and a number: a procedural body in a random attitude, a material from the priors of its
//! law, a velocity, and cameras ([`Recipe`]). It is simulated on another grid and with another step than those of the fit,
//! and filmed by rays against a surface, which is not how the fit renders. Then it is fitted with the default settings
//! ([`fit`]) and scored against its truth ([`Score`], [`Summary`]).
//!
//! The truth is drawn from the priors that the fit assumes. So an interval of 90 % of a correct posterior holds it in 90 % of
//! the clips, and no estimate can have a higher mean log density than that posterior.

mod calibrate;
mod draw;
mod film;
mod fit;
mod histogram;
mod material;
mod mesh;
mod motion;
mod score;
mod summary;

pub(crate) use calibrate::{Calibrated, calibrate};
pub use draw::{Recipe, Split};
pub use film::write;
pub use fit::{Line, fit};
pub use histogram::ranks;
pub use motion::simulate;
pub use score::Score;
pub use summary::Summary;
