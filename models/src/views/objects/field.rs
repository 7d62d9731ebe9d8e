//! A body sampled on a grid, and its intersection with rays.

use rayon::prelude::*;

use super::body::{Body, CUBE};
use crate::vector::dot;

/// Nodes along each side of the coarse grid that locates the body.
const COARSE: usize = 34;
/// Minimum step along a ray in grid spacings, and the share of the distance otherwise advanced.
const STEP: [f64; 2] = [0.3, 0.8];
/// Minimum ratio of a body's shortest to its longest side.
const THICK: f64 = 0.15;

/// Signed distances at the nodes of a grid around the body, whose box is centred at the origin with longest side 1.
/// Half sides of the box.
pub(crate) struct Field {
    pub low: [f64; 3],
    pub spacing: f64,
    pub dims: [usize; 3],
    pub nodes: Vec<f32>,
    pub half: [f64; 3],
    /// Centre and size of the box in the world in which the body was made.
    pub made: ([f64; 3], f64),
}

/// Entry point of a ray.
pub(super) struct Entry {
    pub place: [f64; 3],
    /// Outward unit normal.
    pub normal: [f64; 3],
}

/// Signed distances at the nodes of a grid.
fn sampled(body: &Body, low: [f64; 3], spacing: f64, dims: [usize; 3]) -> Vec<f32> {
    let mut nodes = vec![0.0f32; dims.iter().product()];
    nodes.par_chunks_mut(dims[1] * dims[2]).enumerate().for_each(|(i, plane)| {
        for (jk, node) in plane.iter_mut().enumerate() {
            let at = [i, jk / dims[2], jk % dims[2]];
            *node = body.distance([0, 1, 2].map(|axis| low[axis] + spacing * at[axis] as f64)) as f32;
        }
    });
    nodes
}

impl Field {
    /// Samples a body with `count` nodes along its longest side. `None` if it is empty or too thin.
    pub fn of(body: &Body, count: usize) -> Option<Self> {
        let coarse = 2.0 * CUBE / (COARSE - 1) as f64;
        let nodes = sampled(body, [-CUBE; 3], coarse, [COARSE; 3]);
        let near = nodes.iter().enumerate().filter(|(_, d)| f64::from(**d) < coarse).map(|(i, _)| i);
        let found = near.map(|i| [i / (COARSE * COARSE), i / COARSE % COARSE, i % COARSE]);
        let [low, high] = found.fold([[COARSE; 3], [0; 3]], |[low, high], at| {
            [[0, 1, 2].map(|axis| low[axis].min(at[axis])), [0, 1, 2].map(|axis| high[axis].max(at[axis]))]
        });
        if (0..3).any(|axis| low[axis] == 0 || high[axis] <= low[axis] || high[axis] + 1 >= COARSE) {
            return None;
        }
        let origin = low.map(|at| coarse * (at as f64 - 1.0) - CUBE);
        let sides = [0, 1, 2].map(|axis| coarse * (high[axis] - low[axis] + 2) as f64);
        let spacing = sides.into_iter().fold(0.0, f64::max) / (count - 1) as f64;
        let dims = sides.map(|side| (side / spacing).ceil() as usize + 1);
        let field = Self {
            nodes: sampled(body, origin, spacing, dims),
            low: origin,
            spacing,
            dims,
            half: [0.0; 3],
            made: ([0.0; 3], 1.0),
        };
        field.normalised()
    }

