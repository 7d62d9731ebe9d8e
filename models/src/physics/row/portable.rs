//! Rows as plain arrays: portable, and vectorised by the compiler as far as the target allows.

use super::{Row, Rows};
use gradreel::scalar::Real;

#[cfg(not(target_arch = "x86_64"))]
impl Rows for f32 {
    type Wide = [f32; 12];
    type Middle = [f32; 12];
    type Portable = [f32; 12];
}

#[cfg(not(target_arch = "x86_64"))]
impl Rows for f64 {
    type Wide = [f64; 12];
    type Middle = [f64; 12];
    type Portable = [f64; 12];
}

#[cfg(target_arch = "x86_64")]
impl Rows for f32 {
    type Wide = core::arch::x86_64::__m512;
    type Middle = super::x86::Middle32;
    type Portable = [f32; 12];
}

#[cfg(target_arch = "x86_64")]
impl Rows for f64 {
    type Wide = super::x86::Wide64;
    type Middle = super::x86::Middle64;
    type Portable = [f64; 12];
}

impl<T: Real> Row<T> for [T; 12] {
    #[inline(always)]
    unsafe fn load(from: *const T) -> Self {
        // SAFETY: the contract of `Row`: pointers are valid.
        unsafe { from.cast::<[T; 12]>().read() }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut T) {
        // SAFETY: the contract of `Row`: pointers are valid.
        unsafe { to.cast::<[T; 12]>().write(self) }
    }

    #[inline(always)]
    unsafe fn splat(value: T) -> Self {
        [value; 12]
    }

    #[inline(always)]
    unsafe fn nodes([a, b, c]: [T; 3]) -> Self {
        [a, a, a, a, b, b, b, b, c, c, c, c]
    }

    #[inline(always)]
    unsafe fn repeat(from: *const T) -> Self {
        // SAFETY: the contract of `Row`: pointers are valid.
        let [x, y, z, w] = unsafe { from.cast::<[T; 4]>().read() };
        [x, y, z, w, x, y, z, w, x, y, z, w]
    }

    #[inline(always)]
    unsafe fn without_mass(mut self) -> Self {
        for node in 0..3 {
            self[4 * node + 3] = T::from_f64(0.0);
        }
        self
    }

    #[inline(always)]
    unsafe fn add(mut self, other: Self) -> Self {
        for i in 0..12 {
            self[i] += other[i];
        }
        self
    }

    #[inline(always)]
    unsafe fn mul(mut self, other: Self) -> Self {
        for i in 0..12 {
            self[i] *= other[i];
        }
        self
    }

    #[inline(always)]
    unsafe fn mul_add(mut self, factor: Self, addend: Self) -> Self {
        for i in 0..12 {
            self[i] = self[i] * factor[i] + addend[i];
        }
        self
    }

    #[inline(always)]
    unsafe fn fold(rows: [Self; 4]) -> [T; 16] {
        std::array::from_fn(|k| {
            let row = &rows[k / 4];
            row[k % 4] + row[4 + k % 4] + row[8 + k % 4]
        })
    }

    #[inline(always)]
    unsafe fn turn(from: [*const T; 4], to: [*mut T; 4]) {
        // SAFETY: the contract of `Row`: pointers are valid.
        let square = from.map(|row| unsafe { row.cast::<[T; 4]>().read() });
        for (c, to) in to.into_iter().enumerate() {
            // SAFETY: the contract of `Row`: pointers are valid.
            unsafe { to.cast::<[T; 4]>().write([square[0][c], square[1][c], square[2][c], square[3][c]]) }
        }
    }
}
