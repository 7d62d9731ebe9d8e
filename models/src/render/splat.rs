//! Splat: opacity and premultiplied colour of particles, spread to a grid with trilinear weights.

use gradreel::ops::Lattice;
use gradreel::{Error, ErrorKind, Result, Var};

use crate::particles::Particles;

/// How particles are spread.
#[derive(Debug, Clone, PartialEq)]
pub struct Splat {
    /// Distance between grid nodes \[m\]; the grid spacing of the simulation is a good choice.
    pub spacing: f64,
    /// Distance between neighbouring particles at rest \[m\]; decides how many share a cell.
    pub particle_spacing: f64,
}

impl Splat {
    /// To the grid of the simulation, of twice the spacing of the particles.
    pub fn of(particles: &Particles) -> Self {
        Self { spacing: 2.0 * particles.spacing, particle_spacing: particles.spacing }
    }
}

/// Spreads particles to a grid that covers them with a margin of one cell.
///
/// Channel 0 of the result `[x, y, z, 4]` is the occupancy `o = Σ w α · (particle_spacing / spacing)³`: 1 inside a filled
/// body, ½ at its surface, 0 outside. Channels 1–3 are `Σ w α c · (…)³`, the colour premultiplied by it. Both are smooth in
/// the positions, also where a node is touched by a single particle's tail.
///
/// # Errors
/// [`ErrorKind::NonFinite`] for a position that is not finite; [`ErrorKind::Physics`] when the particles are spread over
/// more than 2²⁶ nodes.
pub fn splat(positions: &Var, opacity: &Var, colour: &Var, settings: &Splat) -> Result<(Var, Lattice)> {
    let lattice = cover(positions, settings.spacing)?;
    let share = (settings.particle_spacing / settings.spacing).powi(3);
    let weight = opacity * share;
    let values = weight.concat(&[&(&weight * colour)], 1);
    Ok((values.grid_scatter_3d(positions, lattice), lattice))
}

/// The lattice of multiples of `spacing` around all positions, one node wider on every side than their cells.
pub(super) fn cover(positions: &Var, spacing: f64) -> Result<Lattice> {
    let values = positions.value()?.to_vec()?;
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for (p, position) in values.chunks(3).enumerate() {
        if position.iter().any(|x| !x.is_finite()) {
            return Err(Error::new(ErrorKind::NonFinite, "a particle to be rendered has no finite position")
                .at(format!("particle {p}"))
                .found(format!("{position:?}")));
        }
        for axis in 0..3 {
            low[axis] = low[axis].min(position[axis]);
            high[axis] = high[axis].max(position[axis]);
        }
    }
    if values.is_empty() {
        (low, high) = ([0.0; 3], [0.0; 3]);
    }
    let first = low.map(|x| (x / spacing).floor() - 1.0);
    let last = high.map(|x| (x / spacing).floor() + 2.0);
    let extent: [f64; 3] = std::array::from_fn(|axis| last[axis] - first[axis] + 1.0);
    if extent.iter().product::<f64>() > f64::from(1u32 << 26) {
        return Err(Error::new(ErrorKind::Physics, "the particles are spread too far to be rendered")
            .found(format!("{extent:?} nodes at a spacing of {spacing} m"))
            .fix("look for particles that flew away: the step may be too large or the material too soft"));
    }
    Ok(Lattice { origin: first.map(|x| x * spacing), spacing, dims: extent.map(|n| n as usize) })
}
