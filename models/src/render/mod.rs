//! Render: images of moving particles, differentiable from pixels to positions and opacities.
//!
//! [`splat`](splat()) spreads opacity and colour of the particles to a grid around them; [`march`](march()) sends one ray a
//! pixel through that grid. Both act through the same particles in every frame, so a field fitted through them at frame 0
//! looks the same when it moves: whatever the renderer blurs, it blurs in every frame alike. [`render_jvp`] is the same in
//! forward mode, for least squares over the pixels.

mod jvp;
mod march;
mod photometric;
mod rays;
mod splat;

use std::sync::Arc;

use gradreel::{Result, Var};

pub use jvp::render_jvp;
pub use march::{Surface, march};
pub use photometric::{Target, Weights};
pub use rays::Rays;
pub use splat::{Splat, splat};

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
    let (grid, lattice) = splat(positions, opacity, colour, settings)?;
    march(&grid, lattice, rays, surface)
}
