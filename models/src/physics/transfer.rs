//! Particle to grid, grid to particle, and the adjoint of both, for one particle at a time.
//!
//! With quadratic B-spline weights `w` and `δ = x_node − x_particle`, a particle *scatters* `w (q + A δ)` and `w m`; it
//! *gathers* `v = Σ w v_i` and `c = 4/dx² Σ w v_i δᵀ`. The adjoint of the gather is the same scatter with
//! `q = gv`, `A = 4/dx² gc`, `m = 0`; the adjoint of the scatter is the same gather over node cotangents. Only the
//! position needs more: it enters through `w` and through `δ` (see [`pull`]; forwards [`push_tangent`], [`gather_tangent`]).
//!
//! Everything here is `#[inline(always)]` and generic over the [`Row`]; [`super::kernel`] instantiates it.

use super::lattice::Lattice;
use super::row::{Number, Row};

/// What a particle scatters, as four nodes' worth of numbers:
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

/// Weights, their derivatives and node offsets of one particle.
struct Stencil<T> {
    /// Where the first row starts.
    start: usize,
    /// `w[axis][node]`
    w: [[T; 3]; 3],
    /// `∂w/∂x` \[1/m\]
    dw: [[T; 3]; 3],
    /// `δ` per axis and node \[m\]
    delta: [[T; 3]; 3],
}

impl<T: Number> Stencil<T> {
    #[inline(always)]
    fn new(lattice: &Lattice<T>, first_plane: usize, planes: usize, x: [T; 3]) -> Self {
        let number = |value: f64| T::from_f64(value);
        let (base, fraction) = lattice.locate(x);
        let mut w = [[number(0.0); 3]; 3];
        let mut dw = w;
        let mut delta = w;
        for axis in 0..3 {
            let f = fraction[axis];
            let (a, b, c) = (number(1.5) - f, f - number(1.0), f - number(0.5));
            w[axis] = [number(0.5) * a * a, number(0.75) - b * b, number(0.5) * c * c];
            let per_metre = lattice.inverse_dx;
            dw[axis] = [-(a * per_metre), number(-2.0) * b * per_metre, c * per_metre];
            delta[axis] = [-(f * lattice.dx), -(b * lattice.dx), (number(2.0) - f) * lattice.dx];
        }
        let start = lattice.start(base, first_plane, planes);
        Self { start, w, dw, delta }
    }
}

/// Adds what a particle scatters to a region of the grid that starts at plane `first_plane`.
///
/// # Safety
///
/// The machine must have the instruction set of `R`.
#[inline(always)]
pub(crate) unsafe fn push<T: Number, R: Row<T>>(
    lattice: &Lattice<T>,
    first_plane: usize,
    region: &mut [T],
    record: &Record<T>,
) {
    let s = Stencil::new(lattice, first_plane, region.len() / lattice.stride[0], position(record));
    // SAFETY: `Lattice::start` has checked that nine rows of four nodes starting there lie inside the region.
    unsafe {
        let from = record.as_ptr();
        let weight = R::nodes(s.w[2]);
        let free = weight.without_mass();
        let along_x = R::repeat(from.add(4)).mul(free);
        let along_y = R::repeat(from.add(8)).mul(free);
        let along_z = R::repeat(from.add(12)).mul(free);
        let centre = along_z.mul_add(R::nodes(s.delta[2]), R::repeat(from).mul(weight));
        for a in 0..3 {
            let plane = along_x.mul_add(R::splat(s.delta[0][a]), centre);
            for b in 0..3 {
                let at = region.as_mut_ptr().add(s.start + a * lattice.stride[0] + b * lattice.stride[1]);
                let value = along_y.mul_add(R::splat(s.delta[1][b]), plane);
                value.mul_add(R::splat(s.w[0][a] * s.w[1][b]), R::load(at)).store(at);
            }
        }
    }
}

/// What a particle gathers.
pub(crate) struct Gathered<T> {
    /// `Σ w g` of the four node values.
    pub sum: [T; 4],
    /// `Σ w g δᵀ`, row-major.
    pub moment: [T; 9],
}

/// Gathers node values and their first moments at `x`.
///
/// # Safety
///
/// The machine must have the instruction set of `R`.
#[inline(always)]
pub(crate) unsafe fn gather<T: Number, R: Row<T>>(lattice: &Lattice<T>, grid: &[T], x: [T; 3]) -> Gathered<T> {
    let s = Stencil::new(lattice, 0, lattice.shape[0], x);
    // SAFETY: as in `push`.
    unsafe {
        let zero = R::splat(T::ZERO);
        let (mut sum, mut along_x, mut along_y) = (zero, zero, zero);
        for a in 0..3 {
            let at = grid.as_ptr().add(s.start + a * lattice.stride[0]);
            let (mut plane, mut plane_y) = (zero, zero);
            for b in 0..3 {
                let row = R::load(at.add(b * lattice.stride[1])).mul(R::splat(s.w[1][b]));
                plane = plane.add(row);
                plane_y = row.mul_add(R::splat(s.delta[1][b]), plane_y);
            }
            let weighted = plane.mul(R::splat(s.w[0][a]));
            sum = sum.add(weighted);
            along_x = weighted.mul_add(R::splat(s.delta[0][a]), along_x);
            along_y = plane_y.mul_add(R::splat(s.w[0][a]), along_y);
        }
        let weight = R::nodes(s.w[2]);
        let sum = sum.mul(weight);
        let (x, y) = (along_x.mul(weight).fold(), along_y.mul(weight).fold());
        let z = sum.mul(R::nodes(s.delta[2])).fold();
        Gathered { sum: sum.fold(), moment: [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]] }
    }
}

