//! Consistency of single images with the field fitted to all of them.

use gradreel::optim::Params;
use gradreel::{Key, Result, Tape};

use super::batch::ClipRays;
use super::render::TemporalField;

/// Residual of each image against the field.
#[derive(Debug, Clone, PartialEq)]
pub struct Agreement {
    /// Mean squared residual of each image, `[camera][frame]`.
    pub residuals: Vec<Vec<f64>>,
}

impl TemporalField {
    /// Compares `count` rays of every image (all of them if it has no more) with the field.
    ///
    /// # Errors
    /// When the store holds no such field.
    pub fn agreement(&self, params: &Params, rays: &ClipRays<'_>, count: usize, key: Key) -> Result<Agreement> {
        let dtype = params.get("temporal.feature")?.dtype();
        let mut still = params.clone();
        still.freeze("temporal")?;
        let picture = |camera: usize, frame: usize| -> Result<f64> {
            let key = key.fold(camera as u64).fold(frame as u64);
            let batch = rays.draw_from(camera, frame, key, count, dtype)?;
            let tape = Tape::new();
            let seen = self.render(&still.bind(&tape), &batch.rays, &batch.moment_of, &rays.times)?;
            let (found, wanted) = (seen.pixels.rgb.value()?.to_vec()?, batch.targets.colours.to_vec()?);
            let weight = batch.targets.weight.to_vec()?;
            let squares = found.iter().zip(&wanted).map(|(a, b)| (a - b).powi(2));
            let sum: f64 = squares.enumerate().map(|(i, square)| weight[i / 3] * square).sum();
            Ok(sum / (3.0 * weight.iter().sum::<f64>()).max(1.0))
        };
        let camera = |camera: usize| (0..rays.times.len()).map(|frame| picture(camera, frame)).collect();
        Ok(Agreement { residuals: (0..rays.cameras()).map(camera).collect::<Result<_>>()? })
    }
}

impl Agreement {
    /// Whether each image's residual is at most `factor` times the median. A factor of 2 rejects imagined images that
    /// contradict the others; an infinite one keeps all.
    pub fn within(&self, factor: f64) -> Vec<Vec<bool>> {
        let mut all: Vec<f64> = self.residuals.concat();
        all.sort_by(f64::total_cmp);
        let median = all.get(all.len() / 2).copied().unwrap_or(0.0);
        self.residuals.iter().map(|row| row.iter().map(|r| *r <= factor * median).collect()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_that_contradicts_the_others_is_left_out() {
        let agreement = Agreement { residuals: vec![vec![1e-3, 1.2e-3], vec![0.9e-3, 5e-3], vec![1.1e-3, 1e-3]] };
        assert_eq!(agreement.within(2.0), [[true, true], [true, false], [true, true]]);
        assert!(agreement.within(f64::INFINITY).concat().iter().all(|agrees| *agrees));
    }
}
