//! March: volume rendering of an occupancy grid, one ray at a time, as one fused op.
//!
//! As separate ops this would store some fifteen arrays over all samples. Fused, the samples of a ray stay in registers
//! and are recomputed in the backward pass.

use std::sync::Arc;

use gradreel::ops::NodeGrid;
use gradreel::scalar::Real;
use gradreel::{Backward, DType, Error, ErrorKind, Forward, Op, Operands, Reads, Result, Spec, Tensor, Var};
use rayon::prelude::*;

use crate::render::Rays;

/// The map from occupancy to opacity.
///
/// The optical depth of one step is `depth · s(o)`, where `s` rises smoothly (a cubic) from 0 at occupancy `low` to 1
/// at `low + width`, which locates the surface to a fraction of a cell. The contour of a silhouette lies where a
/// grazing ray, which passes several samples of nearly equal occupancy, has lost half of its light. A filled body has
/// occupancy ½ at a flat surface and less at a convex one; for a ball of ten grid spacings in diameter it is 0.45. With
/// the default values the contour lies between the two.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Surface {
    /// Spacing of the splatting grid, in particle spacings at rest.
    #[serde(skip)]
    pub spacing: f64,
    /// Step along the ray, in grid spacings.
    #[serde(skip)]
    pub step: f64,
    /// Optical depth of one step through a filled body.
    #[serde(skip)]
    pub depth: f64,
    /// Occupancy below which a sample is transparent.
    pub low: f64,
    /// Width of the rise, in occupancy.
    #[serde(skip)]
    pub width: f64,
    /// Share of the grid's blur that is removed from the occupancy first (`sharpen`).
    pub sharpening: f64,
}

impl Default for Surface {
    fn default() -> Self {
        Self { spacing: 2.0, step: 0.5, depth: 3.0, low: 0.40, width: 0.4, sharpening: 0.0 }
    }
}

/// Transmittance below which a ray ends.
const OPAQUE: f64 = 1e-4;

/// Number of work items of the backward pass; each has its own gradient grid, so that sums do not depend on the thread
/// count.
const PARTS: usize = 8;

/// Marches rays through a grid `[x, y, z, 4]` of occupancy and premultiplied colour: `[rays, 4]`, premultiplied red,
/// green, blue and coverage `1 − T`.
///
/// Per ray, front to back at fixed distances from its origin: `τ_k = depth · s(o_k)`, `w_k = T_k (1 − e^{−τ_k})`,
/// `T_{k+1} = T_k e^{−τ_k}`, colour `Σ w_k c_k`.
///
/// # Errors
/// [`ErrorKind::Shape`] when `grid` does not match `node_grid`.
pub fn march(grid: &Var, node_grid: NodeGrid, rays: &Arc<Rays>, surface: &Surface) -> Result<Var> {
    grid.apply(March { node_grid, rays: rays.clone(), surface: surface.clone() }, &[])
}

#[derive(Debug)]
struct March {
    node_grid: NodeGrid,
    rays: Arc<Rays>,
    surface: Surface,
}

/// One visible sample of a ray.
pub(super) struct Sample<T> {
    /// Flat index of the lowest corner.
    pub base: usize,
    /// Position in the cell, 0…1 per axis.
    pub f: [T; 3],
    /// Occupancy and premultiplied colour.
    pub value: [T; 4],
    /// Transmittance before and after the sample.
    pub before: T,
    pub after: T,
}

/// The grid and the surface map in the working precision.
pub(super) struct Scene<'a, T> {
    values: &'a [T],
    origin: [T; 3],
    last_cell: [usize; 3],
    upper: [T; 3],
    pub stride: [usize; 2],
    inverse: T,
    step: T,
    pub depth: T,
    low: T,
    steepness: T,
}

impl<'a, T: Real> Scene<'a, T> {
    pub fn new(node_grid: &NodeGrid, surface: &Surface, values: &'a [T]) -> Self {
        let real = T::from_f64;
        Self {
            values,
            origin: node_grid.origin.map(real),
            last_cell: node_grid.dims.map(|n| n.saturating_sub(2)),
            upper: node_grid.dims.map(|n| real(n.saturating_sub(1) as f64)),
            stride: [node_grid.dims[1] * node_grid.dims[2] * 4, node_grid.dims[2] * 4],
            inverse: real(1.0 / node_grid.spacing),
            step: real(surface.step * node_grid.spacing),
            depth: real(surface.depth),
            low: real(surface.low),
            steepness: real(1.0 / surface.width),
        }
    }

