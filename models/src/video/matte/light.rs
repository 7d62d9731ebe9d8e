//! What the light of a clip does to the hue of shadows.
//!
//! Where an object takes a lamp's light away, a sky's is left, and the shadow is bluer than what surrounds it; where it takes the sky's, redder.
//! In each channel `s a + t (1 − a)` is left, with the share `a` of one light and how much, `s` and `t`, the shadow leaves of either. Shares of
//! channels differ little, so the hue of the log ratio moves along `a` without its mean: how far differs from place to place, the direction
//! does not. It is found from what the pictures of a camera show beside the object. Hue across it speaks for the object far more clearly
//! than hue alone: dark undersides of a body in the floor's colours differ from shadows in that only.

use rayon::prelude::*;

use super::change::{Hue, Tint, evidence};
use super::{Difference, grown};
use crate::video::image::Image;

/// Margin around what may be the object \[pixels of an image of 320\].
const MARGIN: f32 = 4.0;
/// Pixels of an image that are looked at, about.
const SAMPLES: usize = 25_000;
/// Changes of brightness of what is taken for a shadow here.
const SHADOWS: std::ops::Range<f32> = -1.5..-0.1;
/// As many of them show a direction, at least.
const LEAST: usize = 200;
/// How far from the direction hues of shadows are: light that the object reflects tints some of them.
const ACROSS: f32 = 0.02;
/// How often those far from it are weighed anew.
const ROUNDS: usize = 4;

/// The share of shadows that have less of the hue than the most that counts as a shadow's.
const MOST: f32 = 0.98;

/// Evidence at which a pixel is as likely object as not, where nothing is known of the light …
const UNKNOWN: f32 = 0.2;
/// … where it is, at least …
const LEAST_EVEN: f32 = 0.075;
/// … and in shares of that which nine in ten of the pixels beside the object do not reach.
const BESIDE: f32 = 3.0;

/// The light of a camera's pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Light {
    /// The hue of shadows; `None` where too few of them were seen.
    pub tint: Option<Tint>,
    /// Evidence at which a pixel is as likely object as not.
    pub even: f32,
}

impl Default for Light {
    fn default() -> Self {
        Self { tint: None, even: UNKNOWN }
    }
}

impl Light {
    /// The light of the pictures of one camera; pixels of weight 0 say nothing.
    pub fn of(images: &[Image], plate: &Image, weight: &[f32]) -> Self {
        let beside: Vec<(f32, Hue)> =
            images.par_iter().flat_map_iter(|image| beside_the_object(image, plate, weight)).collect();
        let shadows: Vec<(f32, Hue)> = beside.iter().filter(|(b, _)| SHADOWS.contains(b)).copied().collect();
        if shadows.len() < LEAST {
            return Self::default();
        }
        let axis = direction(&shadows);
        let mut shares: Vec<f32> = shadows.iter().map(|(b, [x, y])| (axis[0] * x + axis[1] * y) / -b).collect();
        let tint = Some(Tint { axis, shares: [1.0 - MOST, MOST].map(|share| quantile(&mut shares, share)) });
        let mut evidence: Vec<f32> = beside.iter().map(|&(b, hue)| evidence(b, hue, tint)).collect();
        Self { tint, even: (BESIDE * quantile(&mut evidence, 0.9)).clamp(LEAST_EVEN, UNKNOWN) }
    }
}

/// Brightness and hue of the change of some pixels well away from what is the object by hue alone.
fn beside_the_object(image: &Image, plate: &Image, weight: &[f32]) -> Vec<(f32, Hue)> {
    let difference = Difference::between(image, plate, &Light::default());
    let mask = difference.mask(image, weight);
    let (width, height) = (image.width, image.height);
    let margin = (MARGIN * width.max(height) as f32 / 320.0).ceil() as usize;
    let near = grown(&mask.inside, width, height, margin);
    let stride = (width * height).div_ceil(SAMPLES).max(1);
    let change = &difference.change;
    let beside = (0..width * height).step_by(stride).filter(|&i| !near[i] && weight[i] > 0.0);
    beside.map(|i| (change.brightness[i], change.hue[i])).collect()
}

fn quantile(values: &mut [f32], share: f32) -> f32 {
    let rank = (share * (values.len() - 1) as f32).round() as usize;
    *values.select_nth_unstable_by(rank, f32::total_cmp).1
}

/// The direction along which hues lie, of length 1: the main axis of their second moments, those that are far across counting less.
fn direction(shadows: &[(f32, Hue)]) -> Hue {
    let main = |weight: &dyn Fn(Hue) -> f32| {
        let mut moments = [0.0f64; 3];
        for &(_, [x, y]) in shadows {
            for (sum, value) in moments.iter_mut().zip([x * x, x * y, y * y]) {
                *sum += f64::from(weight([x, y]) * value);
            }
        }
        let angle = 0.5 * (2.0 * moments[1]).atan2(moments[0] - moments[2]);
        [angle.cos() as f32, angle.sin() as f32]
    };
    (0..ROUNDS).fold(main(&|_| 1.0), |[a, b], _| main(&|[x, y]| 1.0 / (1.0 + ((a * y - b * x) / ACROSS).powi(2))))
}
