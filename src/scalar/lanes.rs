//! The vector type that register code runs over.
//!
//! Everything here is generic over [`Lane`] and `inline(always)`, so that it is compiled once per instruction set
//! inside a function that enables it. Closures and array combinators would not inherit the instruction set: hence plain
//! loops and macros. Values move by explicit loads and stores; a step may write over one of its operands.

use super::real::Real;

/// Where the values of a slot are: consecutive lanes, or one vector's worth that stands for all lanes.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Port<T> {
    pub(super) at: *mut T,
    pub(super) repeats: bool,
}

/// A vector of numbers.
///
/// # Safety
/// Every method must be called with the instruction set of the type enabled. `load` and `store` need a pointer to
/// `WIDTH` values; alignment does not matter. Conditions are vectors of 0 and 1.
#[allow(clippy::missing_safety_doc)] // one contract for all methods
pub trait Lane: Copy {
    type Element: Real;
    const WIDTH: usize;
    /// How many such vectors the processor's registers hold at once.
    const REGISTERS: usize;

    /// The side of the square that [`Lane::transpose`] moves, at most 8.
    const SIDE: usize;

    /// Copies a square so that rows become columns: `to[c · stride + r] = rows[r][c]` for `r, c < SIDE`.
    unsafe fn transpose(rows: &[*const Self::Element; 8], to: *mut Self::Element, stride: usize);

    unsafe fn load(from: *const Self::Element) -> Self;
    unsafe fn store(self, to: *mut Self::Element);
    unsafe fn splat(x: Self::Element) -> Self;
    unsafe fn add(self, b: Self) -> Self;
    unsafe fn sub(self, b: Self) -> Self;
    unsafe fn mul(self, b: Self) -> Self;
    unsafe fn div(self, b: Self) -> Self;
    unsafe fn abs(self) -> Self;
    unsafe fn floor(self) -> Self;
    unsafe fn sqrt(self) -> Self;
    /// `self · b + c`, rounded once where the hardware does so.
    unsafe fn mul_add(self, b: Self, c: Self) -> Self;
    /// `self · b − c`
    unsafe fn mul_sub(self, b: Self, c: Self) -> Self;
    /// `c − self · b`
    unsafe fn neg_mul_add(self, b: Self, c: Self) -> Self;
    /// `self < b ? self : b`
    unsafe fn smaller(self, b: Self) -> Self;
    /// `self > b ? self : b`
    unsafe fn larger(self, b: Self) -> Self;
    unsafe fn lt(self, b: Self) -> Self;
    unsafe fn le(self, b: Self) -> Self;
    unsafe fn is_nan(self) -> Self;
    /// `self ≠ 0 ? a : b`
    unsafe fn choose(self, a: Self, b: Self) -> Self;
    unsafe fn exp(self) -> Self;
    unsafe fn ln(self) -> Self;
    unsafe fn exp_m1(self) -> Self;
    unsafe fn ln_1p(self) -> Self;
    unsafe fn sin(self) -> Self;
    unsafe fn cos(self) -> Self;
    unsafe fn tanh(self) -> Self;
    unsafe fn logistic(self) -> Self;
    unsafe fn softplus(self) -> Self;
    unsafe fn erf(self) -> Self;

    /// The first `count` values, zeros after them; `count` may exceed the width.
    #[inline(always)]
    unsafe fn load_part(from: *const Self::Element, count: usize) -> Self {
        // SAFETY: as this method, for `count` values; no vector is wider than 16.
        unsafe {
            if count >= Self::WIDTH {
                return Self::load(from);
            }
            let mut values = [Self::Element::ZERO; 16];
            std::ptr::copy_nonoverlapping(from, values.as_mut_ptr(), count);
            Self::load(values.as_ptr())
        }
    }

    /// Stores the first `count` values; `count` may exceed the width.
    #[inline(always)]
    unsafe fn store_part(self, to: *mut Self::Element, count: usize) {
        // SAFETY: as this method, for `count` values; no vector is wider than 16.
        unsafe {
            if count >= Self::WIDTH {
                return self.store(to);
            }
            let mut values = [Self::Element::ZERO; 16];
            self.store(values.as_mut_ptr());
            std::ptr::copy_nonoverlapping(values.as_ptr(), to, count);
        }
    }

    /// The sum of its values, added in halves.
    #[inline(always)]
    unsafe fn total(self) -> Self::Element {
        let mut values = [Self::Element::ZERO; 16];
        // SAFETY: as this method; no vector is wider than 16.
        unsafe { self.store(values.as_mut_ptr()) };
        let mut half = Self::WIDTH / 2;
        while half > 0 {
            for i in 0..half {
                values[i] += values[i + half];
            }
            half /= 2;
        }
        values[0]
    }

