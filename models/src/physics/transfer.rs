//! Particle to grid, grid to particle, and their adjoints, for one particle of a batch at a time.
//!
//! With quadratic B-spline weights `w` and `δ = x_node − x_particle`, a particle *scatters* `w (q + A δ)` and `w m`; it
//! *gathers* `v = Σ w v_i` and `c = 4/dx² Σ w v_i δᵀ`. The adjoint of the gather is the same scatter with `q = gv`,
//! `A = 4/dx² gc`, `m = 0`; the adjoint of the scatter is the same gather over node cotangents. Only the position needs
//! additional terms, as it enters through `w` and `δ` (see [`pull`]; in forward mode [`push_tangent`] and
//! [`gather_moving`]).
//!
//! Everything here is `#[inline(always)]` and generic over the [`Row`]; [`super::kernel`] instantiates it. All
//! functions share one safety contract: the machine must support the instruction set of `R`, and the stencils must have
//! been made for the given grid and region.

use super::node_grid::NodeGrid;
use super::row::{Number, Row};
use super::stencil::{BATCH, Batch, Moved, Slopes, Stencils};

/// The scattered values of a particle, for four nodes:
/// `[q, m | A's first column, x₀ | second column, x₁ | third column, x₂]`.
pub(crate) type Record<T> = [T; 16];

/// Builds a record from a row-major `a`.
#[inline(always)]
pub(crate) fn record<T: Number>(x: [T; 3], q: [T; 3], m: T, a: [T; 9]) -> Record<T> {
    [q[0], q[1], q[2], m, a[0], a[3], a[6], x[0], a[1], a[4], a[7], x[1], a[2], a[5], a[8], x[2]]
}

/// The position in a record.
#[inline(always)]
pub(crate) fn position<T: Number>(record: &Record<T>) -> [T; 3] {
    [record[7], record[11], record[15]]
}

/// The positions of a batch of records, padded with the last one.
#[inline(always)]
pub(crate) fn positions<'a, T: Number>(count: usize, record: impl Fn(usize) -> &'a Record<T>) -> [Batch<T>; 3] {
    let mut x = [[T::ZERO; BATCH]; 3];
    for i in 0..BATCH {
        let at = position(record(i.min(count - 1)));
        (0..3).for_each(|axis| x[axis][i] = at[axis]);
    }
    x
}

/// The value of particle `i` at each of the three nodes.
#[inline(always)]
fn nodes<T: Number>(numbers: &[Batch<T>; 3], i: usize) -> [T; 3] {
    [numbers[0][i], numbers[1][i], numbers[2][i]]
}

/// Scatters particle `i` of a batch to a region of the grid.
///
/// # Safety
///
/// See the module documentation.
#[inline(always)]
pub(crate) unsafe fn push<T: Number, R: Row<T>>(
    node_grid: &NodeGrid<T>,
    s: &Stencils<T>,
    i: usize,
    region: &mut [T],
    record: &Record<T>,
) {
    // SAFETY: the stencils' nine rows of four nodes lie inside the region.
    unsafe {
        let from = record.as_ptr();
        let weight = R::nodes(nodes(&s.w[2], i));
        let free = weight.without_mass();
        let along_x = R::repeat(from.add(4)).mul(free);
        let along_y = R::repeat(from.add(8)).mul(free);
        let along_z = R::repeat(from.add(12)).mul(free);
        let centre = along_z.mul_add(R::nodes(nodes(&s.delta[2], i)), R::repeat(from).mul(weight));
        for a in 0..3 {
            let plane = along_x.mul_add(R::splat(s.delta[0][a][i]), centre);
            for b in 0..3 {
                let at = region.as_mut_ptr().add(s.start[i] + a * node_grid.stride[0] + b * node_grid.stride[1]);
                let value = along_y.mul_add(R::splat(s.delta[1][b][i]), plane);
                value.mul_add(R::splat(s.across[a][b][i]), R::load(at)).store(at);
            }
        }
    }
}

