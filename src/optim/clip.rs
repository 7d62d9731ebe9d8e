//! Gradient clipping, done within an optimiser's update.

use crate::optim::update::Clipped;
use crate::scalar::Real;
use crate::{Error, ErrorKind, Result};

/// How an optimiser limits gradients that are finite but large. A gradient that is not finite is an error, always.
///
/// ```
/// use gradreel::optim::{Adam, Clip};
/// let adam = Adam::new(1e-3).with_clip(Clip::Norm(1.0));
/// # let _ = adam;
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Clip {
    /// Not at all.
    #[default]
    None,
    /// All gradients are scaled by one factor so that their common norm is at most this (Pascanu et al. 2013).
    Norm(f64),
    /// Every element is limited to this absolute value.
    Value(f64),
}

impl Clip {
    pub(super) fn check(self) -> Result<()> {
        match self {
            Self::Norm(limit) | Self::Value(limit) if limit.is_nan() || limit <= 0.0 => {
                Err(Error::new(ErrorKind::Input, "gradients are clipped to a positive number")
                    .found(format!("{self:?}")))
            }
            _ => Ok(()),
        }
    }

    /// What to do with each element, given the norm of all.
    pub(super) fn for_norm<T: Real>(self, norm: f64) -> Clipped<T> {
        let (factor, limit) = match self {
            Self::Norm(limit) if norm > limit => (limit / norm, f64::INFINITY),
            Self::Value(limit) => (1.0, limit),
            _ => (1.0, f64::INFINITY),
        };
        Clipped { factor: T::from_f64(factor), limit: T::from_f64(limit) }
    }
}
