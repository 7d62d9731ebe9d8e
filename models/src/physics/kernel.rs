//! The transfers over slabs and blocks, compiled once per instruction set and dispatched at run time.

use gradreel::scalar::Lanes;

use super::node_grid::NodeGrid;
use super::row::{Level, Number, Row};
use super::state::{BLOCK, C, V};
use super::stencil::{BATCH, Batch, Moved, Slopes, Stencils};
use super::transfer::{Gathered, Record, gather, gather_moving, positions, pull, push, push_tangent, record};

/// Declares a function whose body, generic over rows `R`, is dispatched to the best instruction set of the machine.
macro_rules! by_level {
    ($(#[$doc:meta])* fn $name:ident($($arg:ident: $type:ty),* $(,)?) $(-> $out:ty)? $body:block) => {
        $(#[$doc])*
        #[allow(clippy::too_many_arguments)] // plain data of one loop
        pub(crate) fn $name<T: Number>(level: Level, $($arg: $type),*) $(-> $out)? {
            #[inline(always)]
            #[allow(clippy::too_many_arguments)]
            unsafe fn body<T: Number, R: Row<T>>($($arg: $type),*) $(-> $out)? $body
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,fma")]
            #[allow(clippy::too_many_arguments)]
            unsafe fn wide<T: Number>($($arg: $type),*) $(-> $out)? {
                // SAFETY: the instruction set of the rows is enabled; bodies require nothing else.
                unsafe { body::<T, T::Wide>($($arg),*) }
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            #[allow(clippy::too_many_arguments)]
            unsafe fn middle<T: Number>($($arg: $type),*) $(-> $out)? {
                // SAFETY: as above.
                unsafe { body::<T, T::Middle>($($arg),*) }
            }
            // SAFETY: `Level` is only constructed for machines that support it, and bodies require nothing else.
            unsafe {
                match level {
                    #[cfg(target_arch = "x86_64")]
                    Level::Avx512 => wide($($arg),*),
                    #[cfg(target_arch = "x86_64")]
                    Level::Avx2 => middle($($arg),*),
                    _ => body::<T, T::Portable>($($arg),*),
                }
            }
        }
    };
}

/// The positions of `count` particles of a block from `first` on, padded to a batch with the last one.
#[inline(always)]
fn batch<T: Number>(block: &[T], first: usize, count: usize) -> [Batch<T>; 3] {
    let mut x = [[T::ZERO; BATCH]; 3];
    for axis in 0..3 {
        x[axis].copy_from_slice(&block[axis * BLOCK + first..][..BATCH]);
        for i in count..BATCH {
            x[axis][i] = x[axis][count - 1];
        }
    }
    x
}

/// Writes the gathered values of a batch to the arrays of its block from `first` on: sums (4 arrays) and moments (9
/// arrays, row by row).
///
/// # Safety
///
/// The machine must have the instruction set of `R`.
#[inline(always)]
unsafe fn spread<T: Number, R: Row<T>>(
    found: &[Gathered<T>; BATCH],
    [first, count]: [usize; 2],
    sums: &mut [T],
    moments: &mut [T],
) {
    let (sums, moments) = (&mut sums[..4 * BLOCK], &mut moments[..9 * BLOCK]);
    assert!(first + BATCH <= BLOCK, "a batch outside its block");
    if count < BATCH {
        for (i, found) in found[..count].iter().enumerate() {
            (0..4).for_each(|k| sums[k * BLOCK + first + i] = found[k]);
            (0..9).for_each(|k| moments[k * BLOCK + first + i] = found[4 + 4 * (k % 3) + k / 3]);
        }
        return;
    }
    let (sums, moments) = (sums.as_mut_ptr(), moments.as_mut_ptr());
    let mut nothing = [T::ZERO; 4];
    for (quad, four) in found.as_chunks::<4>().0.iter().enumerate() {
        let at = first + 4 * quad;
        // SAFETY: the batch lies within the arrays, whose lengths were fixed above; a record holds four times four
        // values.
        unsafe {
            let from = |part: usize| [0, 1, 2, 3].map(|i| four[i].as_ptr().add(4 * part));
            R::turn(from(0), [0, 1, 2, 3].map(|k| sums.add(k * BLOCK + at)));
            for column in 0..3 {
                let to = |row: usize| moments.add((3 * row + column) * BLOCK + at);
                R::turn(from(1 + column), [to(0), to(1), to(2), nothing.as_mut_ptr()]);
            }
        }
    }
}

/// Gathers from a grid for the first `len` particles of a block: sums (4 arrays) and moments (9 arrays, row by row).
///
/// # Safety
///
/// The machine must have the instruction set of `R`.
#[inline(always)]
unsafe fn gather_all<T: Number, R: Row<T>>(
    node_grid: &NodeGrid<T>,
    grid: &[T],
    now: &[T],
    len: usize,
    sums: &mut [T],
    moments: &mut [T],
) {
    node_grid.check_whole(grid);
    let mut found = [[T::ZERO; 16]; BATCH];
    for first in (0..len).step_by(BATCH) {
        let count = (len - first).min(BATCH);
        let s = Stencils::new(node_grid, 0, node_grid.shape[0], &batch(now, first, count));
        for i in 0..count {
            // SAFETY: guaranteed by the caller; the grid is complete, and the stencils were made for it.
            found[i] = unsafe { gather::<T, R>(node_grid, &s, i, grid) };
        }
        // SAFETY: guaranteed by the caller.
        unsafe { spread::<T, R>(&found, [first, count], sums, moments) };
    }
}

by_level! {
    /// Assembles the records of a block's particles: positions `x` (3 arrays), `q` and mass (4 arrays), and `A` (9
    /// arrays, row by row).
    fn assemble(
        x: &[T],
        q: &[T],
        a: &[T],
        records: &mut [Record<T>],
    ) {
        let (x, q, a) = (&x[..3 * BLOCK], &q[..4 * BLOCK], &a[..9 * BLOCK]);
        assert!(records.len() <= BLOCK, "more records than a block has particles");
        let (fours, rest) = records.as_chunks_mut::<4>();
        for (quad, four) in fours.iter_mut().enumerate() {
            let at = 4 * quad;
            // SAFETY: there are at most as many particles as values per array; a record holds four times four values.
            unsafe {
                let [r0, r1, r2, r3] = four.each_mut().map(|record| record.as_mut_ptr());
                let to = |part: usize| [r0.add(4 * part), r1.add(4 * part), r2.add(4 * part), r3.add(4 * part)];
                R::turn([0, 1, 2, 3].map(|k| q.as_ptr().add(k * BLOCK + at)), to(0));
                for column in 0..3 {
                    let from = |row: usize| a.as_ptr().add((3 * row + column) * BLOCK + at);
                    R::turn([from(0), from(1), from(2), x.as_ptr().add(column * BLOCK + at)], to(1 + column));
                }
            }
        }
        let first = 4 * fours.len();
        for (i, out) in (first..).zip(rest) {
            let [qx, qy, qz, m] = [0, 1, 2, 3].map(|k| q[k * BLOCK + i]);
            let x = [0, 1, 2].map(|axis| x[axis * BLOCK + i]);
            *out = record(x, [qx, qy, qz], m, std::array::from_fn(|k| a[k * BLOCK + i]));
        }
    }
}

by_level! {
    /// The momenta and masses (4 arrays) of a block's particles, from their velocities (3 arrays).
    fn momenta(
        masses: Lanes<'_, T>,
        velocities: &[T],
        len: usize,
        out: &mut [T],
    ) {
        let len = len.min(BLOCK);
        let (q, m) = out[..4 * BLOCK].split_at_mut(3 * BLOCK);
        match masses {
            Lanes::Same(mass) => m[..len].fill(mass),
            Lanes::Each(masses) => m[..len].copy_from_slice(&masses[..len]),
        }
        for axis in 0..3 {
            let (q, v) = (&mut q[axis * BLOCK..][..len], &velocities[axis * BLOCK..][..len]);
            for i in 0..len {
                q[i] = m[i] * v[i];
            }
        }
    }
}

by_level! {
    /// Scatters the records listed in `order` into a region of node planes that starts at `first_plane`.
    fn scatter(
        node_grid: &NodeGrid<T>,
        first_plane: usize,
        region: &mut [T],
        records: &[Record<T>],
        order: &[u32],
    ) {
        let planes = region.len() / node_grid.stride[0];
        for order in order.chunks(BATCH) {
            let of = |i: usize| &records[order[i] as usize];
            let s = Stencils::new(node_grid, first_plane, planes, &positions(order.len(), of));
            for i in 0..order.len().min(BATCH) {
                // SAFETY: the instruction set is available, and the stencils were made for the region's planes.
                unsafe { push::<T, R>(node_grid, &s, i, region, of(i)) };
            }
        }
    }
}

by_level! {
    /// Scatters the tangents of the records listed in `order`; see [`push_tangent`].
    fn scatter_tangent(
        node_grid: &NodeGrid<T>,
        first_plane: usize,
        region: &mut [T],
        records: &[Record<T>],
        tangents: &[Record<T>],
        order: &[u32],
    ) {
        let planes = region.len() / node_grid.stride[0];
        for order in order.chunks(BATCH) {
            let (of, along) = (|i: usize| &records[order[i] as usize], |i: usize| &tangents[order[i] as usize]);
            let x = positions(order.len(), of);
            let (s, dw) = (Stencils::new(node_grid, first_plane, planes, &x), Slopes::new(node_grid, &x));
            let moved = Moved::new(&s, &dw, &positions(order.len(), along));
            for i in 0..order.len().min(BATCH) {
                // SAFETY: as in `scatter`.
                unsafe { push_tangent::<T, R>(node_grid, (&s, &dw, &moved), i, region, of(i), along(i)) };
            }
        }
    }
}

/// Number of arrays that [`moving`] writes.
pub(crate) const MOVING: usize = 4 + 3 * SLOPES;

/// Arrays per axis: sums (4 arrays) and moments (9 arrays, row by row).
const SLOPES: usize = 13;

by_level! {
    /// Gathers for the first `len` particles of a block (4 arrays), with the derivatives with respect to their
    /// positions ([`SLOPES`] arrays per axis); see [`gather_moving`].
    fn moving(
        node_grid: &NodeGrid<T>,
        grid: &[T],
        now: &[T],
        len: usize,
        out: &mut [T],
    ) {
        let len = len.min(BLOCK);
        node_grid.check_whole(grid);
        let (still, slopes) = out[..MOVING * BLOCK].split_at_mut(4 * BLOCK);
        let mut found = [[[T::ZERO; 16]; BATCH]; 3];
        for first in (0..len).step_by(BATCH) {
            let count = (len - first).min(BATCH);
            let x = batch(now, first, count);
            let (s, dw) = (Stencils::new(node_grid, 0, node_grid.shape[0], &x), Slopes::new(node_grid, &x));
            for i in 0..count {
                // SAFETY: the instruction set is available, and the grid is complete.
                let of = unsafe { gather_moving::<T, R>(node_grid, (&s, &dw), i, grid) };
                (0..4).for_each(|k| still[k * BLOCK + first + i] = of.sum[k]);
                (0..3).for_each(|axis| found[axis][i] = of.along[axis]);
            }
            for (found, slopes) in found.iter().zip(slopes.chunks_exact_mut(SLOPES * BLOCK)) {
                let (sums, moments) = slopes.split_at_mut(4 * BLOCK);
                // SAFETY: the instruction set is available.
                unsafe { spread::<T, R>(found, [first, count], sums, moments) };
            }
        }
    }
}

by_level! {
    /// The jvp of a block's gather and advection. Reads the positions of `now` and the output of [`moving`]; advances
    /// the positions, velocities and affine velocities of `tangent` to the end of the substep.
    fn advance_tangent(
        node_grid: &NodeGrid<T>,
        tangents: &[T],
        moving: &[T],
        dt: T,
        now: &[T],
        len: usize,
        tangent: &mut [T],
    ) {
        let len = len.min(BLOCK);
        let (moved, affine) = tangent[..(C + 9) * BLOCK].split_at_mut(C * BLOCK);
        let (dx, dv) = moved.split_at_mut(V * BLOCK);
        let mut sums = [T::ZERO; 4 * BLOCK];
        // SAFETY: the instruction set is available.
        unsafe { gather_all::<T, R>(node_grid, tangents, now, len, &mut sums, affine) };
        let (still, slopes) = moving[..MOVING * BLOCK].split_at(4 * BLOCK);
        for (axis, slopes) in slopes.chunks_exact(SLOPES * BLOCK).enumerate() {
            let dx = &dx[axis * BLOCK..][..len];
            for k in 0..3 {
                add_products(&mut sums[k * BLOCK..][..len], dx, &slopes[k * BLOCK..][..len], T::ONE);
                let moment = &mut affine[(3 * k + axis) * BLOCK..][..len];
                add_products(moment, dx, &still[k * BLOCK..][..len], -T::ONE);
            }
            for k in 0..9 {
                add_products(&mut affine[k * BLOCK..][..len], dx, &slopes[(4 + k) * BLOCK..][..len], T::ONE);
            }
        }
        for axis in 0..3 {
            let at = axis * BLOCK..axis * BLOCK + len;
            dv[at.clone()].copy_from_slice(&sums[at.clone()]);
            dx[at.clone()].iter_mut().zip(&sums[at]).for_each(|(dx, dv)| *dx += dt * *dv);
        }
        scale(affine, T::from_f64(4.0) * node_grid.inverse_dx * node_grid.inverse_dx);
    }
}

/// `to += sign a b`, elementwise.
#[inline(always)]
fn add_products<T: Number>(to: &mut [T], a: &[T], b: &[T], sign: T) {
    for ((to, a), b) in to.iter_mut().zip(a).zip(b) {
        *to += sign * *a * *b;
    }
}

#[inline(always)]
fn scale<T: Number>(numbers: &mut [T], factor: T) {
    for number in numbers {
        *number *= factor;
    }
}

by_level! {
    /// Gathers node values for the first `len` particles of a block: three arrays, and one unused.
    fn interpolate(
        node_grid: &NodeGrid<T>,
        grid: &[T],
        now: &[T],
        len: usize,
        out: &mut [T],
    ) {
        let len = len.min(BLOCK);
        // SAFETY: the instruction set is available.
        unsafe { gather_all::<T, R>(node_grid, grid, now, len, out, &mut [T::ZERO; 9 * BLOCK]) };
    }
}

by_level! {
    /// The jvp of [`interpolate`]; reads the output of [`moving`] and the positions of `now` and `tangent`.
    fn interpolate_tangent(
        node_grid: &NodeGrid<T>,
        tangents: &[T],
        moving: &[T],
        now: &[T],
        tangent: &[T],
        len: usize,
        out: &mut [T],
    ) {
        let len = len.min(BLOCK);
        // SAFETY: the instruction set is available.
        unsafe { gather_all::<T, R>(node_grid, tangents, now, len, out, &mut [T::ZERO; 9 * BLOCK]) };
        for (axis, slopes) in moving[4 * BLOCK..MOVING * BLOCK].chunks_exact(SLOPES * BLOCK).enumerate() {
            let dx = &tangent[axis * BLOCK..][..len];
            for k in 0..3 {
                add_products(&mut out[k * BLOCK..][..len], dx, &slopes[k * BLOCK..][..len], T::ONE);
            }
        }
    }
}

/// The result of advancing a block of particles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion<T> {
    /// Bounds of the new coordinates \[m\].
    pub extent: [[T; 3]; 2],
    /// The first particle that broke a limit.
    pub broken: Option<usize>,
}

/// Limits on the motion of a particle in one substep.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits<T> {
    /// Substep \[s\].
    pub dt: T,
    /// Largest velocity component \[m/s\].
    pub speed: T,
    /// Bounds of allowed positions \[m\].
    pub bounds: [[T; 3]; 2],
}

/// The minimum and maximum of some numbers, by sixteen interleaved partial reductions.
#[inline(always)]
fn extent<T: Number>(numbers: &[T]) -> [T; 2] {
    let least = |a: T, b: T| if b < a { b } else { a };
    let most = |a: T, b: T| if b > a { b } else { a };
    let mut extents = [[T::INFINITY; BATCH], [-T::INFINITY; BATCH]];
    let (batches, rest) = numbers.as_chunks::<BATCH>();
    for batch in batches {
        for i in 0..BATCH {
            extents[0][i] = least(extents[0][i], batch[i]);
            extents[1][i] = most(extents[1][i], batch[i]);
        }
    }
    let [low, high] = extents;
    let all = |values: [T; BATCH]| values.into_iter().chain(rest.iter().copied());
    [all(low).fold(T::INFINITY, least), all(high).fold(-T::INFINITY, most)]
}

by_level! {
    /// Gathers velocity and affine velocity of the first `len` particles of a block and moves them.
    fn advance(
        node_grid: &NodeGrid<T>,
        grid: &[T],
        limits: &Limits<T>,
        now: &[T],
        len: usize,
        next: &mut [T],
    ) -> Motion<T> {
        let len = len.min(BLOCK);
        let (moved, affine) = next[..(C + 9) * BLOCK].split_at_mut(C * BLOCK);
        let mut sums = [T::ZERO; 4 * BLOCK];
        // SAFETY: the instruction set is available.
        unsafe { gather_all::<T, R>(node_grid, grid, now, len, &mut sums, affine) };
        scale(affine, T::from_f64(4.0) * node_grid.inverse_dx * node_grid.inverse_dx);
        // One array at a time, so that compilers vectorise the loop.
        let mut motion = Motion { extent: [[T::INFINITY; 3], [-T::INFINITY; 3]], broken: None };
        let mut broken = [false; BLOCK];
        let (x_next, v_next) = moved.split_at_mut(V * BLOCK);
        for axis in 0..3 {
            let (x, v) = (&now[axis * BLOCK..][..len], &sums[axis * BLOCK..][..len]);
            v_next[axis * BLOCK..][..len].copy_from_slice(v);
            let x_next = &mut x_next[axis * BLOCK..][..len];
            let [low, high] = [limits.bounds[0][axis], limits.bounds[1][axis]];
            for i in 0..len {
                let moved = x[i] + limits.dt * v[i];
                x_next[i] = moved;
                // The comparison fails for NaN, which must break the limits.
                let sound = (v[i].abs() <= limits.speed) & (moved >= low) & (moved <= high);
                broken[i] |= !sound;
            }
            [motion.extent[0][axis], motion.extent[1][axis]] = extent(x_next);
        }
        motion.broken = broken[..len].iter().position(|&broken| broken);
        motion
    }
}

by_level! {
    /// Gathers the cotangents of a block from the grid.
    ///
    /// `cotangent` holds the block's cotangent at the end of the substep; its position and velocity parts become those
    /// at the start. `affine` receives the cotangent of the scattered affine matrix (9 arrays); that of the mass is
    /// added to `mass`.
    fn collect(
        node_grid: &NodeGrid<T>,
        cotangents: &[T],
        velocities: &[T],
        scattered: &[Record<T>],
        gathered: &[Record<T>],
        now: &[T],
        cotangent: &mut [T],
        affine: &mut [T],
        mass: &mut [T],
    ) {
        let len = scattered.len().min(BLOCK);
        let (mut sums, mut masses) = ([T::ZERO; 4 * BLOCK], [T::ZERO; BLOCK]);
        let (on_x, on_v) = cotangent[..C * BLOCK].split_at_mut(V * BLOCK);
        let grids = [cotangents, velocities];
        // SAFETY: the instruction set is available.
        unsafe { pull_all::<T, R>(node_grid, grids, [scattered, gathered], on_x, &mut sums, affine) };
        masses.iter_mut().zip(scattered).for_each(|(mass, record)| *mass = record[3]);
        for i in 0..len {
            mass[i] += sums[3 * BLOCK + i];
        }
        for axis in 0..3 {
            let (sums, on_v) = (&sums[axis * BLOCK..][..len], &mut on_v[axis * BLOCK..][..len]);
            let v = &now[(V + axis) * BLOCK..][..len];
            for i in 0..len {
                on_v[i] = masses[i] * sums[i];
                mass[i] += v[i] * sums[i];
            }
        }
    }
}

/// The adjoint of the transfers of a block: adds to the cotangents of positions (3 arrays), and writes those of the
/// scattered records to `sums` (4 arrays) and `affine` (9 arrays).
///
/// # Safety
///
/// The machine must have the instruction set of `R`.
#[inline(always)]
unsafe fn pull_all<T: Number, R: Row<T>>(
    node_grid: &NodeGrid<T>,
    grids: [&[T]; 2],
    [scattered, gathered]: [&[Record<T>]; 2],
    on_x: &mut [T],
    sums: &mut [T],
    affine: &mut [T],
) {
    let len = scattered.len().min(gathered.len()).min(BLOCK);
    grids.iter().for_each(|grid| node_grid.check_whole(grid));
    let mut found = [[T::ZERO; 16]; BATCH];
    for first in (0..len).step_by(BATCH) {
        let count = (len - first).min(BATCH);
        let x = positions(count, |i| &scattered[first + i]);
        let (s, dw) = (Stencils::new(node_grid, 0, node_grid.shape[0], &x), Slopes::new(node_grid, &x));
        for i in 0..count {
            let records = [&scattered[first + i], &gathered[first + i]];
            // SAFETY: guaranteed by the caller; both grids are complete, and the stencils were made for them.
            let pulled = unsafe { pull::<T, R>(node_grid, (&s, &dw), i, grids, records) };
            (0..3).for_each(|axis| on_x[axis * BLOCK + first + i] += pulled.position[axis]);
            found[i] = pulled.record;
        }
        // SAFETY: guaranteed by the caller.
        unsafe { spread::<T, R>(&found, [first, count], sums, affine) };
    }
}

by_level! {
    /// [`collect`] for a scatter without mass: adds to the positions of `cotangent`, writes the cotangents of the
    /// scattered records to `affine` (9 arrays) and `sums` (3 arrays and one unused).
    fn collect_old(
        node_grid: &NodeGrid<T>,
        cotangents: &[T],
        velocities: &[T],
        scattered: &[Record<T>],
        gathered: &[Record<T>],
        cotangent: &mut [T],
        affine: &mut [T],
        sums: &mut [T],
    ) {
        let on_x = &mut cotangent[..V * BLOCK];
        // SAFETY: the instruction set is available.
        unsafe { pull_all::<T, R>(node_grid, [cotangents, velocities], [scattered, gathered], on_x, sums, affine) };
    }
}
