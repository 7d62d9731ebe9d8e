//! The renderer in forward mode: derivatives of pixels along given directions of particle motion.

use std::sync::Arc;

use gradreel::ops::NodeGrid;
use gradreel::scalar::Real;
use gradreel::{DType, Error, ErrorKind, Result, Tape, Tensor};
use rayon::prelude::*;

use super::march::Scene;
use super::sharpen::{sharpen, sharpened};
use super::splat::cover;
use crate::render::{Rays, Splat, Surface};

/// Renders as [`render`](super::render()), and differentiates along several directions of the positions at once.
///
/// `positions` and each of the `directions` are `[particles, 3]` \[m\]. Returns the pixels `[rays, 4]` and their exact
/// derivatives `[rays, directions, 4]`. A direction costs about as much as a rendering; no array over all samples is
/// kept.
///
/// # Errors
/// [`ErrorKind::Shape`] for a direction of another shape or type than the positions; as [`splat`](super::splat()).
pub fn render_jvp(
    positions: &Tensor,
    directions: &[Tensor],
    opacity: &Tensor,
    colour: &Tensor,
    rays: &Arc<Rays>,
    settings: &Splat,
    surface: &Surface,
) -> Result<(Tensor, Tensor)> {
    if let Some(odd) = directions.iter().find(|d| d.dims() != positions.dims() || d.dtype() != positions.dtype()) {
        return Err(Error::new(ErrorKind::Shape, "a direction does not fit the positions")
            .at("render_jvp")
            .found(format!("{:?} {}", odd.dims(), odd.dtype()))
            .wanted(format!("{:?} {}", positions.dims(), positions.dtype())));
    }
    let tape = Tape::new();
    let [x, opacity, colour] = [positions, opacity, colour].map(|tensor| tape.constant(tensor.clone()));
    let node_grid = cover(&x, settings.spacing)?;
    let (places, values) = (settings.places(&x), settings.values(&opacity, &colour));
    let grid = sharpen(&values.grid_scatter_3d(&places, node_grid), node_grid, surface.sharpening)?;
    let (grid, places, values) = (grid.value()?, places.value()?, values.value()?);
    Ok(match positions.dtype() {
        DType::F64 => tangents_of::<f64>(&node_grid, surface, [places, values, grid], directions, rays),
        _ => tangents_of::<f32>(&node_grid, surface, [places, values, grid], directions, rays),
    })
}

fn tangents_of<T: Real>(
    node_grid: &NodeGrid,
    surface: &Surface,
    [positions, values, grid]: [&Tensor; 3],
    directions: &[Tensor],
    rays: &Rays,
) -> (Tensor, Tensor) {
    let mut tangents = spread::<T>(node_grid, positions, directions, values);
    if surface.sharpening > 0.0 && !directions.is_empty() {
        tangents = sharpened(&tangents, node_grid.dims, 4 * directions.len(), surface.sharpening);
    }
    let scene = Scene::<T>::new(node_grid, surface, grid.slice());
    let [pixels, changes] = along(&scene, &tangents, directions.len(), rays);
    (Tensor::from_vec(pixels, [rays.len(), 4]), Tensor::from_vec(changes, [rays.len(), directions.len(), 4]))
}