/// The gathered values of a particle: `[Σ w g | Σ w g δ₀ | Σ w g δ₁ | Σ w g δ₂]` of the four node values.
pub(crate) type Gathered<T> = [T; 16];

/// Gathers node values and their first moments for particle `i` of a batch.
///
/// # Safety
///
/// See the module documentation; the region is the whole grid.
#[inline(always)]
pub(crate) unsafe fn gather<T: Number, R: Row<T>>(
    node_grid: &NodeGrid<T>,
    s: &Stencils<T>,
    i: usize,
    grid: &[T],
) -> Gathered<T> {
    // SAFETY: as in `push`.
    unsafe {
        let zero = R::splat(T::ZERO);
        let (mut sum, mut along_x, mut along_y) = (zero, zero, zero);
        for a in 0..3 {
            let at = grid.as_ptr().add(s.start[i] + a * node_grid.stride[0]);
            let (mut plane, mut plane_y) = (zero, zero);
            for b in 0..3 {
                let row = R::load(at.add(b * node_grid.stride[1])).mul(R::splat(s.w[1][b][i]));
                plane = plane.add(row);
                plane_y = row.mul_add(R::splat(s.delta[1][b][i]), plane_y);
            }
            let weighted = plane.mul(R::splat(s.w[0][a][i]));
            sum = sum.add(weighted);
            along_x = weighted.mul_add(R::splat(s.delta[0][a][i]), along_x);
            along_y = plane_y.mul_add(R::splat(s.w[0][a][i]), along_y);
        }
        let weight = R::nodes(nodes(&s.w[2], i));
        let sum = sum.mul(weight);
        let along_z = sum.mul(R::nodes(nodes(&s.delta[2], i)));
        R::fold([sum, along_x.mul(weight), along_y.mul(weight), along_z])
    }
}

/// Scatters the tangent of particle `i` of a batch to a region of the grid: `w (dq + dA δ) + dw (q + A δ)`, where `dq`
/// of the tangent already contains `− A dx`.
///
/// # Safety
///
/// See the module documentation.
#[inline(always)]
pub(crate) unsafe fn push_tangent<T: Number, R: Row<T>>(
    node_grid: &NodeGrid<T>,
    (s, dw, moved): (&Stencils<T>, &Slopes<T>, &Moved<T>),
    i: usize,
    region: &mut [T],
    record: &Record<T>,
    tangent: &Record<T>,
) {
    // SAFETY: as in `push`.
    unsafe {
        let delta_z = R::nodes(nodes(&s.delta[2], i));
        let [x1, y1, centre1] = columns::<T, R>(record, delta_z);
        let [x2, y2, centre2] = columns::<T, R>(tangent, delta_z);
        let (weight, slope) = (R::nodes(nodes(&s.w[2], i)), R::nodes(nodes(&dw.0[2], i)));
        for a in 0..3 {
            let delta = R::splat(s.delta[0][a][i]);
            let (plane1, plane2) = (x1.mul_add(delta, centre1), x2.mul_add(delta, centre2));
            for b in 0..3 {
                let at = region.as_mut_ptr().add(s.start[i] + a * node_grid.stride[0] + b * node_grid.stride[1]);
                let delta = R::splat(s.delta[1][b][i]);
                let (value, change) = (y1.mul_add(delta, plane1), y2.mul_add(delta, plane2));
                let by_weight = change.mul(R::splat(s.across[a][b][i]));
                let by_weight = value.mul_add(R::splat(moved.across[a][b][i]), by_weight);
                let sum = by_weight.mul_add(weight, R::load(at));
                value.mul(R::splat(moved.along[a][b][i])).mul_add(slope, sum).store(at);
            }
        }
    }
}

/// The gathered values of a particle, with their derivatives with respect to its position.
pub(crate) struct Moving<T> {
    /// `Σ w g` of the four node values.
    pub sum: [T; 4],
    /// As [`gather`], with `∂w` along each axis in place of `w`.
    pub along: [Gathered<T>; 3],
}

