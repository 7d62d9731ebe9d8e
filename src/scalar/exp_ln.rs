//! `exp`, `ln` and what is built on them, for vectors of `f32`, within about two units in the last place.
//!
//! Each argument is reduced to a short interval around 0 (`exp`: `x = n ln 2 + r`, `|r| ≤ ln 2 / 2`;
//! `ln`: `x = m · 2ᵉ`, `√½ ≤ m < √2`) on which a minimax polynomial of the remainder, fitted for this file with
//! Lawson's reweighting, is accurate below the rounding of `f32`. Subnormal numbers, infinities and NaN come out
//! as in the standard library. Twin of `kernels/shared/ln.wgsl` and `kernels/shared/exp_m1.wgsl`, which use the same
//! coefficients.

use super::lanes::Lane;

/// Bits of `√½`.
pub(super) const SQRT_HALF: u32 = 0x3f35_04f3;

/// `1.5 · 2²³`: adding it rounds to a whole number and leaves that number in the low bits.
pub(super) const ROUNDER: f32 = 12_582_912.0;

/// `ln 2` in two parts; the first has 14 bits, so that its products with exponents are exact.
const LN_2: [f32; 2] = [0.693_176_27, -2.908_897_1e-5];

/// `(eʳ − 1 − r) / r²` on `|r| ≤ 0.35`
const EXP: [f32; 6] = [0.5, 0.166_666_66, 0.041_666_348, 0.008_333_391_5, 0.001_394_165_3, 0.000_198_459_57];

/// `(ln(1 + f) − f + f²/2) / f³` on `√½ ≤ 1 + f ≤ √2`
const LN: [f32; 8] =
    [0.333_333_3, -0.250_008_37, 0.200_012_92, -0.166_227_64, 0.141_997, -0.131_641_98, 0.127_790_88, -0.076_460_38];

/// A vector of `f32` whose bits can be worked on.
///
/// # Safety
/// As [`Lane`].
pub(super) trait Lane32: Lane<Element = f32> {
    /// Whether a condition holds in every lane.
    unsafe fn all(self) -> bool;
    /// `2ⁿ` from `n + ROUNDER`, for whole `n` in −126..=127.
    unsafe fn shift_into_exponent(self) -> Self;
    /// `self · 2ⁿ` for whole `n` in −252..=254; by two powers, so that results may be subnormal or overflow.
    #[inline(always)]
    unsafe fn times_two_to_the(self, n: Self) -> Self {
        // SAFETY: as this method.
        unsafe {
            let half = n.mul_add(Self::splat(0.5), Self::splat(ROUNDER)).sub(Self::splat(ROUNDER));
            self.mul(two_to_the(half)).mul(two_to_the(n.sub(half)))
        }
    }
    /// `e` of `x = m · 2ᵉ` with `√½ ≤ m < √2`, for positive normal `x`.
    unsafe fn exponent(self) -> Self;
    /// `m` of the same.
    unsafe fn mantissa(self) -> Self;
}

/// `c[0] + c[1] x + c[2] x² + …`
#[inline(always)]
pub(super) unsafe fn polynomial<V: Lane32, const N: usize>(x: V, c: &[f32; N]) -> V {
    // SAFETY: as the caller, the contract of `Lane`; so in every function here.
    unsafe {
        let mut sum = V::splat(c[N - 1]);
        for i in (0..N - 1).rev() {
            sum = sum.mul_add(x, V::splat(c[i]));
        }
        sum
    }
}

/// `(n, eʳ − 1)` with `x = n ln 2 + r`.
#[inline(always)]
unsafe fn reduce<V: Lane32>(x: V) -> (V, V) {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let n = x.mul_add(V::splat(std::f32::consts::LOG2_E), V::splat(ROUNDER)).sub(V::splat(ROUNDER));
        let r = n.neg_mul_add(V::splat(LN_2[1]), n.neg_mul_add(V::splat(LN_2[0]), x));
        (n, polynomial(r, &EXP).mul_add(r.mul(r), r))
    }
}

#[inline(always)]
unsafe fn two_to_the<V: Lane32>(n: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe { n.add(V::splat(ROUNDER)).shift_into_exponent() }
}

/// `eˣ` for `|x| ≤ 87`, or NaN.
#[inline(always)]
pub(super) unsafe fn exp_of_moderate<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (n, tail) = reduce(x);
        tail.add(V::splat(1.0)).mul(two_to_the(n))
    }
}

