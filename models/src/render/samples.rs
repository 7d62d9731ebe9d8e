//! Samples: equidistant points along rays through a box.

use rayon::prelude::*;

use crate::field::DenseGrid;
use crate::render::Rays;
use crate::vector::norm;

/// Rays per work item.
const RAYS: usize = 256;

/// Positions of the samples along a ray.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sampling {
    /// Distance between samples in grid spacings.
    pub step: f64,
    /// Nearest sample, in multiples of the ray direction's length.
    pub near: f64,
    /// Farthest sample, in multiples of the ray direction's length.
    pub far: f64,
}

impl Default for Sampling {
    fn default() -> Self {
        Self { step: 0.5, near: 0.1, far: 1e9 }
    }
}

/// Points along rays, one ray after the other, front to back.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    /// The points \[m\].
    pub points: Vec<[f64; 3]>,
    /// Steps from the entry of the ray into the box.
    pub numbers: Vec<u32>,
    /// Ray `r` has the points `offsets[r]..offsets[r + 1]`.
    pub offsets: Vec<u32>,
}

/// The contributing samples of rays through a field of raw density.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Visible {
    /// The samples that absorb light.
    pub samples: Samples,
    /// Indices of the visible ones among them.
    pub seen: Vec<u32>,
}

/// The map from raw density to opacity, with cut-offs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Absorption {
    /// Added to raw densities.
    pub shift: f64,
    /// Length of a step in the length unit of the raw density.
    pub interval: f64,
    /// Opacities and weights up to this value are dropped.
    pub threshold: f64,
    /// A ray ends after the sample at which the transmittance falls below this value.
    pub stop: f64,
}

/// The part of a ray within a box.
struct Crossing {
    start: [f64; 3],
    direction: [f64; 3],
    steps: usize,
}

impl Crossing {
    /// Entry and exit by the slab method; the ray direction may have any length.
    fn new(origin: [f64; 3], direction: [f64; 3], grid: &DenseGrid, sampling: &Sampling) -> Self {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let slope = if direction[axis] == 0.0 { 1e-6 } else { direction[axis] };
            let (a, b) = ((grid.high[axis] - origin[axis]) / slope, (grid.low[axis] - origin[axis]) / slope);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        let (enter, leave) = (enter.clamp(sampling.near, sampling.far), leave.clamp(sampling.near, sampling.far));
        let length = norm(direction);
        let steps = ((leave - enter) * length / (sampling.step * grid.spacing)).ceil().max(1.0);
        Self {
            start: [0, 1, 2].map(|axis| origin[axis] + direction[axis] * enter),
            direction: direction.map(|d| d / length),
            steps: steps as usize,
        }
    }

    #[inline(always)]
    fn point(&self, distance: f64) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.start[axis] + self.direction[axis] * distance)
    }
}

/// Calls `visit(part, ray, number, point)` for the samples of each ray within the box, front to back, until it ends the
/// ray. Parts cover consecutive rays and are returned in order.
fn walk<P: Send + Default>(
    rays: &Rays,
    grid: &DenseGrid,
    sampling: &Sampling,
    visit: impl Fn(&mut P, u32, [f64; 3]) -> bool + Sync,
    end_of_ray: impl Fn(&mut P) + Sync,
) -> Vec<P> {
    let step = sampling.step * grid.spacing;
    let part = |item: usize| {
        let mut part = P::default();
        for ray in item * RAYS..rays.len().min((item + 1) * RAYS) {
            let crossing = Crossing::new(rays.origins[ray], rays.directions[ray], grid, sampling);
            for k in 0..crossing.steps {
                let point = crossing.point(step * k as f64);
                if grid.contains(point) && !visit(&mut part, k as u32, point) {
                    break;
                }
            }
            end_of_ray(&mut part);
        }
        part
    };
    (0..rays.len().div_ceil(RAYS)).into_par_iter().map(part).collect()
}

/// The samples of consecutive rays; offsets are ends of rays.
#[derive(Default)]
struct Part {
    visible: Visible,
    left: Option<f64>,
}

impl Visible {
    fn joined(parts: Vec<Part>) -> Self {
        let mut all = Self { samples: Samples { offsets: vec![0], ..Samples::default() }, seen: Vec::new() };
        let count = parts.iter().map(|part| part.visible.samples.points.len()).sum();
        all.samples.points.reserve(count);
        all.samples.numbers.reserve(count);
        for Part { visible, .. } in parts {
            let base = all.samples.points.len() as u32;
            all.samples.offsets.extend(visible.samples.offsets.iter().map(|end| base + end));
            all.samples.points.extend(visible.samples.points);
            all.samples.numbers.extend(visible.samples.numbers);
            all.seen.extend(visible.seen.iter().map(|i| base + i));
        }
        all
    }

