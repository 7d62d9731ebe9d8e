//! Rendering of a radiance field on a grid.

use gradreel::{Result, Var};

use super::composite::Pixels;
use super::rays::Rays;
use super::samples::{Absorption, Sampling, Visible};
use crate::constant;
use crate::field::{ColourNet, DenseGrid, channel};

/// Settings of the rendering.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RadianceSettings {
    /// Positions of the samples.
    pub sampling: Sampling,
    /// Coarsest spacing in the length unit of the raw density.
    pub length: f64,
    /// Opacities and weights up to this value are dropped.
    pub threshold: f64,
    /// A ray ends after the sample at which the transmittance falls below this value.
    pub stop: f64,
    /// Grey value of the background; 1 is white.
    pub background: f64,
}

impl Default for RadianceSettings {
    fn default() -> Self {
        Self { sampling: Sampling::default(), length: 0.1, threshold: 1e-7, stop: 1e-3, background: 1.0 }
    }
}

impl RadianceSettings {
    /// The absorption over one step of this grid, where `base` is the spacing of the coarsest one \[m\]: the interval
    /// is `length · step · spacing / base`.
    pub fn absorption(&self, spacing: f64, base: f64, shift: f64) -> Absorption {
        let interval = self.length * self.sampling.step * (spacing / base);
        Absorption { shift, interval, threshold: self.threshold, stop: self.stop }
    }
}

/// Renders rays through a grid `[x, y, z, 1 + features]` of raw density and features, with colours from a network.
///
/// Samples that do not contribute are found beforehand, outside the tape; they have no gradient.
///
/// # Errors
/// Propagates errors of the ops.
pub fn render_radiance(
    values: &Var,
    grid: &DenseGrid,
    colours: &ColourNet,
    rays: &Rays,
    settings: &RadianceSettings,
    absorption: &Absorption,
) -> Result<Pixels> {
    let density = channel(values.value()?, 0)?;
    let visible = Visible::through(grid, &density, rays, &settings.sampling, absorption);
    let points = constant::points(values, &visible.samples.points)?;
    let rows = grid.lookup(values, &points)?;
    let density = rows.slice(1, 0..1).reshape([visible.samples.len()]);
    let features = visible.rows_seen(&rows.slice(1, 1..values.dims()[3]))?;
    let ray_of = visible.samples.rays();
    let ray_of = visible.seen.iter().map(|&i| ray_of[i as usize]).collect();
    let colours = colours.forward(&features, rays, ray_of)?;
    visible.composite(&density, &colours, absorption, settings.background)
}
