//! The shutter of a camera.

use serde::{Deserialize, Serialize};

/// How long a picture is exposed, and how its rows follow each other.
///
/// A pixel in row `r` of `R` is the mean of what is there from `t − e/2` to `t + e/2`, with `t` the time of the frame plus
/// `(r − R/2) τ`, the exposure `e` and the time `τ` from one row to the next. Zero of either is a shutter without it.
///
/// ```
/// use gradreel_models::video::Shutter;
///
/// assert!(!Shutter::default().is_open());
/// assert!(Shutter { exposure: 1.0 / 60.0, row_time: 0.0 }.is_open());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Shutter {
    /// Exposure \[s\].
    pub exposure: f64,
    /// Time from one row of the film to the next \[s\]; negative where it is read from below.
    pub row_time: f64,
}

impl Shutter {
    /// Whether anything that moves is seen otherwise than at one instant.
    pub fn is_open(self) -> bool {
        self != Self::default()
    }
}
