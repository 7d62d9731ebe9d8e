//! The transfers over whole slabs and blocks, compiled once per instruction set and chosen at run time.

use super::lattice::Lattice;
use super::row::{Level, Number, Row};
use super::state::{BLOCK, C, V};
use super::transfer::{Record, gather, gather_tangent, pull, push, push_tangent};

/// Declares a function whose body, over rows of type `R`, runs with the best rows of this machine.
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
                unsafe { body::<T, T::Wide>($($arg),*) }
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            #[allow(clippy::too_many_arguments)]
            unsafe fn middle<T: Number>($($arg: $type),*) $(-> $out)? {
                unsafe { body::<T, T::Middle>($($arg),*) }
            }
            // SAFETY: `Level` is only made for machines that have it.
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

by_level! {
    /// Scatters the records listed in `order` into a region of node planes that starts at `first_plane`.
    fn scatter(
        lattice: &Lattice<T>,
        first_plane: usize,
        region: &mut [T],
        records: &[Record<T>],
        order: &[u32],
    ) {
        for &particle in order {
            unsafe { push::<T, R>(lattice, first_plane, region, &records[particle as usize]) };
        }
    }
}

by_level! {
    /// Scatters the tangents of the records listed in `order`; see [`push_tangent`].
    fn scatter_tangent(
        lattice: &Lattice<T>,
        first_plane: usize,
        region: &mut [T],
        records: &[Record<T>],
        tangents: &[Record<T>],
        order: &[u32],
    ) {
        for &particle in order {
            let (record, tangent) = (&records[particle as usize], &tangents[particle as usize]);
            unsafe { push_tangent::<T, R>(lattice, first_plane, region, record, tangent) };
        }
    }
}

by_level! {
    /// The tangent of a block's gather and motion: reads positions of `now`, and turns the positions, velocities and affine
    /// velocities of `tangent` from those before the substep into those after it.
    fn advance_tangent(
        lattice: &Lattice<T>,
        grid: &[T],
        tangents: &[T],
        dt: T,
        now: &[T],
        len: usize,
        tangent: &mut [T],
    ) {
        let len = len.min(BLOCK);
        let (now, tangent) = (&now[..V * BLOCK], &mut tangent[..(C + 9) * BLOCK]);
        let four = T::from_f64(4.0) * lattice.inverse_dx * lattice.inverse_dx;
        for i in 0..len {
            let x = [now[i], now[BLOCK + i], now[2 * BLOCK + i]];
            let dx = [tangent[i], tangent[BLOCK + i], tangent[2 * BLOCK + i]];
            let found = unsafe { gather_tangent::<T, R>(lattice, grid, tangents, x, dx) };
            for axis in 0..3 {
                tangent[(V + axis) * BLOCK + i] = found.sum[axis];
                tangent[axis * BLOCK + i] = dx[axis] + dt * found.sum[axis];
            }
            for k in 0..9 {
                tangent[(C + k) * BLOCK + i] = four * found.moment[k];
            }
        }
    }
}

by_level! {
    /// What the first `len` particles of a block gather from a grid: three arrays.
    fn interpolate(
        lattice: &Lattice<T>,
        grid: &[T],
        now: &[T],
        len: usize,
        out: &mut [T],
    ) {
        let (now, out) = (&now[..V * BLOCK], &mut out[..3 * BLOCK]);
        for i in 0..len.min(BLOCK) {
            let found = unsafe { gather::<T, R>(lattice, grid, [now[i], now[BLOCK + i], now[2 * BLOCK + i]]) };
            (0..3).for_each(|axis| out[axis * BLOCK + i] = found.sum[axis]);
        }
    }
}

by_level! {
    /// The tangent of [`interpolate`]; reads the positions of `now` and `tangent`.
    fn interpolate_tangent(
        lattice: &Lattice<T>,
        grid: &[T],
        tangents: &[T],
        now: &[T],
        tangent: &[T],
        len: usize,
        out: &mut [T],
    ) {
        let (now, tangent, out) = (&now[..V * BLOCK], &tangent[..V * BLOCK], &mut out[..3 * BLOCK]);
        for i in 0..len.min(BLOCK) {
            let at = |array: &[T]| [array[i], array[BLOCK + i], array[2 * BLOCK + i]];
            let found = unsafe { gather_tangent::<T, R>(lattice, grid, tangents, at(now), at(tangent)) };
            (0..3).for_each(|axis| out[axis * BLOCK + i] = found.sum[axis]);
        }
    }
}

/// How a block of particles has moved.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion<T> {
    /// Lowest and highest new coordinates \[m\].
    pub extent: [[T; 3]; 2],
    /// The first particle that broke a limit.
    pub broken: Option<usize>,
}

/// What a particle may do in one substep.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits<T> {
    /// Substep \[s\].
    pub dt: T,
    /// Largest velocity component \[m/s\].
    pub speed: T,
    /// Where positions may lie \[m\].
    pub bounds: [[T; 3]; 2],
}

