//! Compositing of samples along rays.

use gradreel::{Result, Var};

use super::samples::{Absorption, Visible};
use crate::constant;

/// The pixels of a rendered radiance field.
#[derive(Debug, Clone)]
pub struct Pixels {
    /// Colour over the background, `[rays, 3]`.
    pub rgb: Var,
    /// `Σ w k`, the depth in steps from the entry of the ray into the box, `[rays]`; for display.
    pub depth: Var,
    /// Transmittance: the visible share of the background, `[rays]`.
    pub left: Var,
    /// Weights of the visible samples, `[seen]`.
    pub weights: Var,
    /// Their colours, `[seen, 3]`.
    pub colours: Var,
}

impl Visible {
    /// Selects the rows of visible samples from those of all samples.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    pub fn rows_seen(&self, rows: &Var) -> Result<Var> {
        if self.seen.len() == self.samples.len() {
            return Ok(rows.clone());
        }
        rows.index_select(&constant::indices(rows, self.seen.clone())?)
    }

    /// Composites front to back, from raw densities `[samples]` and the colours `[seen, 3]` of the visible samples:
    /// `w_k = α_k Π_{j<k} (1 − α_j)`, colour `Σ w c + left · background`.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    pub fn composite(&self, density: &Var, colours: &Var, absorption: &Absorption, background: f64) -> Result<Pixels> {
        let samples = &self.samples;
        let rays = samples.offsets.len() - 1;
        let offsets = constant::indices(density, samples.offsets.clone())?;
        let alpha = density.density_to_alpha(absorption.shift, absorption.interval);
        let left = alpha.ray_transmittance(&offsets, None)?;
        let weights = self.rows_seen(&alpha.ray_weights(&offsets, None)?)?;
        let seen = constant::indices(density, self.seen_offsets())?;
        let column = weights.reshape([weights.len(), 1]);
        let number = |i: &u32| f64::from(samples.numbers[*i as usize]);
        let numbers = constant::numbers(density, self.seen.iter().map(number).collect(), [self.seen.len()])?;
        let depth = (&weights.detach() * &numbers).segment_sum(&seen)?;
        let rgb = (&column * colours).segment_sum(&seen)? + left.reshape([rays, 1]) * background;
        Ok(Pixels { rgb, depth, left, weights, colours: colours.clone() })
    }
}
