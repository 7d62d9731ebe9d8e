//! Splat: opacity and premultiplied colour of particles, spread to a grid with trilinear weights.

use gradreel::ops::NodeGrid;
use gradreel::{Error, ErrorKind, Result, Tensor, Var};

use crate::particles::Particles;
use crate::render::Surface;

/// Settings of the splat.
#[derive(Debug, Clone, PartialEq)]
pub struct Splat {
    /// Node spacing \[m\]: the grid spacing of the simulation or less, down to the particle spacing.
    pub spacing: f64,
    /// Distance between neighbouring particles at rest \[m\], which determines the number of particles per cell.
    pub particle_spacing: f64,
}

impl Splat {
    /// The settings for rendering a surface.
    pub fn of(particles: &Particles, surface: &Surface) -> Self {
        Self { spacing: surface.spacing * particles.spacing, particle_spacing: particles.spacing }
    }
}

/// Spreads particles to a grid that covers them with a margin of one cell.
///
/// Channel 0 of the result `[x, y, z, 4]` is the occupancy `o = Σ w α · (particle_spacing / spacing)³`: 1 inside a
/// filled body, ½ at its surface, 0 outside. Channels 1–3 are the premultiplied colour `Σ w α c · (…)³`. Both are
/// smooth in the positions, also at nodes touched only by the tail of a single particle. On a grid finer than two
/// particle spacings, each particle is spread as eight parts of its cube.
///
/// # Errors
/// [`ErrorKind::NonFinite`] for a non-finite position; [`ErrorKind::Physics`] when the particles spread over more than
/// 2²⁶ nodes.
pub fn splat(positions: &Var, opacity: &Var, colour: &Var, settings: &Splat) -> Result<(Var, NodeGrid)> {
    let node_grid = cover(positions, settings.spacing)?;
    let (places, values) = (settings.places(positions), settings.values(opacity, colour));
    Ok((values.grid_scatter_3d(&places, node_grid), node_grid))
}

impl Splat {
    /// Positions of the parts of particles: all first parts, then all second ones, and so on.
    pub(super) fn places(&self, positions: &Var) -> Var {
        let (offsets, count) = (self.parts(), positions.dims()[0]);
        if offsets.len() == 1 {
            return positions.clone();
        }
        let all = offsets.iter().flat_map(|offset| std::iter::repeat_n(*offset, count)).flatten().collect();
        let all = Tensor::from_vec(all, [offsets.len() * count, 3]).cast(positions.dtype()).expect("a float");
        positions.repeat(&[offsets.len(), 1]) + positions.tape().constant(all)
    }

    /// The values of each part, `[parts, 4]`: its share of the occupancy, and the premultiplied colour.
    pub(super) fn values(&self, opacity: &Var, colour: &Var) -> Var {
        let parts = self.parts().len();
        let weight = opacity * ((self.particle_spacing / self.spacing).powi(3) / parts as f64);
        weight.concat(&[&(&weight * colour)], 1).repeat(&[parts, 1])
    }

    /// Offsets of the parts of a particle from its centre \[m\]. A particle represents a cube. On a grid finer than two
    /// particle spacings, a single point would cover a varying number of nodes, depending on its position between them.
    fn parts(&self) -> Vec<[f64; 3]> {
        if self.spacing >= 2.0 * self.particle_spacing {
            return vec![[0.0; 3]];
        }
        let quarter = 0.25 * self.particle_spacing;
        let side = |part: usize, axis: usize| if part >> axis & 1 == 1 { quarter } else { -quarter };
        (0..8).map(|part| [0, 1, 2].map(|axis| side(part, axis))).collect()
    }
}

/// The grid of multiples of `spacing` that contains the cells of all positions, plus one node on every side.
pub(super) fn cover(positions: &Var, spacing: f64) -> Result<NodeGrid> {
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
    Ok(NodeGrid { origin: first.map(|x| x * spacing), spacing, dims: extent.map(|n| n as usize) })
}
