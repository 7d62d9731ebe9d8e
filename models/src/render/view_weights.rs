//! The view-adaptive loss: weights of views by their angle to the real one.

use gradreel::{Key, Result, Var};

use crate::constant;
use crate::vector::{cross, dot, minus};
use crate::video::Camera;

/// Weights of views: `w_i = exp(−α Δθ_i)` with the angle `Δθ_i` \[rad\] between the directions from the object to view
/// `i` and to the primary view.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ViewWeights {
    /// Decay per radian. 1 gives the opposite view a relative weight of `e^−π ≈ 0.04`; 0 disables the weighting, which
    /// suits real views from all sides.
    pub alpha: f64,
    /// Whether the weights are divided by their sum, so that the balance with other terms of a loss does not depend on
    /// `alpha`; otherwise the primary view has weight 1.
    #[serde(skip)]
    pub normalised: bool,
    /// Minimum probability of the primary view where one view is drawn at a time.
    #[serde(skip)]
    pub least_primary: f64,
}

impl Default for ViewWeights {
    fn default() -> Self {
        Self { alpha: 1.0, normalised: true, least_primary: 0.25 }
    }
}

/// Angles \[rad\] between each direction and that of the primary view.
///
/// # Panics
/// When `primary` is out of range.
#[track_caller]
pub fn view_angles(directions: &[[f64; 3]], primary: usize) -> Vec<f64> {
    let first = directions[primary];
    // unlike the arc cosine, accurate for small angles as well
    let angle = |d: &[f64; 3]| {
        let across = cross(*d, first);
        dot(across, across).sqrt().atan2(dot(*d, first))
    };
    directions.iter().map(angle).collect()
}

/// Angles of cameras as seen from a point \[m\], relative to the primary camera.
///
/// # Panics
/// When `primary` is out of range.
#[track_caller]
pub fn camera_angles(cameras: &[Camera], centre: [f64; 3], primary: usize) -> Vec<f64> {
    let directions: Vec<_> = cameras.iter().map(|camera| minus(camera.centre(), centre)).collect();
    view_angles(&directions, primary)
}

impl ViewWeights {
    /// Weights of views at these angles \[rad\].
    pub fn of_angles(&self, angles: &[f64]) -> Vec<f64> {
        let weights: Vec<f64> = angles.iter().map(|angle| (-self.alpha * angle).exp()).collect();
        let sum: f64 = if self.normalised { weights.iter().sum() } else { 1.0 };
        weights.iter().map(|weight| weight / sum).collect()
    }

    /// Weights of views in these directions from the object.
    ///
    /// # Panics
    /// When `primary` is out of range.
    #[track_caller]
    pub fn of_directions(&self, directions: &[[f64; 3]], primary: usize) -> Vec<f64> {
        self.of_angles(&view_angles(directions, primary))
    }

    /// Weights of cameras as seen from a point \[m\].
    ///
    /// # Panics
    /// When `primary` is out of range.
    #[track_caller]
    pub fn of_cameras(&self, cameras: &[Camera], centre: [f64; 3], primary: usize) -> Vec<f64> {
        self.of_angles(&camera_angles(cameras, centre, primary))
    }

    /// `Σ w_i L_i` over the losses `[views]` of all views.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    pub fn total(&self, losses: &Var, angles: &[f64]) -> Result<Var> {
        let weights = constant::numbers(losses, self.of_angles(angles), [angles.len()])?;
        Ok((losses * &weights).sum_all())
    }

    /// Draws views with probabilities proportional to their weights, the primary one with at least
    /// [`ViewWeights::least_primary`]. Unless that bound is active, the unweighted loss of views drawn like this has
    /// the weighted sum as its expectation.
    ///
    /// # Panics
    /// When `primary` is out of range.
    pub fn draw(&self, angles: &[f64], primary: usize, key: Key, count: usize) -> Vec<usize> {
        let mut chances = Self { normalised: true, ..self.clone() }.of_angles(angles);
        if self.alpha > 0.0 && chances[primary] < self.least_primary {
            let rest = (1.0 - self.least_primary) / (1.0 - chances[primary]);
            chances.iter_mut().for_each(|chance| *chance *= rest);
            chances[primary] = self.least_primary;
        }
        let pick = |u: f64| {
            let mut below = 0.0;
            let beyond = |chance: &f64| {
                below += chance;
                u < below
            };
            chances.iter().position(beyond).unwrap_or(primary)
        };
        key.uniform(count).map(pick).collect()
    }
}
