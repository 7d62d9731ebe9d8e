//! A *row*: three neighbouring grid nodes along z, twelve values, the unit in which the transfers access the grid.
//!
//! A node holds four consecutive values such as `[vx, vy, vz, mass]`, and z is the fastest axis; the three nodes that a
//! quadratic B-spline covers along z are therefore twelve consecutive values, and the 27 nodes around a particle are
//! nine rows. A row is one AVX-512 register in `f32`; other machines use two or three registers, or a plain array. The
//! transfers are written once over [`Row`] and instantiated per instruction set; [`Level::detect`] chooses at run time,
//! so that a program built for the oldest x86-64 still uses the fast path.

mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

use gradreel::scalar::{Path, Real};

/// A float for which the transfers are instantiated: `f32` or `f64`, with its row types.
pub trait Number: Real + Rows {
    /// Upper bound of the magnitude of values that [`Number::split`] accepts.
    const SPLITTABLE: f64;

    /// The floor, as an integer and as a float. Undefined beyond [`Number::SPLITTABLE`].
    fn split(self) -> (i32, Self);
}

/// Adding 1.5 · 2^(mantissa bits) moves the nearest integer to the lowest bits, without conversion or branch.
macro_rules! number {
    ($float:ident, $mantissa:literal) => {
        impl Number for $float {
            const SPLITTABLE: f64 = (1_u64 << if $mantissa < 32 { $mantissa - 2 } else { 29 }) as f64;

            #[inline(always)]
            fn split(self) -> (i32, Self) {
                const SHIFT: $float = 1.5 * (1_u64 << $mantissa) as $float;
                let shifted = self + SHIFT;
                let nearest = shifted - SHIFT;
                let above = nearest > self;
                let integer = shifted.to_bits().wrapping_sub(SHIFT.to_bits()) as i32 - i32::from(above);
                (integer, nearest - if above { 1.0 } else { 0.0 })
            }
        }
    };
}

number!(f32, 23);
number!(f64, 52);

/// The row types of a float, one per instruction set.
pub trait Rows: Sized {
    /// The row used with AVX-512.
    type Wide: Row<Self>;
    /// The row used with AVX2 and FMA.
    type Middle: Row<Self>;
    /// The row used everywhere else.
    type Portable: Row<Self>;
}

/// Twelve values: three nodes of four values each.
///
/// An implementation may carry a fourth node (as an AVX-512 register does). [`Row::load`] may then read it and
/// [`Row::store`] may write it back, unchanged up to the addition of zeros.
///
/// # Safety
///
/// The machine must support the instruction set of the implementation, for all functions. Pointers must be valid for 16
/// values.
#[allow(clippy::missing_safety_doc)] // said once, above
pub trait Row<T>: Copy {
    /// Reads a row.
    unsafe fn load(from: *const T) -> Self;
    /// Writes a row.
    unsafe fn store(self, to: *mut T);
    /// The same value everywhere.
    unsafe fn splat(value: T) -> Self;
    /// One value per node, zero in a fourth node.
    unsafe fn nodes(values: [T; 3]) -> Self;
    /// The four values read from a pointer, once per node.
    unsafe fn repeat(from: *const T) -> Self;
    /// Zero in the fourth value of every node, unchanged elsewhere.
    unsafe fn without_mass(self) -> Self;
    /// `self + other`
    unsafe fn add(self, other: Self) -> Self;
    /// `self · other`
    unsafe fn mul(self, other: Self) -> Self;
    /// `self · factor + addend`
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// The sums over the three nodes of four rows, concatenated.
    unsafe fn fold(rows: [Self; 4]) -> [T; 16];
    /// Transposes four rows of four values: `to[c][r] = from[r][c]`. Pointers must be valid for 4 values.
    unsafe fn turn(from: [*const T; 4], to: [*mut T; 4]);
}

/// An instruction set the transfers are compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
pub enum Level {
    /// AVX-512 F, VL and DQ.
    Avx512,
    /// AVX2 and FMA.
    Avx2,
    /// The baseline of the target.
    Portable,
}

impl Level {
    /// The best level that the selected instruction set allows ([`Path::best`]).
    pub fn detect() -> Self {
        Self::of(Path::best())
    }

    /// The best level that a path allows and the processor supports: AVX-512 needs more extensions here than in
    /// [`Path`].
    fn of(path: Path) -> Self {
        match path {
            #[cfg(target_arch = "x86_64")]
            Path::Avx512
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && Path::available().any(|path| path == Path::Avx2) =>
            {
                Self::Avx512
            }
            #[cfg(target_arch = "x86_64")]
            Path::Avx2 | Path::Avx512 if Path::available().any(|path| path == Path::Avx2) => Self::Avx2,
            _ => Self::Portable,
        }
    }

    /// All levels this machine can run, best first.
    #[cfg(test)]
    pub fn available() -> Vec<Self> {
        match Self::of(Path::available().next_back().unwrap_or(Path::Portable)) {
            Self::Avx512 => vec![Self::Avx512, Self::Avx2, Self::Portable],
            Self::Avx2 => vec![Self::Avx2, Self::Portable],
            Self::Portable => vec![Self::Portable],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splitting_is_the_floor() {
        fn check<T: Number>() {
            for quarter in -40..40 {
                for nudge in [-1e-3, 0.0, 1e-3] {
                    let x = T::from_f64(f64::from(quarter) / 4.0 + nudge);
                    let (integer, same) = x.split();
                    assert_eq!(same, x.floor());
                    assert_eq!(f64::from(integer), x.floor().to_f64());
                }
            }
            for x in [-0.9, 0.9].map(|x| T::from_f64(x * T::SPLITTABLE)) {
                assert_eq!(f64::from(x.split().0), x.floor().to_f64());
            }
            let _anything = T::from_f64(f64::NAN).split();
        }
        check::<f32>();
        check::<f64>();
    }
}