/// Gathers node values for particle `i` of a batch, and their derivatives with respect to its position. For a motion
/// `dx`, the sum changes by `dx · along`, and the moments by that minus `sum dxᵀ`.
///
/// # Safety
///
/// See the module documentation; the region is the whole grid.
#[inline(always)]
pub(crate) unsafe fn gather_moving<T: Number, R: Row<T>>(
    node_grid: &NodeGrid<T>,
    (s, Slopes(dw)): (&Stencils<T>, &Slopes<T>),
    i: usize,
    grid: &[T],
) -> Moving<T> {
    // SAFETY: as in `push`.
    unsafe {
        let zero = R::splat(T::ZERO);
        // weighted along x and y, differentiated along x, differentiated along y; each with the sum and the moments
        // along x and y
        let (mut plain, mut by_x, mut by_y) = ([zero; 3], [zero; 3], [zero; 3]);
        for a in 0..3 {
            let at = grid.as_ptr().add(s.start[i] + a * node_grid.stride[0]);
            let (mut plane, mut plane_y, mut sloped, mut sloped_y) = (zero, zero, zero, zero);
            for b in 0..3 {
                let row = R::load(at.add(b * node_grid.stride[1]));
                let delta = R::splat(s.delta[1][b][i]);
                let (weighted, slope) = (row.mul(R::splat(s.w[1][b][i])), row.mul(R::splat(dw[1][b][i])));
                (plane, plane_y) = (plane.add(weighted), weighted.mul_add(delta, plane_y));
                (sloped, sloped_y) = (sloped.add(slope), slope.mul_add(delta, sloped_y));
            }
            let (w, dw) = (R::splat(s.w[0][a][i]), R::splat(dw[0][a][i]));
            let delta = R::splat(s.delta[0][a][i]);
            macro_rules! add {
                ($to:ident, $sum:ident, $along_y:ident, $w:ident) => {{
                    let weighted = $sum.mul($w);
                    $to = [$to[0].add(weighted), weighted.mul_add(delta, $to[1]), $along_y.mul_add($w, $to[2])];
                }};
            }
            add!(plain, plane, plane_y, w);
            add!(by_x, plane, plane_y, dw);
            add!(by_y, sloped, sloped_y, w);
        }
        let (weight, slope) = (R::nodes(nodes(&s.w[2], i)), R::nodes(nodes(&dw[2], i)));
        let delta = R::nodes(nodes(&s.delta[2], i));
        macro_rules! along {
            ($from:ident, $w:ident) => {{
                let sum = $from[0].mul($w);
                R::fold([sum, $from[1].mul($w), $from[2].mul($w), sum.mul(delta)])
            }};
        }
        let along = [along!(by_x, weight), along!(by_y, weight), along!(plain, slope)];
        let [a, b, c, d, ..] = R::fold([plain[0].mul(weight), zero, zero, zero]);
        Moving { sum: [a, b, c, d], along }
    }
}

/// The cotangents of a particle, gathered from the grid.
pub(crate) struct Pulled<T> {
    /// Cotangents of the scattered values, `[q, m | A's columns, each with an unused value]`.
    pub record: Gathered<T>,
    /// Cotangent of the position, from both transfers.
    pub position: [T; 3],
}

