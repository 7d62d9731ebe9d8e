//! Effect of a clip's illumination on the hue of shadows.
//!
//! Where an object blocks a lamp, skylight remains and the shadow is bluer than its surroundings; where it blocks
//! the sky, the shadow is redder. Each channel keeps `s a + t (1 − a)`, where `a` is the share of the first light,
//! and `s` and `t` are the shares of either light that the shadow leaves. As `a` differs little between channels,
//! the log ratio minus its mean moves along one direction for all shadows; only the distance varies from place to
//! place. This direction is estimated from the pixels around the object. Hue perpendicular to it is much stronger
//! evidence for the object than hue alone: dark undersides of an object in the floor's colours differ from shadows
//! in this component only.

use rayon::prelude::*;

use super::change::{Hue, Tint, evidence};
use super::{Difference, grown};
use crate::video::image::Image;

/// Margin around the candidate object region \[pixels in an image of 320\].
const MARGIN: f32 = 4.0;
/// Approximate number of sampled pixels per image.
const SAMPLES: usize = 25_000;
/// Changes of brightness that count as shadow in this estimate.
const SHADOWS: std::ops::Range<f32> = -1.5..-0.1;
/// Minimum number of shadow samples needed to estimate the direction.
const LEAST: usize = 200;
/// Expected scatter of shadow hues around the axis; light reflected by the object tints some of them.
const ACROSS: f32 = 0.02;
/// Number of reweighting rounds that suppress outliers.
const ROUNDS: usize = 4;

/// Quantile of the shadows' hue that bounds what counts as a shadow.
const MOST: f32 = 0.98;

/// Evidence at which object and background are equally likely, if the illumination is unknown …
const UNKNOWN: f32 = 0.2;
/// … the minimum if it is known …
const LEAST_EVEN: f32 = 0.075;
/// … and the factor applied to the 90 % quantile of the evidence around the object.
const BESIDE: f32 = 3.0;

/// The illumination in a camera's images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Light {
    /// The hue of shadows; `None` if too few were seen.
    pub tint: Option<Tint>,
    /// Evidence at which object and background are equally likely.
    pub even: f32,
}

impl Default for Light {
    fn default() -> Self {
        Self { tint: None, even: UNKNOWN }
    }
}

impl Light {
    /// Estimates the illumination in the images of one camera; pixels of weight 0 are ignored.
    pub fn of(images: &[Image], plate: &Image, weight: &[f32]) -> Self {
        Self::of_samples(images.par_iter().flat_map_iter(|image| beside_the_object(image, plate, weight)).collect())
    }

    /// The same from images with a plate each.
    pub fn of_pairs(pairs: &[(Image, Image)]) -> Self {
        let beside = |(image, plate): &(Image, Image)| beside_the_object(image, plate, &vec![1.0; plate.pixels.len()]);
        Self::of_samples(pairs.par_iter().flat_map_iter(beside).collect())
    }

    fn of_samples(beside: Vec<(f32, Hue)>) -> Self {
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

/// Change of brightness and hue of sampled pixels well away from the object (as segmented by hue alone).
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

/// Unit vector along which the hues lie: the principal axis of their second moments, with outliers downweighted.
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
