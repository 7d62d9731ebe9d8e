//! One evaluation of the static stage: the loss of a radiance field against pixels of the first frame, rendered through
//! its particles.

use std::collections::BTreeMap;

use gradreel::optim::{Bound, Params};
use gradreel::{Result, Tensor, Var};

use super::{Occupancy, RadianceField, Reach, with_variation};
use crate::constant;
use crate::particles::{Jitter, Seeded, Seeding};
use crate::render::{FeatureGrid, FeatureSplat, Pixels, RadianceSettings, Rays, render_radiance, splat_features};

/// Loss weights and rendering of the static stage. A weight of 0 disables its term.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StaticSettings {
    /// Weight of the entropy of the transmittance, which drives each pixel to either object or background.
    pub entropy: f64,
    /// Weight of the volume, which removes particles that no image supports.
    pub volume: f64,
    /// Weight of the total variation of the density, applied to the gradient directly.
    pub variation: f64,
    /// Seeding of the particles.
    pub seeding: Seeding,
    /// Splatting of their features.
    pub splat: FeatureSplat,
    /// Rendering.
    pub radiance: RadianceSettings,
}

impl Default for StaticSettings {
    fn default() -> Self {
        Self {
            entropy: 1e-3,
            volume: 1e-3,
            variation: 0.0,
            seeding: Seeding::default(),
            splat: FeatureSplat::default(),
            radiance: RadianceSettings::default(),
        }
    }
}

/// The result of one evaluation.
#[derive(Debug, Clone)]
pub struct StaticStep {
    /// The weighted sum of the three terms.
    pub loss: Var,
    /// `mean (mask · (rgb − target))²` over rays and channels.
    pub colour: Var,
    /// Mean entropy of the rays' transmittance.
    pub entropy: Var,
    /// `Σ clamp(α, 1e-4, 1e-1) · spacing²/8` over particles.
    pub volume: Var,
    /// The particles.
    pub particles: Seeded,
    /// Their features on the rendered grid.
    pub observed: FeatureGrid,
    /// The rendered pixels.
    pub pixels: Pixels,
}

/// Mean binary entropy `−p ln p − (1 − p) ln(1 − p)` of values in 0…1, clamped to `margin` from 0 and 1.
#[must_use]
pub fn entropy(p: &Var, margin: f64) -> Var {
    let p = p.clamp(margin, 1.0 - margin);
    let q = 1.0 - &p;
    -(&p * &p.ln() + &q * &q.ln()).mean_all()
}

/// Renders rays of the first frame through the particles of a field (grids → particles → `splat_features` → samples)
/// and evaluates the loss.
///
/// `target` holds colours `[rays, 3]` of the object over the background, `mask` the weight of each ray, `[rays]`.
///
/// # Errors
/// When the store holds no field, or the field is empty.
#[expect(clippy::too_many_arguments, reason = "the stage's whole input, named")]
pub fn static_step(
    field: &RadianceField,
    bound: &Bound,
    occupancy: &Occupancy,
    jitter: &Jitter,
    rays: &Rays,
    target: &Tensor,
    mask: &Tensor,
    settings: &StaticSettings,
) -> Result<StaticStep> {
    let values = field.values(bound)?;
    let particles = settings.seeding.seed(occupancy, &values, field.shift, jitter)?;
    let spacing = field.grid.spacing;
    let observed = splat_features(&particles.positions, &particles.features, spacing, &settings.splat)?;
    let absorption = settings.radiance.absorption(spacing, field.base_spacing, field.shift);
    let net = field.colours(bound)?;
    let pixels = render_radiance(&observed.values, &observed.grid, &net, rays, &settings.radiance, &absorption)?;
    let (target, mask) = (constant::tensor(&values, target)?, constant::tensor(&values, mask)?);
    let colour = (mask.reshape([rays.len(), 1]) * (&pixels.rgb - &target)).square().mean_all();
    let entropy = entropy(&pixels.left, 1e-5);
    let volume = particles.opacity.clamp(1e-4, 1e-1).sum_all() * (spacing * spacing / 8.0);
    let loss = &colour + &(&entropy * settings.entropy) + &volume * settings.volume;
    Ok(StaticStep { loss, colour, entropy, volume, particles, observed, pixels })
}

impl StaticStep {
    /// The gradients by path, including that of the total variation.
    ///
    /// # Errors
    /// Propagates errors of the backward pass.
    pub fn gradients(
        &self,
        bound: &Bound,
        params: &Params,
        settings: &StaticSettings,
    ) -> Result<BTreeMap<String, Tensor>> {
        let mut gradients = bound.gradients(&self.loss.backward()?)?;
        if settings.variation > 0.0 {
            let density = params.get("radiance.density")?;
            let weight = settings.variation / density.len() as f64;
            if let Some(gradient) = gradients.get_mut("radiance.density") {
                *gradient = with_variation(gradient, density, weight, Reach::Dense)?;
            }
        }
        Ok(gradients)
    }
}
