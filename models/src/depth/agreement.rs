//! Agreement of predictions with the truth on many pictures, and a sheet to look at.

use std::sync::Arc;

use gradreel::{Key, Result};
use rayon::prelude::*;

use super::camera::Attitude;
use super::measure::{Layered, Plane, Seen, TILTED_DEG, mean, rms_error};
use super::picture::{PIXELS, SIZE};
use super::pose::Pose;
use super::sample::{Kind, Sample};
use super::{DepthNetwork, Solid};
use crate::report::animation::Picture;

/// A picture of one of some solids.
pub(crate) struct View {
    /// Number of the solid.
    pub solid: usize,
    pub sample: Sample,
}

/// Two pictures of each solid as it is: upright, and in any attitude; `most` at most, of solids spread over all.
pub(crate) fn two_views(solids: &[Arc<Solid>], key: Key, most: usize) -> Vec<View> {
    let count = most.div_ceil(2).min(solids.len());
    let views: Vec<Vec<View>> = (0..count)
        .into_par_iter()
        .map(|turn| {
            let number = turn * solids.len() / count;
            let key = key.fold(number as u64);
            let draw = |(fold, attitude)| {
                Some(View {
                    solid: number,
                    sample: Sample::draw(&solids[number], key.fold(fold), Kind::Exact(attitude))?,
                })
            };
            [(0, Attitude::Upright), (1, Attitude::Free)].into_iter().filter_map(draw).collect()
        })
        .collect();
    views.into_iter().flatten().take(most).collect()
}

/// Means over pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Agreement {
    /// IoU along rays, and that of the body that is as deep as wide.
    pub overlap: f64,
    pub flat: f64,
    /// Errors of front and back up to a shift, rms \[D\].
    pub front: f64,
    pub back: f64,
    /// Share of the true tilts above 20° whose prediction tilts to the other side.
    pub wrong_sign: f64,
}

/// The body that is as deep as wide has this factor in a validation.
const FACTOR: f64 = 1.0;

/// The agreement of a network on samples.
///
/// # Errors
/// If the network cannot be evaluated.
pub(crate) fn agreement(network: &DepthNetwork, samples: &[Sample]) -> Result<Agreement> {
    let features: Vec<&[f32]> = samples.iter().map(|sample| &*sample.features).collect();
    let found = network.layers(&features, &Pose::MIRRORED)?;
    let rows: Vec<[f64; 4]> = samples
        .iter()
        .zip(&found)
        .map(|(sample, layers)| {
            let seen = Seen::of(sample);
            let body = Layered { front: seen.picked(&layers[0]), back: seen.picked(&layers[1]) };
            let flat = seen.overlap(&seen.as_deep_as_wide(FACTOR, None));
            let truth = &seen.truth;
            [seen.overlap(&body), flat, rms_error(&body.front, &truth.front), rms_error(&body.back, &truth.back)]
        })
        .collect();
    let signs = samples.iter().zip(&found).filter_map(|(sample, layers)| {
        let seen = Seen::of(sample);
        let body = Layered { front: seen.picked(&layers[0]), back: seen.picked(&layers[1]) };
        wrong_sign(&seen.plane(&seen.truth), &seen.plane(&body))
    });
    let wrong_sign = mean(signs);
    let of = |k: usize| mean(rows.iter().map(|row| row[k]));
    Ok(Agreement { overlap: of(0), flat: of(1), front: of(2), back: of(3), wrong_sign })
}

/// 1 for a plane that tilts to the other side than the true one, 0 to the same; `None` for small tilts.
pub(crate) fn wrong_sign(truth: &Plane, found: &Plane) -> Option<f64> {
    (truth.tilt_deg() > TILTED_DEG).then(|| f64::from(u8::from(!found.same_side(truth))))
}

/// Depth range of the grey levels \[D\].
const GREY: f32 = 0.8;

/// Rows of pictures: colours as the network sees them, true front and back, predicted front and back.
///
/// # Errors
/// If the network cannot be evaluated.
pub(crate) fn preview(network: &DepthNetwork, samples: &[&Sample]) -> Result<Picture> {
    let features: Vec<&[f32]> = samples.iter().map(|sample| &*sample.features).collect();
    let found = network.layers(&features, &Pose::MIRRORED)?;
    let byte = |x: f32| (255.0 * x.clamp(0.0, 1.0)) as u8;
    let mut shown = Vec::new();
    for (sample, layers) in samples.iter().zip(&found) {
        let inside = |pixel: usize| sample.weights[pixel] > 0.0;
        let picture = |colour: &dyn Fn(usize) -> [u8; 3]| Picture {
            width: SIZE,
            height: SIZE,
            rgb: (0..PIXELS).flat_map(|pixel| if inside(pixel) { colour(pixel) } else { [255; 3] }).collect(),
        };
        let grey = |plane: &[f32], pixel: usize| [byte(0.5 - 0.5 * plane[pixel] / GREY); 3];
        shown.push(picture(&|pixel| [0, 1, 2].map(|k| byte(0.5 + 0.2 * sample.features[k * PIXELS + pixel]))));
        for plane in [&sample.depths[0], &sample.depths[1], &layers[0], &layers[1]] {
            shown.push(picture(&|pixel| grey(plane, pixel)));
        }
    }
    Ok(Picture::grid(10, &shown))
}