/// The tangents of the splatted grid, `[nodes, directions, 4]`: each particle's values times the slope of its weight.
fn spread<T: Real>(node_grid: &NodeGrid, positions: &Tensor, directions: &[Tensor], values: &Tensor) -> Vec<T> {
    let width = 4 * directions.len();
    let mut grid = vec![T::ZERO; node_grid.len() * width];
    let (positions, values): (&[T], &[T]) = (positions.slice(), values.slice());
    let directions: Vec<&[T]> = directions.iter().map(Tensor::slice).collect();
    let inverse = T::from_f64(1.0 / node_grid.spacing);
    let [_, ny, nz] = node_grid.dims;
    // parts move with their particles
    let count = directions.first().map_or(1, |direction| direction.len() / 3).max(1);
    for (part, value) in values.chunks_exact(4).enumerate() {
        let p = part % count;
        let (mut base, mut near, mut far) = (0, [T::ZERO; 3], [T::ZERO; 3]);
        for axis in 0..3 {
            let g = (positions[3 * part + axis] - T::from_f64(node_grid.origin[axis])) * inverse;
            let cell = (g.to_f64().max(0.0) as usize).min(node_grid.dims[axis].saturating_sub(2));
            far[axis] = g - T::from_f64(cell as f64);
            near[axis] = T::ONE - far[axis];
            base = base * node_grid.dims[axis] + cell;
        }
        for corner in 0..8usize {
            let side = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let w: [T; 3] = std::array::from_fn(|a| if side[a] == 1 { far[a] } else { near[a] });
            let s: [T; 3] = side.map(|far| if far == 1 { inverse } else { -inverse });
            let slope = [s[0] * w[1] * w[2], w[0] * s[1] * w[2], w[0] * w[1] * s[2]];
            let node = base + side[0] * ny * nz + side[1] * nz + side[2];
            let row = &mut grid[node * width..][..width];
            for (cell, direction) in row.chunks_exact_mut(4).zip(&directions) {
                let change =
                    slope[0] * direction[3 * p] + slope[1] * direction[3 * p + 1] + slope[2] * direction[3 * p + 2];
                for c in 0..4 {
                    cell[c] += change * value[c];
                }
            }
        }
    }
    grid
}

/// The pixels `[rays, 4]`, and their tangents `[rays, directions, 4]` from those of the grid.
fn along<T: Real>(scene: &Scene<'_, T>, tangents: &[T], count: usize, rays: &Rays) -> [Vec<T>; 2] {
    let width = 4 * count;
    let mut pixels = vec![T::ZERO; rays.len() * 4];
    let mut changes = vec![T::ZERO; rays.len() * width];
    let offsets: [usize; 8] = std::array::from_fn(|corner| {
        (corner >> 2 & 1) * scene.stride[0] / 4 + (corner >> 1 & 1) * scene.stride[1] / 4 + (corner & 1)
    });
    let trace = |(sample, left): &mut (Vec<T>, Vec<T>), r: usize, pixel: &mut [T], change: &mut [T]| {
        left.fill(T::ZERO);
        let through = scene.walk(rays.origins[r], rays.directions[r], |s| {
            let (occupancy, share) = (s.value[0], s.after / s.before);
            let weight = (s.before - s.after) / occupancy;
            (0..3).for_each(|c| pixel[c] += weight * s.value[c + 1]);
            sample.fill(T::ZERO);
            for (corner, offset) in offsets.iter().enumerate() {
                let side = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
                let [x, y, z]: [T; 3] = std::array::from_fn(|a| if side[a] == 1 { s.f[a] } else { T::ONE - s.f[a] });
                let (w, at) = (x * y * z, (s.base / 4 + offset) * width);
                let row = &tangents[at..at + width];
                for k in 0..width {
                    sample[k] += w * row[k];
                }
            }
            let deepening = s.after * scene.depth * scene.rise(occupancy).1;
            for k in 0..count {
                let after = left[k] * share - deepening * sample[4 * k];
                let of_weight = (left[k] - after - weight * sample[4 * k]) / occupancy;
                for c in 0..3 {
                    change[4 * k + c] += of_weight * s.value[c + 1] + weight * sample[4 * k + c + 1];
                }
                left[k] = after;
            }
        });
        pixel[3] = T::ONE - through;
        (0..count).for_each(|k| change[4 * k + 3] = -left[k]);
    };
    let scratch = || (vec![T::ZERO; width], vec![T::ZERO; count]);
    if count == 0 {
        let rows = pixels.par_chunks_mut(4).with_min_len(256).enumerate();
        rows.for_each_init(scratch, |scratch, (r, pixel)| trace(scratch, r, pixel, &mut []));
    } else {
        let rows = pixels.par_chunks_mut(4).zip(changes.par_chunks_mut(width)).with_min_len(64).enumerate();
        rows.for_each_init(scratch, |scratch, (r, (pixel, change))| trace(scratch, r, pixel, change));
    }
    [pixels, changes]
}
