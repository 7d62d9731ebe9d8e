//! Ray intersection with the surface of a body made of particles.
//!
//! Every particle contributes `(1 − r²/R²)³` within a radius `R` of twice the particle spacing. The sum is constant
//! inside a filled body; the surface is the level set at half of that value.

use gradreel::{Error, ErrorKind, Result};

use crate::vector::{bounds, dot};

/// Kernel radius of a particle, in spacings.
const RADIUS: f64 = 2.0;
/// Grid spacing, in spacings of the densest particles.
const NODES: f64 = 0.8;
/// Level of the surface as a share of the interior sum.
const LEVEL: f32 = 0.5;
/// The sum inside a filled body: `∫ (1 − r²/R²)³ = 64/315 π R³` over the volume of one particle.
const INSIDE: f64 = 64.0 / 315.0 * std::f64::consts::PI * RADIUS * RADIUS * RADIUS;

/// Intersection of a ray with the surface.
pub(crate) struct Hit {
    pub colour: [f64; 3],
    /// Outward unit normal.
    pub normal: [f64; 3],
}

/// The scalar field whose level set is the surface, with the particles' weighted colours.
pub(crate) struct Surface {
    origin: [f64; 3],
    spacing: f64,
    dims: [usize; 3],
    /// Share of the interior sum, and colours premultiplied by it.
    nodes: Vec<[f32; 4]>,
    /// The share at which the surface lies.
    level: f32,
}

impl Surface {
    /// Builds the field from particles with these rest spacings \[m\].
    ///
    /// # Errors
    /// [`ErrorKind::Physics`] if they extend over more than 2²⁶ nodes.
    pub fn of(positions: &[[f32; 3]], colours: &[[f32; 3]], spacings: &[f64]) -> Result<Self> {
        let [low, high] = bounds(positions.iter().map(|x| x.map(f64::from)));
        let [dense, sparse] = spacings.iter().fold([f64::INFINITY, 0.0], |[a, b], &s| [a.min(s), f64::max(b, s)]);
        // kernels of much denser particles still cover at least one node
        let step = NODES * dense.max(0.25 * sparse);
        let radius = RADIUS * sparse;
        let origin = low.map(|x| x - radius - step);
        let dims: [usize; 3] =
            std::array::from_fn(|axis| ((high[axis] - low[axis] + 2.0 * (radius + step)) / step).ceil() as usize + 1);
        if dims.iter().map(|&n| n as f64).product::<f64>() > f64::from(1 << 26) {
            return Err(Error::new(ErrorKind::Physics, "the particles are spread too far to be filmed")
                .found(format!("{dims:?} nodes, {step} m apart"))
                .fix("film fewer frames, or keep what flies away inside walls"));
        }
        let mut nodes = vec![[0.0f32; 4]; dims.iter().product()];
        for ((x, colour), spacing) in positions.iter().zip(colours).zip(spacings) {
            let at: [f64; 3] = std::array::from_fn(|axis| (f64::from(x[axis]) - origin[axis]) / step);
            let reach = (RADIUS * spacing / step).max(1.0);
            let range = |axis: usize| (at[axis] - reach).ceil() as usize..=(at[axis] + reach).floor() as usize;
            for i in range(0) {
                for j in range(1) {
                    for k in range(2) {
                        let away = [i as f64 - at[0], j as f64 - at[1], k as f64 - at[2]];
                        let rest = 1.0 - dot(away, away) / (reach * reach);
                        if rest > 0.0 {
                            let share = (rest * rest * rest / INSIDE) as f32;
                            let node = &mut nodes[(i * dims[1] + j) * dims[2] + k];
                            node[0] += share;
                            (0..3).for_each(|c| node[c + 1] += share * colour[c]);
                        }
                    }
                }
            }
        }
        Ok(Self { origin, spacing: step, dims, nodes, level: LEVEL })
    }

    /// The same with the level that encloses a volume \[m³\], to that of an eighth of a cell.
    #[must_use]
    pub fn enclosing(mut self, volume: f64) -> Self {
        let mut inside = Vec::new();
        for i in 0..2 * (self.dims[0] - 1) {
            for j in 0..2 * (self.dims[1] - 1) {
                for k in 0..2 * (self.dims[2] - 1) {
                    let share = self.share([i, j, k].map(|n| 0.5 * n as f64 + 0.25));
                    if share > 0.0 {
                        inside.push(share);
                    }
                }
            }
        }
        let wanted = (8.0 * volume / self.spacing.powi(3)).round() as usize;
        if let Some(last) = wanted.checked_sub(1).filter(|last| *last < inside.len()) {
            self.level = *inside.select_nth_unstable_by(last, |a, b| b.total_cmp(a)).1;
        }
        self
    }

    /// The volume inside the surface \[m³\], counted in parts of a cell other than those of [`Surface::enclosing`].
    #[cfg(test)]
    pub fn volume(&self) -> f64 {
        let parts = 3;
        let count = self.dims.map(|n| parts * (n - 1));
        let at = |n: usize| (n as f64 + 0.5) / parts as f64;
        let cells = (0..count[0]).flat_map(|i| (0..count[1]).flat_map(move |j| (0..count[2]).map(move |k| [i, j, k])));
        let inside = cells.filter(|cell| self.share(cell.map(at)) >= self.level).count();
        inside as f64 * (self.spacing / parts as f64).powi(3)
    }