/// The adjoint of both transfers for particle `i` of a batch.
///
/// `scattered` is its record and `cotangents` holds `[g_momentum, g_mass]` of the nodes; `gathered` is the record of
/// the adjoint of its gather and `velocities` holds the node velocities. The cotangent of the position is
///
/// `gx = Σ ∂w (g · [q + A δ, m] + v · (q′ + A′ δ)) − Aᵀ Σ w g − A′ᵀ Σ w v`
///
/// # Safety
///
/// See the module documentation; the region is the whole of both grids.
#[inline(always)]
pub(crate) unsafe fn pull<T: Number, R: Row<T>>(
    node_grid: &NodeGrid<T>,
    (s, Slopes(dw)): (&Stencils<T>, &Slopes<T>),
    i: usize,
    [cotangents, velocities]: [&[T]; 2],
    [scattered, gathered]: [&Record<T>; 2],
) -> Pulled<T> {
    // SAFETY: as in `push`.
    unsafe {
        let zero = R::splat(T::ZERO);
        let delta_z = R::nodes(nodes(&s.delta[2], i));
        let [x1, y1, centre1] = columns::<T, R>(scattered, delta_z);
        let [x2, y2, centre2] = columns::<T, R>(gathered, delta_z);
        let (mut sum, mut along_x, mut along_y, mut velocity) = (zero, zero, zero, zero);
        let (mut by_x, mut by_y, mut by_z) = (zero, zero, zero);
        for a in 0..3 {
            let step = a * node_grid.stride[0] + s.start[i];
            let delta = R::splat(s.delta[0][a][i]);
            let (plane1, plane2) = (x1.mul_add(delta, centre1), x2.mul_add(delta, centre2));
            let (mut sum_a, mut along_y_a, mut velocity_a, mut by_y_a, mut by_z_a) = (zero, zero, zero, zero, zero);
            for b in 0..3 {
                let at = step + b * node_grid.stride[1];
                let (g, v) = (R::load(cotangents.as_ptr().add(at)), R::load(velocities.as_ptr().add(at)));
                let (delta, w) = (R::splat(s.delta[1][b][i]), R::splat(s.w[1][b][i]));
                let work = y1.mul_add(delta, plane1).mul(g);
                let work = y2.mul_add(delta, plane2).mul_add(v, work);
                by_z_a = work.mul_add(w, by_z_a);
                by_y_a = work.mul_add(R::splat(dw[1][b][i]), by_y_a);
                let weighted = g.mul(w);
                sum_a = sum_a.add(weighted);
                along_y_a = weighted.mul_add(delta, along_y_a);
                velocity_a = v.mul_add(w, velocity_a);
            }
            let w = R::splat(s.w[0][a][i]);
            let weighted = sum_a.mul(w);
            sum = sum.add(weighted);
            along_x = weighted.mul_add(delta, along_x);
            along_y = along_y_a.mul_add(w, along_y);
            velocity = velocity_a.mul_add(w, velocity);
            by_x = by_z_a.mul_add(R::splat(dw[0][a][i]), by_x);
            by_y = by_y_a.mul_add(w, by_y);
            by_z = by_z_a.mul_add(w, by_z);
        }
        let weight = R::nodes(nodes(&s.w[2], i));
        let slope = R::nodes(nodes(&dw[2], i));
        let sum = sum.mul(weight);
        let record = R::fold([sum, along_x.mul(weight), along_y.mul(weight), sum.mul(delta_z)]);
        let weights = R::fold([velocity.mul(weight), by_x.mul(weight), by_y.mul(weight), by_z.mul(slope)]);
        let mut position = [T::ZERO; 3];
        for axis in 0..3 {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| weights[4 + 4 * axis + k]);
            position[axis] = a + b + c + d;
            for row in 0..3 {
                let column = 4 + 4 * axis + row;
                position[axis] = position[axis] - scattered[column] * record[row] - gathered[column] * weights[row];
            }
        }
        Pulled { record, position }
    }
}

/// The columns of a record as rows: the first two columns, and `q + A δ` along z.
///
/// # Safety
///
/// The machine must have the instruction set of `R`.
#[inline(always)]
unsafe fn columns<T: Number, R: Row<T>>(record: &Record<T>, delta_z: R) -> [R; 3] {
    let from = record.as_ptr();
    // SAFETY: a record holds 16 values.
    unsafe {
        let along_z = R::repeat(from.add(12)).without_mass();
        let centre = along_z.mul_add(delta_z, R::repeat(from));
        [R::repeat(from.add(4)).without_mass(), R::repeat(from.add(8)).without_mass(), centre]
    }
}
