//! The loss of the temporal fit.

use gradreel::{Result, Tensor, Var};

use super::render::TemporalPixels;
use crate::constant;
use crate::field::entropy;
use crate::render::{PixelLoss, huber};

/// Weights of the terms; 0 disables a term.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TemporalWeights {
    /// Weight of the entropy of the transmittance.
    pub entropy: f64,
    /// Weight of the colour loss of single samples, each against its pixel.
    pub samples: f64,
    /// Weight of the mean length of offsets at opaque samples \[1/m\].
    pub offsets: f64,
    /// The pixel loss.
    pub pixels: PixelLoss,
}

impl Default for TemporalWeights {
    fn default() -> Self {
        Self { entropy: 1e-3, samples: 1e-2, offsets: 1e-3, pixels: PixelLoss::default() }
    }
}

/// Targets of rays.
#[derive(Debug, Clone)]
pub struct RayTargets {
    /// Colours over the background, `[rays, 3]`.
    pub colours: Tensor,
    /// Weight of each ray, `[rays]`, 1 on average.
    pub weight: Tensor,
    /// Flags of rays of imagined views, `[rays]` of 0 and 1; `None` if there is no such view.
    pub imagined: Option<Tensor>,
}

/// The terms of the loss.
pub struct TemporalLoss {
    /// Their weighted sum.
    pub total: Var,
    /// Mean over rays and channels of the weighted pixel loss; the mean square for real views of equal weight.
    pub pixels: Var,
    /// Mean entropy of the transmittance.
    pub entropy: Var,
    /// `Σ_samples w̄ ‖c − target‖² / rays`, with weights `w̄` detached.
    pub samples: Var,
}

/// Opacity above which the offset of a sample is penalised.
const OPAQUE: f64 = 0.01;

impl TemporalPixels {
    /// The loss of the rendered pixels against their targets.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    pub fn loss(&self, targets: &RayTargets, weights: &TemporalWeights) -> Result<TemporalLoss> {
        let rgb = &self.pixels.rgb;
        let rays = rgb.dims()[0];
        let target = constant::tensor(rgb, &targets.colours)?;
        let residual = rgb - &target;
        let mut each = residual.square();
        if let (true, Some(imagined)) = (weights.pixels.robust, &targets.imagined) {
            let imagined = constant::tensor(rgb, imagined)?.reshape([rays, 1]);
            each = imagined.choose(&huber(&residual, weights.pixels.delta), &each);
        }
        let counts = constant::tensor(rgb, &targets.weight)?.reshape([rays, 1]);
        let pixels = (each * counts).mean_all();
        let entropy = entropy(&self.pixels.left, 1e-6);
        let seen = constant::indices(rgb, self.ray_of_seen.clone())?;
        let wanted = target.index_select(&seen)?;
        let apart = (&self.pixels.colours - &wanted).square().sum(&[1]);
        let samples = (&self.pixels.weights.detach() * &apart).sum_all() / rays as f64;
        let mut total = &pixels + &(&entropy * weights.entropy) + &samples * weights.samples;
        if weights.offsets > 0.0 && self.moves {
            let opaque = self.opacity.gt(&constant::numbers(&self.opacity, vec![OPAQUE], [1])?);
            let count = opaque.sum_all().item()?.max(1.0);
            let lengths = ((&self.samples.bent - &self.points).square().sum(&[1]) + 1e-12).sqrt();
            total = total + (&lengths * &opaque).sum_all() * (weights.offsets / count);
        }
        Ok(TemporalLoss { total, pixels, entropy, samples })
    }
}