    /// Visits the visible samples of a ray front to back until it is opaque; returns the remaining transmittance.
    #[inline(always)]
    pub fn walk(&self, origin: [f64; 3], direction: [f64; 3], mut visit: impl FnMut(Sample<T>)) -> T {
        let real = T::from_f64;
        let mut transmittance = T::ONE;
        // ray in grid coordinates: position g0 + t·gd, t in metres
        let mut enter = 0.0f64;
        let mut leave = f64::INFINITY;
        let mut start = [T::ZERO; 3];
        let mut slope = [T::ZERO; 3];
        let inverse = self.inverse.to_f64();
        for axis in 0..3 {
            let g0 = (origin[axis] - self.origin[axis].to_f64()) * inverse;
            let gd = direction[axis] * inverse;
            let gd = if gd.abs() < 1e-12 { 1e-12 } else { gd };
            let (a, b) = (-g0 / gd, (self.upper[axis].to_f64() - g0) / gd);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
            (start[axis], slope[axis]) = (real(g0), real(gd));
        }
        let step = self.step.to_f64();
        let first = (enter / step).ceil();
        if first * step >= leave || leave.is_nan() || enter.is_nan() {
            return transmittance;
        }
        let count = ((leave / step).floor() - first) as i64 + 1;
        for k in 0..count {
            let t = real((first + k as f64) * step);
            let mut base = 0;
            let mut f = [T::ZERO; 3];
            for axis in 0..3 {
                let g = start[axis] + t * slope[axis];
                let cell = (g.to_f64().max(0.0) as usize).min(self.last_cell[axis]);
                f[axis] = g - real(cell as f64);
                base += cell * if axis < 2 { self.stride[axis] } else { 4 };
            }
            let value = self.trilinear(base, f);
            if value[0] <= self.low {
                continue;
            }
            let before = transmittance;
            transmittance = before * (-(self.depth * self.rise(value[0]).0)).exp();
            visit(Sample { base, f, value, before, after: transmittance });
            if transmittance < real(OPAQUE) {
                break;
            }
        }
        transmittance
    }

    #[inline(always)]
    fn node(&self, at: usize) -> [T; 4] {
        [self.values[at], self.values[at + 1], self.values[at + 2], self.values[at + 3]]
    }

    #[inline(always)]
    fn trilinear(&self, base: usize, f: [T; 3]) -> [T; 4] {
        let mix = |a: [T; 4], b: [T; 4], f: T| -> [T; 4] { std::array::from_fn(|c| a[c] + f * (b[c] - a[c])) };
        let line = |at: usize| mix(self.node(at), self.node(at + 4), f[2]);
        let plane = |at: usize| mix(line(at), line(at + self.stride[1]), f[1]);
        mix(plane(base), plane(base + self.stride[0]), f[0])
    }

    /// The surface map and its derivative.
    #[inline(always)]
    pub fn rise(&self, occupancy: T) -> (T, T) {
        let u = (occupancy - self.low) * self.steepness;
        if u >= T::ONE {
            return (T::ONE, T::ZERO);
        }
        let (three, two, six) = (T::from_f64(3.0), T::from_f64(2.0), T::from_f64(6.0));
        (u * u * (three - two * u), six * u * (T::ONE - u) * self.steepness)
    }

    /// Adds the cotangent of one sample's value to the eight nodes around it.
    #[inline(always)]
    fn scatter(&self, gradient: &mut [T], base: usize, f: [T; 3], cotangent: [T; 4]) {
        for corner in 0..8usize {
            let [x, y, z] = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let pick = |axis: usize, far: usize| if far == 1 { f[axis] } else { T::ONE - f[axis] };
            let weight = pick(0, x) * pick(1, y) * pick(2, z);
            let at = base + x * self.stride[0] + y * self.stride[1] + z * 4;
            for (g, c) in gradient[at..at + 4].iter_mut().zip(cotangent) {
                *g += weight * c;
            }
        }
    }
}