    /// Centres the box of the interior at the origin with longest side 1.
    fn normalised(mut self) -> Option<Self> {
        let [mut low, mut high] = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        let steps = [self.dims[1] * self.dims[2], self.dims[2], 1];
        for (i, &inside) in self.nodes.iter().enumerate().filter(|(_, d)| **d < 0.0) {
            for axis in 0..3 {
                let place = i / steps[axis] % self.dims[axis];
                if place == 0 || place + 1 == self.dims[axis] {
                    return None;
                }
                // zero crossing of the distance towards an exterior node
                let to = |next: usize| if self.nodes[next] > 0.0 { inside / (inside - self.nodes[next]) } else { 0.0 };
                let at = |share: f64| self.low[axis] + self.spacing * (place as f64 + share);
                low[axis] = low[axis].min(at(-f64::from(to(i - steps[axis]))));
                high[axis] = high[axis].max(at(f64::from(to(i + steps[axis]))));
            }
        }
        let sides = [0, 1, 2].map(|axis| high[axis] - low[axis]);
        let longest = sides.into_iter().fold(0.0, f64::max);
        if longest.is_nan() || longest <= 0.0 || sides.iter().any(|side| *side < THICK * longest) {
            return None;
        }
        let middle = [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]));
        self.low = [0, 1, 2].map(|axis| (self.low[axis] - middle[axis]) / longest);
        self.spacing /= longest;
        self.nodes.iter_mut().for_each(|d| *d /= longest as f32);
        (self.half, self.made) = (sides.map(|side| 0.5 * side / longest), (middle, longest));
        Some(self)
    }

    /// Trilinear interpolation.
    pub fn at(&self, x: [f64; 3]) -> f64 {
        let (mut corner, mut share) = ([0; 3], [0.0f32; 3]);
        for axis in 0..3 {
            let place = ((x[axis] - self.low[axis]) / self.spacing).clamp(0.0, (self.dims[axis] - 1) as f64 - 1e-6);
            corner[axis] = place as usize;
            share[axis] = (place - corner[axis] as f64) as f32;
        }
        let [sx, sy, sz] = [self.dims[1] * self.dims[2], self.dims[2], 1];
        let first = corner[0] * sx + corner[1] * sy + corner[2];
        let line = |i: usize| self.nodes[i] + share[2] * (self.nodes[i + sz] - self.nodes[i]);
        let plane = |i: usize| line(i) + share[1] * (line(i + sy) - line(i));
        f64::from(plane(first) + share[0] * (plane(first + sx) - plane(first)))
    }

    /// The first interior point of a ray; the direction has length 1.
    pub(super) fn entry(&self, origin: [f64; 3], along: [f64; 3]) -> Option<Entry> {
        let [mut near, mut far] = [0.0f64, f64::INFINITY];
        for axis in 0..3 {
            let slope = if along[axis].abs() < 1e-12 { 1e-12 } else { along[axis] };
            let ends = [-1.0, 1.0].map(|side| (side * self.half[axis] * 1.001 - origin[axis]) / slope);
            near = near.max(ends[0].min(ends[1]));
            far = far.min(ends[0].max(ends[1]));
        }
        let place = |t: f64| -> [f64; 3] { std::array::from_fn(|axis| origin[axis] + t * along[axis]) };
        let (mut before, mut t) = (near, near);
        while t < far {
            let distance = self.at(place(t));
            if distance <= 0.0 {
                let (mut outside, mut inside) = (before, t);
                for _ in 0..6 {
                    let middle = 0.5 * (outside + inside);
                    if self.at(place(middle)) <= 0.0 { inside = middle } else { outside = middle }
                }
                let place = place(inside);
                return Some(Entry { place, normal: self.normal(place) });
            }
            before = t;
            t += (STEP[1] * distance).max(STEP[0] * self.spacing);
        }
        None
    }

    fn normal(&self, x: [f64; 3]) -> [f64; 3] {
        let slope: [f64; 3] = std::array::from_fn(|axis| {
            let (mut below, mut above) = (x, x);
            below[axis] -= 0.6 * self.spacing;
            above[axis] += 0.6 * self.spacing;
            self.at(above) - self.at(below)
        });
        let norm = dot(slope, slope).sqrt().max(1e-12);
        slope.map(|s| s / norm)
    }
    /// The zero level of a field as a closed mesh: one corner in each cell that the surface crosses, at the mean of the crossings
    /// of its edges, and two triangles around each crossed edge of the grid (surface nets; Gibson, *Constrained elastic surface
    /// nets*, 1998). Returns corners, and triangles that face outwards.
    pub fn net(&self) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let [nx, ny, nz] = self.dims;
        let node = |[i, j, k]: [usize; 3]| f64::from(self.nodes[(i * ny + j) * nz + k]);
        let cells = [nx - 1, ny - 1, nz - 1];
        let cell = |[i, j, k]: [usize; 3]| (i * cells[1] + j) * cells[2] + k;
        let mut corner_of = vec![u32::MAX; cells.iter().product()];
        let mut corners = Vec::new();
        for i in 0..cells[0] {
            for j in 0..cells[1] {
                for k in 0..cells[2] {
                    let (mut sum, mut count) = ([0.0; 3], 0);
                    for edge in 0..12 {
                        let (axis, side) = (edge / 4, edge % 4);
                        let mut from = [i, j, k];
                        from[(axis + 1) % 3] += side & 1;
                        from[(axis + 2) % 3] += side >> 1;
                        let mut to = from;
                        to[axis] += 1;
                        let (a, b) = (node(from), node(to));
                        if (a < 0.0) != (b < 0.0) {
                            let mut at = from.map(|n| n as f64);
                            at[axis] += a / (a - b);
                            (0..3).for_each(|axis| sum[axis] += at[axis]);
                            count += 1;
                        }
                    }
                    if count > 0 {
                        corner_of[cell([i, j, k])] = corners.len() as u32;
                        corners
                            .push([0, 1, 2].map(|axis| self.low[axis] + self.spacing * sum[axis] / f64::from(count)));
                    }
                }
            }
        }
        let mut triangles = Vec::new();
        for i in 1..cells[0] {
            for j in 1..cells[1] {
                for k in 1..cells[2] {
                    for axis in 0..3 {
                        let mut to = [i, j, k];
                        to[axis] += 1;
                        let (a, b) = (node([i, j, k]), node(to));
                        if (a < 0.0) == (b < 0.0) {
                            continue;
                        }
                        // the four cells around the edge, in the sense of a right-handed turn about it
                        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                        let around = [(1, 1), (0, 1), (0, 0), (1, 0)].map(|(du, dv)| {
                            let mut at = [i, j, k];
                            at[u] -= du;
                            at[v] -= dv;
                            corner_of[cell(at)]
                        });
                        let [p, q, r, s] = if a < 0.0 { around } else { [around[3], around[2], around[1], around[0]] };
                        triangles.extend([[p, q, r], [p, r, s]]);
                    }
                }
            }
        }
        (corners, triangles)
    }
}
