//! What counts in the loss beside squared residuals of real views, with a switch for each.

use gradreel::Result;
use serde::{Deserialize, Serialize};

use crate::identify::RangePenalty;
use crate::identify::config::outside_range;
use crate::physics::materials;
use crate::render::{PixelLoss, ViewWeights, camera_angles};
use crate::video::Clip;

/// What counts in the loss. Where every view of a clip is real, only [`LossConfig::trajectory`] and
/// [`LossConfig::ranges_for_real`] change anything, and both are off.
///
/// ```
/// use gradreel_models::identify::Config;
///
/// let published = "[loss.views]\nalpha = 1.0\n[loss.pixels]\nrobust = true\n[loss.ranges]\nenabled = true";
/// assert_eq!(Config::parse(published)?, Config::default());
/// let plain = "[loss.views]\nalpha = 0.0\n[loss.pixels]\nrobust = false\n[loss.ranges]\nenabled = false";
/// assert_ne!(Config::parse(plain)?, Config::default());
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossConfig {
    /// Weight of the distance between rendered and filmed middles of the object, in square roots of its area, squared; 0 is
    /// off.
    pub trajectory: f64,
    /// Whether implausible parameters cost extra in clips of real views, too.
    pub ranges_for_real: bool,
    /// How imagined views count by their angle to the nearest real one: `alpha = 0` is off.
    pub views: ViewWeights,
    /// How a pixel of an imagined view counts: `robust = false` is off.
    pub pixels: PixelLoss,
    /// What parameters outside of their ranges cost where views are imagined: `enabled = false` is off.
    pub ranges: RangePenalty,
}

impl LossConfig {
    /// What each view of a clip counts, seen from `centre` \[m\]: 1 for a real one, `exp(−α Δθ)` for an imagined one at an angle
    /// `Δθ` \[rad\] to the nearest real one (the primary one, where only one is real). Normalised, they are 1 on average.
    pub fn view_weights(&self, clip: &Clip, centre: [f64; 3]) -> Vec<f64> {
        let count = clip.cameras.len();
        if !clip.imagined.contains(&true) || self.views.alpha == 0.0 {
            return vec![1.0; count];
        }
        let mut nearest = vec![f64::INFINITY; count];
        for real in (0..count).filter(|&view| !clip.imagined[view]) {
            let angles = camera_angles(&clip.cameras, centre, real);
            nearest.iter_mut().zip(angles).for_each(|(least, angle)| *least = least.min(angle));
        }
        (0..count).filter(|&view| !clip.imagined[view]).for_each(|real| nearest[real] = 0.0);
        let mean_is_one = if self.views.normalised { count as f64 } else { 1.0 };
        self.views.of_angles(&nearest).into_iter().map(|weight| weight * mean_is_one).collect()
    }

    /// The residual beyond which a pixel of an imagined view counts linearly, if there are such views and it is to.
    pub fn robust_beyond(&self, imagined: &[bool]) -> Option<f64> {
        (self.pixels.robust && imagined.contains(&true)).then_some(self.pixels.delta)
    }

    /// The penalty of implausible parameters, if it acts.
    pub fn range_penalty(&self, imagined: &[bool]) -> Option<RangePenalty> {
        let acts = self.ranges.enabled && (self.ranges_for_real || imagined.contains(&true));
        acts.then(|| self.ranges.clone())
    }