by_level! {
    /// Gathers velocity and affine velocity of the first `len` particles of a block and moves them.
    fn advance(
        lattice: &Lattice<T>,
        grid: &[T],
        limits: &Limits<T>,
        now: &[T],
        len: usize,
        next: &mut [T],
    ) -> Motion<T> {
        let len = len.min(BLOCK);
        let (now, next) = (&now[..C * BLOCK], &mut next[..(C + 9) * BLOCK]);
        let four = T::from_f64(4.0) * lattice.inverse_dx * lattice.inverse_dx;
        for i in 0..len {
            let found = unsafe { gather::<T, R>(lattice, grid, [now[i], now[BLOCK + i], now[2 * BLOCK + i]]) };
            for axis in 0..3 {
                next[(V + axis) * BLOCK + i] = found.sum[axis];
            }
            for k in 0..9 {
                next[(C + k) * BLOCK + i] = four * found.moment[k];
            }
        }
        // The rest array by array, which compilers vectorise.
        let mut motion = Motion { extent: [[T::INFINITY; 3], [-T::INFINITY; 3]], broken: None };
        let mut broken = [false; BLOCK];
        let (x_next, v_next) = next.split_at_mut(V * BLOCK);
        for axis in 0..3 {
            let (x, v) = (&now[axis * BLOCK..][..len], &v_next[axis * BLOCK..][..len]);
            let x_next = &mut x_next[axis * BLOCK..][..len];
            let [low, high] = [limits.bounds[0][axis], limits.bounds[1][axis]];
            let (mut least, mut most) = (T::INFINITY, -T::INFINITY);
            for i in 0..len {
                let moved = x[i] + limits.dt * v[i];
                x_next[i] = moved;
                least = if moved < least { moved } else { least };
                most = if moved > most { moved } else { most };
                // Written so that NaN breaks the limits.
                let sound = (v[i].abs() <= limits.speed) & (moved >= low) & (moved <= high);
                broken[i] |= !sound;
            }
            motion.extent[0][axis] = least;
            motion.extent[1][axis] = most;
        }
        motion.broken = broken[..len].iter().position(|&broken| broken);
        motion
    }
}

by_level! {
    /// Gathers the cotangents that reach a block from the grid.
    ///
    /// `cotangent` is the block's cotangent at the end of the substep and becomes, in its position and velocity, that at
    /// the start. `affine` receives the cotangent of what was scattered (9 arrays), `mass` adds that of the mass.
    fn collect(
        lattice: &Lattice<T>,
        cotangents: &[T],
        velocities: &[T],
        scattered: &[Record<T>],
        gathered: &[Record<T>],
        now: &[T],
        cotangent: &mut [T],
        affine: &mut [T],
        mass: &mut [T],
    ) {
        let (now, cotangent, affine) = (&now[..C * BLOCK], &mut cotangent[..C * BLOCK], &mut affine[..9 * BLOCK]);
        for (i, (scattered, gathered)) in scattered.iter().zip(gathered).enumerate().take(BLOCK) {
            let found = unsafe { pull::<T, R>(lattice, scattered, cotangents, gathered, velocities) };
            let mut on_mass = mass[i] + found.sum[3];
            for axis in 0..3 {
                let at = axis * BLOCK + i;
                cotangent[at] += found.position[axis];
                cotangent[(V + axis) * BLOCK + i] = scattered[3] * found.sum[axis];
                on_mass += now[(V + axis) * BLOCK + i] * found.sum[axis];
            }
            for k in 0..9 {
                affine[k * BLOCK + i] = found.moment[k];
            }
            mass[i] = on_mass;
        }
    }
}

by_level! {
    /// As [`collect`], for a scatter that carries no mass: adds to the positions of `cotangent`, writes the cotangents of
    /// what was scattered to `affine` (9 arrays) and `sums` (3 arrays).
    fn collect_old(
        lattice: &Lattice<T>,
        cotangents: &[T],
        velocities: &[T],
        scattered: &[Record<T>],
        gathered: &[Record<T>],
        cotangent: &mut [T],
        affine: &mut [T],
        sums: &mut [T],
    ) {
        let (cotangent, affine, sums) = (&mut cotangent[..V * BLOCK], &mut affine[..9 * BLOCK], &mut sums[..3 * BLOCK]);
        for (i, (scattered, gathered)) in scattered.iter().zip(gathered).enumerate().take(BLOCK) {
            let found = unsafe { pull::<T, R>(lattice, scattered, cotangents, gathered, velocities) };
            for axis in 0..3 {
                cotangent[axis * BLOCK + i] += found.position[axis];
                sums[axis * BLOCK + i] = found.sum[axis];
            }
            for k in 0..9 {
                affine[k * BLOCK + i] = found.moment[k];
            }
        }
    }
}
