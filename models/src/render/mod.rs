//! Render: images of moving particles, differentiable from pixels to positions and opacities.
//!
//! `splat` spreads opacity and colour of the particles to a grid around them; `march` marches one
//! ray per pixel through that grid. The same renderer is used for every frame, so that its blur affects the fit of the
//! first frame and the comparison of later ones alike. `render_jvp` is the forward mode, for least squares over the
//! pixels.
//!
//! The published radiance field is rendered likewise: `splat_features` averages the features of particles on a grid,
//! and `render_radiance` composites its samples along rays, with colours from a network. [`ViewWeights`] and
//! `PixelLoss` weight views and pixels in a loss.

mod composite;
mod density_splat;
mod jvp;
mod march;
mod photometric;
mod radiance;
mod rays;
mod robust;
mod samples;
mod sharpen;
mod splat;
#[cfg(test)]
mod tests;
pub(crate) mod trajectory;
mod view_weights;

use std::sync::Arc;

use gradreel::{Result, Var};

pub(crate) use composite::Pixels;
#[doc(hidden)] // documentation links to it
pub use density_splat::splat_features;
pub(crate) use density_splat::{FeatureGrid, FeatureSplat};
pub(crate) use jvp::render_jvp;
pub use march::Surface;
pub(crate) use march::march;
pub use photometric::Target;
pub(crate) use photometric::{Robust, Weights};
pub(crate) use radiance::{RadianceSettings, render_radiance};
pub use rays::Rays;
pub(crate) use robust::{PixelLoss, huber};
pub(crate) use samples::{Absorption, Samples, Sampling, Visible};
pub(crate) use sharpen::sharpen;
pub(crate) use splat::{Splat, splat};
pub(crate) use trajectory::Trajectory;
pub use view_weights::ViewWeights;
pub(crate) use view_weights::camera_angles;
#[cfg(test)]
pub(crate) use view_weights::view_angles;

/// Renders particles: rows of premultiplied red, green, blue and coverage, `[rays, 4]`, in the order of the rays.
///
/// `positions` `[particles, 3]` \[m\], `opacity` `[particles, 1]` in 0…1, `colour` `[particles, 3]` in 0…1.
///
/// # Errors
/// [`gradreel::ErrorKind::NonFinite`] for a non-finite position.
pub(crate) fn render(
    positions: &Var,
    opacity: &Var,
    colour: &Var,
    rays: &Arc<Rays>,
    settings: &Splat,
    surface: &Surface,
) -> Result<Var> {
    let (grid, node_grid) = splat(positions, opacity, colour, settings)?;
    let grid = sharpen(&grid, node_grid, surface.sharpening)?;
    march(&grid, node_grid, rays, surface)
}