    /// The contributing samples of rays through a grid of raw densities (one per node, z fastest): those within the box
    /// whose opacity exceeds the threshold, up to the one after which the transmittance is below `stop`. `seen` are
    /// those among them whose weight exceeds the threshold.
    ///
    /// All others have neither value nor gradient, so that these samples render the complete image.
    pub fn through(
        grid: &DenseGrid,
        density: &[f64],
        rays: &Rays,
        sampling: &Sampling,
        absorption: &Absorption,
    ) -> Self {
        let Absorption { shift, interval, threshold, stop } = *absorption;
        let scale = grid.scale();
        // below this density the opacity is certainly below the threshold
        let least = (threshold.max(1e-300) / interval).ln() - 1e-3 - shift;
        let visit = |part: &mut Part, number: u32, point: [f64; 3]| {
            let density = grid.at(density, &scale, point);
            if density < least {
                return true;
            }
            let alpha = crate::field::opacity(density, shift, interval);
            let left = part.left.get_or_insert(1.0);
            part.visible.keep(point, number, alpha, threshold, left);
            *left >= stop
        };
        Self::joined(walk(rays, grid, sampling, visit, Part::end_ray))
    }

    /// Selects the contributing samples by their opacities, as [`Visible::through`] does.
    pub fn among(samples: &Samples, alpha: &[f64], threshold: f64, stop: f64) -> Self {
        let mut part = Part::default();
        for ends in samples.offsets.windows(2) {
            let mut left = 1.0;
            for i in ends[0] as usize..ends[1] as usize {
                part.visible.keep(samples.points[i], samples.numbers[i], alpha[i], threshold, &mut left);
                if left < stop {
                    break;
                }
            }
            part.end_ray();
        }
        Self::joined(vec![part])
    }

    #[inline(always)]
    fn keep(&mut self, point: [f64; 3], number: u32, alpha: f64, threshold: f64, left: &mut f64) {
        if alpha > threshold {
            if *left * alpha > threshold {
                self.seen.push(self.samples.points.len() as u32);
            }
            self.samples.points.push(point);
            self.samples.numbers.push(number);
            *left *= 1.0 - alpha;
        }
    }

    /// The offsets of the rays in [`Visible::seen`].
    pub fn seen_offsets(&self) -> Vec<u32> {
        let mut at = 0;
        let offset = |end: &u32| {
            while at < self.seen.len() && self.seen[at] < *end {
                at += 1;
            }
            at as u32
        };
        self.samples.offsets.iter().map(offset).collect()
    }
}

impl Part {
    fn end_ray(&mut self) {
        self.left = None;
        self.visible.samples.offsets.push(self.visible.samples.points.len() as u32);
    }
}

impl Samples {
    /// All samples within a box: sample `k` of a ray lies at `o + d t + (d/‖d‖) step · spacing · k`, where `t` is the
    /// entry of the ray into the box, clamped to `near` and `far`; directions `d` may have any length.
    pub fn in_box(rays: &Rays, grid: &DenseGrid, sampling: &Sampling) -> Self {
        let visit = |part: &mut Part, number: u32, point: [f64; 3]| {
            part.visible.samples.points.push(point);
            part.visible.samples.numbers.push(number);
            true
        };
        Visible::joined(walk(rays, grid, sampling, visit, Part::end_ray)).samples
    }

    /// All samples within the box of a grid at occupied nodes.
    pub fn within(occupancy: &crate::field::Occupancy, rays: &Rays, sampling: &Sampling) -> Self {
        let visit = |part: &mut Part, number: u32, point: [f64; 3]| {
            if occupancy.contains(point) {
                part.visible.samples.points.push(point);
                part.visible.samples.numbers.push(number);
            }
            true
        };
        Visible::joined(walk(rays, &occupancy.grid, sampling, visit, Part::end_ray)).samples
    }

    /// The ray of each sample.
    pub fn rays(&self) -> Vec<u32> {
        let rays = self.offsets.windows(2).enumerate();
        rays.flat_map(|(ray, ends)| (ends[0]..ends[1]).map(move |_| ray as u32)).collect()
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.points.len()
    }
}