/// Weights of a node row and how they change when the particle moves, for the rows of a stencil.
struct MovingWeights<T> {
    /// Times the weights along z: the row's weight.
    plain: T,
    /// Times the weights along z: its change by movement along x and y.
    across: T,
    /// Times the derivative of the weights along z.
    along: T,
}

impl<T: Number> Stencil<T> {
    #[inline(always)]
    fn moving(&self, a: usize, b: usize, dx: [T; 3]) -> MovingWeights<T> {
        let plain = self.w[0][a] * self.w[1][b];
        let across = self.dw[0][a] * dx[0] * self.w[1][b] + self.w[0][a] * (self.dw[1][b] * dx[1]);
        MovingWeights { plain, across, along: plain * dx[2] }
    }
}

/// Adds the tangent of what a particle scatters to a region of the grid that starts at plane `first_plane`:
/// `w (dq + dA δ) + dw (q + A δ)`, where the tangent's `dq` already holds `dq − A dx`.
///
/// # Safety
///
/// The machine must have the instruction set of `R`.
#[inline(always)]
pub(crate) unsafe fn push_tangent<T: Number, R: Row<T>>(
    lattice: &Lattice<T>,
    first_plane: usize,
    region: &mut [T],
    record: &Record<T>,
    tangent: &Record<T>,
) {
    let s = Stencil::new(lattice, first_plane, region.len() / lattice.stride[0], position(record));
    let dx = position(tangent);
    // SAFETY: as in `push`.
    unsafe {
        let delta_z = R::nodes(s.delta[2]);
        let [x1, y1, centre1] = columns::<T, R>(record, delta_z);
        let [x2, y2, centre2] = columns::<T, R>(tangent, delta_z);
        let (weight, slope) = (R::nodes(s.w[2]), R::nodes(s.dw[2]));
        for a in 0..3 {
            let delta = R::splat(s.delta[0][a]);
            let (plane1, plane2) = (x1.mul_add(delta, centre1), x2.mul_add(delta, centre2));
            for b in 0..3 {
                let at = region.as_mut_ptr().add(s.start + a * lattice.stride[0] + b * lattice.stride[1]);
                let delta = R::splat(s.delta[1][b]);
                let (value, change) = (y1.mul_add(delta, plane1), y2.mul_add(delta, plane2));
                let moving = s.moving(a, b, dx);
                let by_weight = change.mul(R::splat(moving.plain));
                let by_weight = value.mul_add(R::splat(moving.across), by_weight);
                let sum = by_weight.mul_add(weight, R::load(at));
                value.mul(R::splat(moving.along)).mul_add(slope, sum).store(at);
            }
        }
    }
}

/// The tangent of a gather at `x`, whose own tangent is `dx`: node values `grid` change by `tangents`.
///
/// # Safety
///
/// The machine must have the instruction set of `R`.
#[inline(always)]
pub(crate) unsafe fn gather_tangent<T: Number, R: Row<T>>(
    lattice: &Lattice<T>,
    grid: &[T],
    tangents: &[T],
    x: [T; 3],
    dx: [T; 3],
) -> Gathered<T> {
    let s = Stencil::new(lattice, 0, lattice.shape[0], x);
    // SAFETY: as in `push`; both grids have the lattice's shape.
    unsafe {
        let zero = R::splat(T::ZERO);
        let (weight, slope) = (R::nodes(s.w[2]), R::nodes(s.dw[2]));
        let (mut sum, mut along_x, mut along_y, mut velocity) = (zero, zero, zero, zero);
        for a in 0..3 {
            let step = a * lattice.stride[0] + s.start;
            for b in 0..3 {
                let at = step + b * lattice.stride[1];
                let (v, dv) = (R::load(grid.as_ptr().add(at)), R::load(tangents.as_ptr().add(at)));
                let moving = s.moving(a, b, dx);
                let by_weight = v.mul_add(R::splat(moving.across), dv.mul(R::splat(moving.plain)));
                let change = v.mul(R::splat(moving.along)).mul(slope);
                let change = by_weight.mul_add(weight, change);
                sum = sum.add(change);
                along_x = change.mul_add(R::splat(s.delta[0][a]), along_x);
                along_y = change.mul_add(R::splat(s.delta[1][b]), along_y);
                velocity = v.mul(R::splat(moving.plain)).mul_add(weight, velocity);
            }
        }
        let (x, y, z) = (along_x.fold(), along_y.fold(), sum.mul(R::nodes(s.delta[2])).fold());
        let (sum, velocity) = (sum.fold(), velocity.fold());
        let mut moment = [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]];
        for (k, moment) in moment.iter_mut().enumerate() {
            *moment -= velocity[k / 3] * dx[k % 3];
        }
        Gathered { sum, moment }
    }
}