    /// `eˣ` for `x ≤ 0`, where 0 may stand for results below the normal numbers.
    #[inline(always)]
    unsafe fn exp_of_negative(self) -> Self {
        // SAFETY: as this method.
        unsafe { self.exp() }
    }

    /// Whether a condition holds in some lane.
    unsafe fn any(self) -> bool;
    /// `a < b ? self : other`
    unsafe fn if_less(self, a: Self, b: Self, other: Self) -> Self;

    /// `1/√x` for positive normal `x`, within two units in the last place.
    #[inline(always)]
    unsafe fn rsqrt(self) -> Self {
        // SAFETY: as this method.
        unsafe { self.sqrt().recip() }
    }

    #[inline(always)]
    unsafe fn neg(self) -> Self {
        // SAFETY: as this method. −0 − x, so that 0 becomes −0.
        unsafe { Self::splat(-Self::Element::ZERO).sub(self) }
    }

    #[inline(always)]
    unsafe fn recip(self) -> Self {
        // SAFETY: as this method.
        unsafe { Self::splat(Self::Element::ONE).div(self) }
    }

    #[inline(always)]
    unsafe fn sign(self) -> Self {
        // SAFETY: as this method.
        unsafe {
            let (zero, one) = (Self::splat(Self::Element::ZERO), Self::splat(Self::Element::ONE));
            zero.lt(self).choose(one, self.lt(zero).choose(one.neg(), self))
        }
    }

    #[inline(always)]
    unsafe fn min(self, b: Self) -> Self {
        // SAFETY: as this method.
        unsafe { b.is_nan().choose(b, b.smaller(self)) }
    }

    #[inline(always)]
    unsafe fn max(self, b: Self) -> Self {
        // SAFETY: as this method.
        unsafe { b.is_nan().choose(b, b.larger(self)) }
    }

    #[inline(always)]
    unsafe fn powf(self, b: Self) -> Self {
        let (mut bases, mut exponents) = ([Self::Element::ZERO; 16], [Self::Element::ZERO; 16]);
        // SAFETY: as this method; no vector is wider than 16.
        unsafe {
            self.store(bases.as_mut_ptr());
            b.store(exponents.as_mut_ptr());
            for i in 0..Self::WIDTH {
                bases[i] = bases[i].powf(exponents[i]);
            }
            Self::load(bases.as_ptr())
        }
    }
}

/// The methods of a [`Lane`] that call the standard library for each element.
macro_rules! elementwise {
    ($($name:ident),*) => {$(
        #[inline(always)]
        unsafe fn $name(self) -> Self {
            let mut x = [<Self::Element as $crate::scalar::Real>::ZERO; 16];
            // SAFETY: as this method; no vector is wider than 16.
            unsafe {
                self.store(x.as_mut_ptr());
                for i in 0..Self::WIDTH {
                    x[i] = $crate::scalar::Real::$name(x[i]);
                }
                Self::load(x.as_ptr())
            }
        }
    )*};
}
/// Methods of a vector type around one register, each an expression of its operands' registers.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! methods {
    ($($name:ident($($b:ident),*) |$x:ident| $value:expr;)*) => {$(
        #[inline(always)]
        unsafe fn $name(self $(, $b: Self)*) -> Self {
            let $x = self.0;
            $(let $b = $b.0;)*
            // SAFETY: the contract of `Lane`: the instruction set is enabled.
            Self(unsafe { $value })
        }
    )*};
}

/// The methods of such a type that move numbers between registers and memory, by instructions of these names.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! memory {
    ($float:ident: $load:ident $store:ident $splat:ident $transpose:ident) => {
        #[inline(always)]
        unsafe fn transpose(rows: &[*const $float; 8], to: *mut $float, stride: usize) {
            // SAFETY: the contract of `Lane`.
            unsafe { $transpose(rows, to, stride) }
        }

        #[inline(always)]
        unsafe fn load(from: *const $float) -> Self {
            // SAFETY: the contract of `Lane`.
            Self(unsafe { $load(from) })
        }

        #[inline(always)]
        unsafe fn store(self, to: *mut $float) {
            // SAFETY: the contract of `Lane`.
            unsafe { $store(to, self.0) }
        }

        #[inline(always)]
        unsafe fn splat(x: $float) -> Self {
            // SAFETY: the contract of `Lane`.
            Self(unsafe { $splat(x) })
        }
    };
}

pub(super) use elementwise;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(super) use {memory, methods};