/// `eˣ`, down to subnormal numbers and up to infinity.
#[inline(always)]
pub(super) unsafe fn exp<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (n, tail) = reduce(V::splat(-104.0).larger(V::splat(89.0).smaller(x)));
        tail.add(V::splat(1.0)).times_two_to_the(n)
    }
}

/// `eˣ` for `x ≤ 0`, with 0 for what is below the normal numbers: the argument is cut at −127 ln 2, whose power of two
/// has the bits of 0. Two thirds of the work of [`exp`].
#[inline(always)]
pub(super) unsafe fn exp_of_negative<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (n, tail) = reduce(V::splat(-88.029_69).larger(x));
        let power = two_to_the(n);
        power.mul_add(tail, power)
    }
}

/// `eˣ − 1 = 2ⁿ (eʳ − 1) + (2ⁿ − 1)`, with `2ⁿ⁻¹` in place of `2ⁿ` so that it does not overflow early.
#[inline(always)]
pub(super) unsafe fn exp_m1<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (n, tail) = reduce(V::splat(-20.0).larger(V::splat(89.0).smaller(x)));
        let power = two_to_the(n.sub(V::splat(1.0)));
        let half = power.mul_add(tail, power.sub(V::splat(0.5)));
        half.add(half)
    }
}

/// Natural logarithm.
#[inline(always)]
pub(super) unsafe fn ln<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let subnormal = x.lt(V::splat(f32::MIN_POSITIVE));
        let normal = subnormal.choose(x.mul(V::splat(8_388_608.0)), x);
        let e = subnormal.mul_add(V::splat(-23.0), normal.exponent());
        let f = normal.mantissa().sub(one);
        let square = f.mul(f);
        let tail = polynomial(f, &LN).mul(square.mul(f));
        let tail = square.neg_mul_add(V::splat(0.5), e.mul_add(V::splat(LN_2[1]), tail));
        let value = e.mul_add(V::splat(LN_2[0]), f.add(tail));
        let not_positive = x.lt(zero).choose(V::splat(f32::NAN), V::splat(f32::NEG_INFINITY));
        let value = zero.lt(x).choose(value, not_positive);
        x.lt(V::splat(f32::INFINITY)).choose(value, x)
    }
}

/// `ln(1 + x) = ln u + (x − (u − 1)) / u` with `u` the rounded `1 + x`: the second term is what the rounding lost.
#[inline(always)]
pub(super) unsafe fn ln_1p<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let one = V::splat(1.0);
        let u = one.add(x);
        let value = ln(u);
        let lost = x.sub(u.sub(one)).div(u);
        let finite = V::splat(0.0).lt(u).mul(u.lt(V::splat(f32::INFINITY)));
        finite.choose(value.add(lost), value)
    }
}

/// `tanh |x| = t / (t + 2)` with `t = e^{2|x|} − 1`; 1 in `f32` from |x| = 10 on.
#[inline(always)]
pub(super) unsafe fn tanh<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let a = x.abs();
        let t = exp_m1(V::splat(20.0).smaller(a.add(a)));
        let value = t.div(t.add(V::splat(2.0)));
        x.lt(V::splat(0.0)).choose(value.neg(), value)
    }
}

/// `1 / (1 + e⁻ˣ)`, as `eˣ / (1 + eˣ)` below 0.
#[inline(always)]
pub(super) unsafe fn logistic<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let e = exp(x.abs().neg());
        zero.le(x).choose(one, e).div(one.add(e))
    }
}

/// `ln(1 + eˣ) = max(x, 0) + ln(1 + e^{−|x|})`
#[inline(always)]
pub(super) unsafe fn softplus<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe { x.larger(V::splat(0.0)).add(ln_1p(exp(x.abs().neg()))) }
}

/// The transcendental methods of a [`Lane`] of `f32`.
macro_rules! single_precision {
    () => {
        super::exp_ln::single_precision!(@ exp_ln: exp, exp_of_negative, ln, exp_m1, ln_1p, tanh, logistic, softplus);
        super::exp_ln::single_precision!(@ sin_cos: sin, cos);
        super::exp_ln::single_precision!(@ erf: erf);
    };
    (@ $module:ident: $($name:ident),*) => {$(
        #[inline(always)]
        unsafe fn $name(self) -> Self {
            // SAFETY: as this method.
            unsafe { super::$module::$name(self) }
        }
    )*};
}
pub(super) use single_precision;