/// The cotangents that reach a particle from the grid.
pub(crate) struct Pulled<T> {
    /// Cotangents of `q` and of the mass scattered.
    pub sum: [T; 4],
    /// Cotangent of `A`, row-major.
    pub moment: [T; 9],
    /// Cotangent of the position, from both transfers.
    pub position: [T; 3],
}

/// The adjoint of both transfers of one particle, as seen from the particle.
///
/// `scattered` is what it scattered and `cotangents` holds `[g_momentum, g_mass]` of the nodes; `gathered` is the record
/// that the adjoint of its gather scattered and `velocities` holds the node velocities it gathered. The position gets
///
/// `gx = Σ ∂w (g · [q + A δ, m] + v · (q′ + A′ δ)) − Aᵀ Σ w g − A′ᵀ Σ w v`
///
/// # Safety
///
/// The machine must have the instruction set of `R`.
#[inline(always)]
pub(crate) unsafe fn pull<T: Number, R: Row<T>>(
    lattice: &Lattice<T>,
    scattered: &Record<T>,
    cotangents: &[T],
    gathered: &Record<T>,
    velocities: &[T],
) -> Pulled<T> {
    let s = Stencil::new(lattice, 0, lattice.shape[0], position(scattered));
    // SAFETY: as in `push`; both grids have the lattice's shape.
    unsafe {
        let zero = R::splat(T::ZERO);
        let delta_z = R::nodes(s.delta[2]);
        let [x1, y1, centre1] = columns::<T, R>(scattered, delta_z);
        let [x2, y2, centre2] = columns::<T, R>(gathered, delta_z);
        let (mut sum, mut along_x, mut along_y, mut velocity) = (zero, zero, zero, zero);
        let (mut by_x, mut by_y, mut by_z) = (zero, zero, zero);
        for a in 0..3 {
            let step = a * lattice.stride[0] + s.start;
            let delta = R::splat(s.delta[0][a]);
            let (plane1, plane2) = (x1.mul_add(delta, centre1), x2.mul_add(delta, centre2));
            let (mut sum_a, mut along_y_a, mut velocity_a, mut by_y_a, mut by_z_a) = (zero, zero, zero, zero, zero);
            for b in 0..3 {
                let at = step + b * lattice.stride[1];
                let (g, v) = (R::load(cotangents.as_ptr().add(at)), R::load(velocities.as_ptr().add(at)));
                let (delta, w) = (R::splat(s.delta[1][b]), R::splat(s.w[1][b]));
                let work = y1.mul_add(delta, plane1).mul(g);
                let work = y2.mul_add(delta, plane2).mul_add(v, work);
                by_z_a = work.mul_add(w, by_z_a);
                by_y_a = work.mul_add(R::splat(s.dw[1][b]), by_y_a);
                let weighted = g.mul(w);
                sum_a = sum_a.add(weighted);
                along_y_a = weighted.mul_add(delta, along_y_a);
                velocity_a = v.mul_add(w, velocity_a);
            }
            let w = R::splat(s.w[0][a]);
            let weighted = sum_a.mul(w);
            sum = sum.add(weighted);
            along_x = weighted.mul_add(delta, along_x);
            along_y = along_y_a.mul_add(w, along_y);
            velocity = velocity_a.mul_add(w, velocity);
            by_x = by_z_a.mul_add(R::splat(s.dw[0][a]), by_x);
            by_y = by_y_a.mul_add(w, by_y);
            by_z = by_z_a.mul_add(w, by_z);
        }
        let weight = R::nodes(s.w[2]);
        let by_weights = [by_x.mul(weight).fold(), by_y.mul(weight).fold(), by_z.mul(R::nodes(s.dw[2])).fold()];
        let sum = sum.mul(weight);
        let (x, y, z) = (along_x.mul(weight).fold(), along_y.mul(weight).fold(), sum.mul(delta_z).fold());
        let (sum, velocity) = (sum.fold(), velocity.mul(weight).fold());
        let mut position = [T::ZERO; 3];
        for axis in 0..3 {
            let [a, b, c, d] = by_weights[axis];
            position[axis] = a + b + c + d;
            for row in 0..3 {
                let column = 4 + 4 * axis + row;
                position[axis] = position[axis] - scattered[column] * sum[row] - gathered[column] * velocity[row];
            }
        }
        Pulled { sum, moment: [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]], position }
    }
}

/// A record as rows: its first two columns, and `q + A δ` along z.
///
/// # Safety
///
/// As for [`pull`].
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