    /// Whether the values make sense.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::Input`] naming the first that does not.
    pub fn check(&self) -> Result<()> {
        let least = |x: f64| x >= 0.0 && x.is_finite();
        let Self { trajectory, views, pixels, ranges, .. } = self;
        let rules = [
            (least(*trajectory), "loss.trajectory", "0 or a positive number"),
            ((0.0..=100.0).contains(&views.alpha), "loss.views.alpha", "0 to 100 per radian"),
            ((0.0..=1.0).contains(&views.least_primary), "loss.views.least_primary", "0 to 1"),
            (pixels.delta > 0.0 && pixels.delta.is_finite(), "loss.pixels.delta", "a positive number"),
            (least(ranges.inside), "loss.ranges.inside", "0 or a positive number"),
            (least(ranges.outside), "loss.ranges.outside", "0 or a positive number"),
        ];
        let refused = |name: String, wanted: String| Err(outside_range(&name, &wanted));
        if let Some((_, name, wanted)) = rules.into_iter().find(|(holds, ..)| !holds) {
            return refused(name.to_owned(), wanted.to_owned());
        }
        for (name, [low, high]) in &ranges.ranges {
            let place = format!("loss.ranges.ranges.{name:?}");
            let parameter = name.split_once('.').and_then(|(law, parameter)| {
                materials::find(law)?.parameters().iter().find(|p| p.name == parameter).copied()
            });
            let Some(parameter) = parameter else {
                return refused(place, "a law and its parameter, such as \"neo_hookean.young\"".to_owned());
            };
            if !(low < high && [low, high].iter().all(|end| parameter.map.raw(**end).is_finite())) {
                return refused(place, format!("a low and a high value that {} can take", parameter.name));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::video::Camera;

    fn ring(imagined: &[bool]) -> Clip {
        let camera = |id: usize| {
            let angle = std::f64::consts::FRAC_PI_4 * id as f64;
            let c2w = [[1.0, 0.0, 0.0, angle.sin()], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, angle.cos()]];
            Camera { id: id as i64, width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5, c2w }
        };
        Clip {
            name: String::new(),
            root: "".into(),
            cameras: (0..imagined.len()).map(camera).collect(),
            times: vec![],
            frame_numbers: vec![],
            frames: vec![],
            foreground: vec![],
            imagined: imagined.to_vec(),
            assumptions: vec![],
            flight: None,
            around: None,
            story: None,
        }
    }

    #[test]
    fn imagined_views_count_by_their_angle_to_the_nearest_real_one() {
        let step = std::f64::consts::FRAC_PI_4;
        let mut loss = LossConfig::default();
        let weights = |loss: &LossConfig, imagined: &[bool]| loss.view_weights(&ring(imagined), [0.0; 3]);
        assert_eq!(weights(&loss, &[false; 4]), [1.0; 4]);
        loss.views.normalised = false;
        for (imagined, steps) in [
            ([false, true, true, true, true], [0.0, 1.0, 2.0, 3.0, 4.0]),
            ([false, true, true, false, true], [0.0, 1.0, 1.0, 0.0, 1.0]),
        ] {
            let found = weights(&loss, &imagined);
            for (found, steps) in found.iter().zip(steps) {
                approx::assert_relative_eq!(*found, (-steps * step).exp(), max_relative = 1e-12);
            }
        }
        loss.views.normalised = true;
        let found = weights(&loss, &[false, true, true, true]);
        approx::assert_relative_eq!(found.iter().sum::<f64>(), 4.0, max_relative = 1e-12);
        approx::assert_relative_eq!(found[2] / found[0], (-2.0 * step).exp(), max_relative = 1e-12);
        loss.views.alpha = 0.0;
        assert_eq!(weights(&loss, &[false, true, true, true]), [1.0; 4]);
    }

    #[test]
    fn switches() {
        let mut loss = LossConfig::default();
        let (real, mixed) = ([false, false], [false, true]);
        assert!(loss.robust_beyond(&real).is_none() && loss.range_penalty(&real).is_none());
        assert_eq!(loss.robust_beyond(&mixed), Some(0.1));
        assert!(loss.range_penalty(&mixed).is_some());
        loss.ranges_for_real = true;
        assert!(loss.range_penalty(&real).is_some());
        (loss.pixels.robust, loss.ranges.enabled) = (false, false);
        assert!(loss.robust_beyond(&mixed).is_none() && loss.range_penalty(&mixed).is_none());
    }
}
