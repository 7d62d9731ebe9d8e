//! Render: images of moving particles, differentiable from pixels to positions and opacities.
//!
//! [`splat`](splat()) spreads opacity and colour of the particles to a grid around them; [`march`](march()) sends one ray a
//! pixel through that grid. Both act through the same particles in every frame, so a field fitted through them at frame 0
//! looks the same when it moves: whatever the renderer blurs, it blurs in every frame alike. [`render_jvp`] is the same in
//! forward mode, for least squares over the pixels.
//!
//! The published radiance field is rendered likewise: [`splat_features`] averages the features of particles on a grid, and
//! [`render_radiance`] composites its samples along rays, with colours of a network. [`ViewWeights`] and [`PixelLoss`] say
//! what views and pixels count in a loss.

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
pub(crate) mod trajectory;
mod view_weights;

use std::sync::Arc;

use gradreel::{Result, Var};

pub use composite::Pixels;
pub use density_splat::{FeatureGrid, FeatureSplat, splat_features};
pub use jvp::render_jvp;
pub use march::{Surface, march};
pub use photometric::{Robust, Target, Weights};
pub use radiance::{RadianceSettings, render_radiance};
pub use rays::Rays;
pub use robust::{PixelLoss, huber};
pub use samples::{Absorption, Samples, Sampling, Visible};
pub use sharpen::sharpen;
pub use splat::{Splat, splat};
pub use trajectory::Trajectory;
pub use view_weights::{ViewWeights, camera_angles, view_angles};

/// Renders particles: rows of premultiplied red, green, blue and coverage, `[rays, 4]`, in the order of the rays.
///
/// `positions` `[particles, 3]` \[m\], `opacity` `[particles, 1]` in 0…1, `colour` `[particles, 3]` in 0…1.
///
/// # Errors
/// [`gradreel::ErrorKind::NonFinite`] for a position that is not finite.
pub fn render(
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
