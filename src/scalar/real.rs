//! The floating-point types programs run in: `f32` for work, `f64` for checking gradients.

use std::fmt::{Debug, Display};
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

use super::kernel::Kernel;
use crate::Element;

/// A floating-point type that scalar programs and generic CPU kernels compute in: `f32` or `f64`.
///
/// Sealed: the crate implements it for these two only. Rounding and edge cases are those of the standard library's
/// method of the same name, except [`Real::min`] and [`Real::max`], which pass NaN on.
///
/// ```
/// use gradreel::scalar::Real;
///
/// fn norm<T: Real>(x: &[T]) -> T {
///     x.iter().map(|&x| x * x).sum::<T>().sqrt()
/// }
/// assert_eq!(norm(&[3.0_f32, 4.0]), 5.0);
/// assert_eq!(norm(&[3.0_f64, 4.0]), 5.0);
/// ```
pub trait Real:
    Kernel
    + Element
    + Copy
    + Default
    + Debug
    + Display
    + PartialEq
    + PartialOrd
    + Send
    + Sync
    + 'static
    + bytemuck::Pod
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
    + Sum
{
    /// 0
    const ZERO: Self;
    /// 1
    const ONE: Self;
    /// The distance from 1 to the next larger number.
    const EPSILON: Self;
    /// +∞
    const INFINITY: Self;
    /// −∞
    const NEG_INFINITY: Self;
    /// The name of the type, `"f32"` or `"f64"`.
    const NAME: &'static str;

    /// Whether this is NaN.
    fn is_nan(self) -> bool;
    /// Whether this is neither NaN nor infinite.
    fn is_finite(self) -> bool;
    /// `|x|`
    fn abs(self) -> Self;
    /// The largest integer not above `x`.
    fn floor(self) -> Self;
    /// `√x`
    fn sqrt(self) -> Self;
    /// `eˣ`
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// `eˣ − 1` without cancellation near 0.
    fn exp_m1(self) -> Self;
    /// `ln(1 + x)` without cancellation near 0.
    fn ln_1p(self) -> Self;
    /// Sine of an angle in radians.
    fn sin(self) -> Self;
    /// Cosine of an angle in radians.
    fn cos(self) -> Self;
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
    /// The error function, within `1e-15` in `f64`.
    fn erf(self) -> Self;
    /// `selfᵇ`
    fn powf(self, b: Self) -> Self;
    /// `selfⁿ`
    fn powi(self, n: i32) -> Self;
    /// `self · a + b`, rounded once. Slow where the target has no such instruction.
    fn mul_add(self, a: Self, b: Self) -> Self;

    /// The smaller of two; the first on a tie; NaN if either is NaN.
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        if b < self || b.is_nan() { b } else { self }
    }

    /// The larger of two; the first on a tie; NaN if either is NaN.
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        if b > self || b.is_nan() { b } else { self }
    }

    /// −1, 0 or 1; a zero keeps its sign and NaN stays NaN.
    #[inline(always)]
    fn sign(self) -> Self {
        if self > Self::ZERO {
            Self::ONE
        } else if self < Self::ZERO {
            -Self::ONE
        } else {
            self
        }
    }

    /// `1 / (1 + e⁻ˣ)`, to full relative precision on both sides.
    #[inline]
    fn logistic(self) -> Self {
        let e = (-self.abs()).exp();
        (if self >= Self::ZERO { Self::ONE } else { e }) / (Self::ONE + e)
    }

    /// `ln(1 + eˣ)`, without overflow for large `x`.
    #[inline]
    fn softplus(self) -> Self {
        self.max(Self::ZERO) + (-self.abs()).exp().ln_1p()
    }
}

macro_rules! real {
    ($($float:ident),*) => {$(
        impl Real for $float {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const EPSILON: Self = $float::EPSILON;
            const INFINITY: Self = $float::INFINITY;
            const NEG_INFINITY: Self = $float::NEG_INFINITY;
            const NAME: &'static str = stringify!($float);

            real!(@forward $float: is_nan -> bool, is_finite -> bool, abs -> Self, floor -> Self, sqrt -> Self,
                exp -> Self, ln -> Self, exp_m1 -> Self, ln_1p -> Self, sin -> Self, cos -> Self, tanh -> Self);

            #[inline]
            fn erf(self) -> Self {
                Self::from_f64(super::erf::erf_f64(f64::from(self)))
            }

            #[inline(always)]
            fn powf(self, b: Self) -> Self {
                $float::powf(self, b)
            }

            #[inline(always)]
            fn powi(self, n: i32) -> Self {
                $float::powi(self, n)
            }

            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                $float::mul_add(self, a, b)
            }
        }
    )*};
    (@forward $float:ident: $($name:ident -> $out:ty),*) => {$(
        #[inline(always)]
        fn $name(self) -> $out {
            $float::$name(self)
        }
    )*};
}

real!(f32, f64);
