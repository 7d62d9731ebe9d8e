//! Sine and cosine for vectors of `f32`.
//!
//! `x = q π/2 + r` with `π/2` in three parts, of which the products with `q` are exact up to |x| = 8192; beyond that,
//! and for infinities and NaN, the whole vector goes to the standard library. Absolute error below 2⁻²³.

use super::exp_ln::{Lane32, ROUNDER, polynomial};
use super::lanes::{Lane, elementwise};

/// `π/2` in parts of 11, 11 and 24 bits.
const HALF_PI: [f32; 3] = [1.570_312_5, 0.000_483_751_3, 7.549_79e-8];

/// `(sin r − r) / r³` in powers of `r²`, on `|r| ≤ π/4`
const SIN: [f32; 3] = [-0.166_666_54, 0.008_332_131, -0.000_195_108_38];

/// `(cos r − 1 + r²/2) / r⁴` in powers of `r²`, on `|r| ≤ π/4`
const COS: [f32; 3] = [0.041_666_646, -0.001_388_725_1, 2.442_567_9e-5];

/// The standard library's functions, element by element.
trait Exact: Lane {
    unsafe fn sin(self) -> Self;
    unsafe fn cos(self) -> Self;
}

impl<V: Lane32> Exact for V {
    elementwise!(sin, cos);
}

/// Sine of an angle in radians.
#[inline(always)]
pub(super) unsafe fn sin<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe { if x.abs().le(V::splat(8192.0)).all() { quarter_turned(x, 0.0) } else { Exact::sin(x) } }
}

/// Cosine of an angle in radians.
#[inline(always)]
pub(super) unsafe fn cos<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe { if x.abs().le(V::splat(8192.0)).all() { quarter_turned(x, 1.0) } else { Exact::cos(x) } }
}

/// `sin(x + turns π/2)` for a whole number of quarter turns.
#[inline(always)]
unsafe fn quarter_turned<V: Lane32>(x: V, turns: f32) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let q = x.mul_add(V::splat(std::f32::consts::FRAC_2_PI), V::splat(ROUNDER)).sub(V::splat(ROUNDER));
        let r = q.neg_mul_add(V::splat(HALF_PI[0]), x);
        let r = q.neg_mul_add(V::splat(HALF_PI[2]), q.neg_mul_add(V::splat(HALF_PI[1]), r));
        let square = r.mul(r);
        let sine = polynomial(square, &SIN).mul_add(square.mul(r), r);
        let flat = square.neg_mul_add(V::splat(0.5), V::splat(1.0));
        let cosine = polynomial(square, &COS).mul_add(square.mul(square), flat);
        let half_turns = q.add(V::splat(turns)).mul(V::splat(0.5)).floor();
        let odd = half_turns.mul_sub(V::splat(-2.0), q.add(V::splat(turns)).neg());
        let turned = odd.choose(cosine, sine);
        let half = half_turns.mul(V::splat(0.5));
        let negative = half.sub(half.floor());
        negative.choose(turned.neg(), turned)
    }
}