impl March {
    fn forward<T: Real>(&self, grid: &Tensor) -> Vec<T> {
        let scene = Scene::<T>::new(&self.node_grid, &self.surface, grid.slice());
        let mut pixels = vec![T::ZERO; self.rays.len() * 4];
        pixels.par_chunks_mut(4).with_min_len(256).enumerate().for_each(|(r, pixel)| {
            let mut colour = [T::ZERO; 3];
            let left = scene.walk(self.rays.origins[r], self.rays.directions[r], |s| {
                let weight = (s.before - s.after) / s.value[0];
                (0..3).for_each(|c| colour[c] += weight * s.value[c + 1]);
            });
            pixel[..3].copy_from_slice(&colour);
            pixel[3] = T::ONE - left;
        });
        pixels
    }

    fn backward<T: Real>(&self, grid: &Tensor, cotangent: &Tensor) -> Vec<T> {
        let scene = Scene::<T>::new(&self.node_grid, &self.surface, grid.slice());
        let wanted = cotangent.slice::<T>();
        let part = self.rays.len().div_ceil(PARTS).max(1);
        let one = |p: usize| {
            let mut gradient = vec![T::ZERO; grid.len()];
            let mut samples = Vec::with_capacity(256);
            for r in p * part..((p + 1) * part).min(self.rays.len()) {
                let g: [T; 4] = std::array::from_fn(|c| wanted[r * 4 + c]);
                if g.iter().all(|&g| g == T::ZERO) {
                    continue;
                }
                samples.clear();
                let left = scene.walk(self.rays.origins[r], self.rays.directions[r], |s| samples.push(s));
                // Σ w (g · c) over the samples behind
                let mut behind = T::ZERO;
                for s in samples.iter().rev() {
                    let occupancy = s.value[0];
                    let shade = (0..3).map(|c| g[c] * s.value[c + 1]).sum::<T>() / occupancy;
                    let weight = s.before - s.after;
                    let for_depth = s.after * shade - behind + g[3] * left;
                    let for_occupancy = for_depth * scene.depth * scene.rise(occupancy).1 - weight * shade / occupancy;
                    let for_colour = weight / occupancy;
                    let cotangent = [for_occupancy, for_colour * g[0], for_colour * g[1], for_colour * g[2]];
                    scene.scatter(&mut gradient, s.base, s.f, cotangent);
                    behind += weight * shade;
                }
            }
            gradient
        };
        let parts: Vec<Vec<T>> = (0..PARTS).into_par_iter().map(one).collect();
        let mut total = vec![T::ZERO; grid.len()];
        parts.iter().for_each(|part| total.iter_mut().zip(part).for_each(|(sum, g)| *sum += *g));
        total
    }
}

impl Op for March {
    fn name(&self) -> &'static str {
        "march"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x, y, z] = self.node_grid.dims;
        let [grid] = Spec::exactly(self.name(), inputs)?;
        if grid.shape.dims() != [x, y, z, 4] || !grid.dtype.is_real() || x.min(y).min(z) < 2 {
            return Err(Error::new(ErrorKind::Shape, "march: the grid is not that of the grid")
                .found(format!("{grid:?}"))
                .wanted(format!("[{x}, {y}, {z}, 4], at least 2 nodes per axis")));
        }
        Ok(Spec::new([self.rays.len(), 4], grid.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let shape = [self.rays.len(), 4];
        Ok(match inputs[0].dtype() {
            DType::F64 => Tensor::from_vec(self.forward::<f64>(&inputs[0]), shape),
            _ => Tensor::from_vec(self.forward::<f32>(&inputs[0]), shape),
        }
        .into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        cx.first_order_only(self.name())?;
        let (grid, cotangent) = (cx.input(0).value()?, cx.gradient().value()?);
        let gradient = match grid.dtype() {
            DType::F64 => Tensor::from_vec(self.backward::<f64>(grid, cotangent), grid.shape()),
            _ => Tensor::from_vec(self.backward::<f32>(grid, cotangent), grid.shape()),
        };
        Ok(vec![Some(cx.gradient().tape().constant(gradient))])
    }
}