    /// The first point of a ray inside the surface.
    pub fn hit(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<Hit> {
        // in units of nodes
        let start: [f64; 3] = std::array::from_fn(|axis| (origin[axis] - self.origin[axis]) / self.spacing);
        let norm = dot(direction, direction).sqrt();
        let along = direction.map(|d| d / norm);
        let [mut near, mut far] = [0.0f64, f64::INFINITY];
        for axis in 0..3 {
            let last = (self.dims[axis] - 1) as f64 - 1e-6;
            let ends = [0.0, last].map(|end| (end - start[axis]) / along[axis]);
            if along[axis].abs() > 1e-12 {
                near = near.max(ends[0].min(ends[1]));
                far = far.min(ends[0].max(ends[1]));
            } else if !(0.0..=last).contains(&start[axis]) {
                return None;
            }
        }
        let at = |t: f64| -> [f64; 3] { std::array::from_fn(|axis| start[axis] + t * along[axis]) };
        let mut t = near;
        while t < far {
            let share = self.share(at(t));
            if share >= self.level {
                let (mut outside, mut inside) = ((t - 2.0 * STEP).max(near), t);
                for _ in 0..8 {
                    let middle = 0.5 * (outside + inside);
                    if self.share(at(middle)) >= self.level {
                        inside = middle;
                    } else {
                        outside = middle;
                    }
                }
                return Some(self.describe(at(inside)));
            }
            // where nothing is spread, the surface is a node away at least
            t += if share == 0.0 { 2.0 * STEP } else { STEP };
        }
        None
    }

    fn describe(&self, x: [f64; 3]) -> Hit {
        let [share, r, g, b] = self.sample(x);
        let slope: [f64; 3] = std::array::from_fn(|axis| {
            let (mut below, mut above) = (x, x);
            below[axis] -= 0.7;
            above[axis] += 0.7;
            f64::from(self.share(below) - self.share(above))
        });
        let norm = dot(slope, slope).sqrt().max(1e-12);
        Hit { colour: [r, g, b].map(|c| f64::from(c / share)), normal: slope.map(|s| s / norm) }
    }

    fn share(&self, x: [f64; 3]) -> f32 {
        self.sample(x)[0]
    }

    /// Trilinear interpolation; outside, the value of the border, which is empty.
    fn sample(&self, x: [f64; 3]) -> [f32; 4] {
        let mut corner = [0; 3];
        let mut share = [0.0f32; 3];
        for axis in 0..3 {
            let inside = x[axis].clamp(0.0, (self.dims[axis] - 1) as f64 - 1e-6);
            corner[axis] = inside as usize;
            share[axis] = (inside - corner[axis] as f64) as f32;
        }
        let mut sum = [0.0; 4];
        for (i, wx) in [1.0 - share[0], share[0]].into_iter().enumerate() {
            for (j, wy) in [1.0 - share[1], share[1]].into_iter().enumerate() {
                let row = ((corner[0] + i) * self.dims[1] + corner[1] + j) * self.dims[2] + corner[2];
                for (k, wz) in [1.0 - share[2], share[2]].into_iter().enumerate() {
                    let weight = wx * wy * wz;
                    (0..4).for_each(|c| sum[c] += weight * self.nodes[row + k][c]);
                }
            }
        }
        sum
    }
}

/// Length of a step along a ray, in nodes.
const STEP: f64 = 0.5;

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball of particles has its surface at the ball's radius, and its normals point away from the centre.
    #[test]
    fn a_ball_is_hit_at_its_radius() {
        let (spacing, radius) = (0.01, 0.1);
        let mut positions = Vec::new();
        for i in -12..12 {
            for j in -12..12 {
                for k in -12..12 {
                    let x = [i, j, k].map(|k| (f64::from(k) + 0.5) * spacing);
                    if dot(x, x) <= radius * radius {
                        positions.push(x.map(|x| x as f32));
                    }
                }
            }
        }
        let colours = vec![[0.2, 0.4, 0.6]; positions.len()];
        let surface = Surface::of(&positions, &colours, &vec![spacing; positions.len()]).unwrap();
        let mut mean = 0.0;
        for turn in 0..40 {
            let (up, around) = (-0.9 + 1.8 * f64::from(turn) / 39.0, 2.4 * f64::from(turn));
            let wide = (1.0f64 - up * up).sqrt();
            let outwards = [wide * around.cos(), up, wide * around.sin()];
            let hit = surface.hit(outwards, outwards.map(|x| -x)).expect("a ray through the centre");
            assert!(dot(hit.normal, outwards) > 0.95, "{:?} at {outwards:?}", hit.normal);
            assert!((hit.colour[1] - 0.4).abs() < 1e-4);
            // the level set along this ray, located again with small steps
            let reached = (0..2000).map(|k| 0.2 - 1e-4 * f64::from(k)).find(|r| {
                let x: [f64; 3] =
                    std::array::from_fn(|axis| (r * outwards[axis] - surface.origin[axis]) / surface.spacing);
                surface.share(x) >= LEVEL
            });
            mean += reached.expect("the ball is filled") / 40.0;
        }
        assert!((mean - radius).abs() < 0.15 * spacing, "radius {mean} of {radius}");
        assert!(surface.hit([0.0, 0.3, -1.0], [0.0, 0.0, 1.0]).is_none());
        let mut surface = surface;
        for share in [0.9, 1.0, 1.2] {
            let wanted = share * 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
            surface = surface.enclosing(wanted);
            let found = surface.volume();
            assert!((found / wanted - 1.0).abs() < 0.02, "{found} of {wanted} m³");
        }
    }
}
