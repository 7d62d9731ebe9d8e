//! The error function: for vectors of `f32` within about one unit in the last place, for `f64` within 1e-15.
//!
//! In `f32`: near 0 an odd polynomial, further out `1 − e^{−t − t q(t)}` with a polynomial `q` fitted to `ln erfc`; both
//! fitted for this file with Lawson's reweighting. Twin of `kernels/shared/erf.wgsl`. In `f64`: Taylor's series near 0,
//! further out `erfc z = t e^{−z² + p(t)}` with `t = 2 / (2 + z)` and a Chebyshev series `p` (the form of Numerical
//! Recipes, §6.2; the coefficients were computed for this file with 40 digits).

use super::exp_ln::{Lane32, exp_of_moderate, polynomial};

/// `(erf x − x) / x` in powers of `x²`, on `|x| ≤ 0.93`
const NEAR: [f32; 6] = [0.128_379_15, -0.376_124_9, 0.112_817_31, -0.026_762_964, 0.004_987_345_5, -0.000_595_952_6];

/// `(−ln erfc t − t) / t` on `0.92 ≤ t ≤ 3.93`; from there on `erf` is 1 in `f32`.
const FAR: [f32; 7] =
    [0.128_648_49, 0.635_151_3, 0.106_236_845, -0.023_762_02, 0.003_642_429_6, -0.000_322_794_02, 0.000_011_230_011];

/// The Chebyshev coefficients of `ln(erfc z · e^{z²} / t)` over `t = 2 / (2 + z)` from 1/15 to 4/5.
const CHEBYSHEV: [f64; 23] = [
    -0.744_568_540_347_564_8,
    0.471_155_819_524_816_3,
    0.015_495_382_893_981_892,
    -0.003_579_244_098_470_575,
    -0.000_452_149_424_083_028_9,
    6.968_842_001_902_783e-05,
    1.396_413_397_543_367_3e-05,
    -2.139_056_591_222_409_4e-06,
    -4.573_632_581_688_245_5e-07,
    8.644_833_085_848_007e-08,
    1.448_660_513_963_929_5e-08,
    -3.945_101_755_082_638e-09,
    -3.719_673_204_386_680_6e-10,
    1.806_069_156_472_914_2e-10,
    2.626_981_476_165_423_4e-12,
    -7.545_505_554_340_24e-12,
    5.410_303_804_699_998e-13,
    2.546_651_550_572_161e-13,
    -4.802_823_121_031_041e-14,
    -4.762_302_141_574_072e-15,
    2.476_094_130_182_402_4e-15,
    -1.445_934_122_611_871_3e-16,
    -7.462_401_993_502_809e-17,
];

/// The error function.
#[inline(always)]
pub(super) unsafe fn erf<V: Lane32>(x: V) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let a = x.abs();
        let near = polynomial(x.mul(x), &NEAR).mul_add(x, x);
        let t = V::splat(4.0).smaller(a);
        let far = V::splat(1.0).sub(exp_of_moderate(polynomial(t, &FAR).mul_add(t, t).neg()));
        let far = x.lt(V::splat(0.0)).choose(far.neg(), far);
        a.lt(V::splat(0.92)).choose(near, far)
    }
}

/// The error function of one number.
pub(super) fn erf_f64(x: f64) -> f64 {
    let z = x.abs();
    if z < 0.5 {
        let (mut power, mut sum) = (x, x);
        for n in 1..14 {
            power *= -(x * x) / f64::from(n);
            sum += power / f64::from(2 * n + 1);
        }
        return std::f64::consts::FRAC_2_SQRT_PI * sum;
    }
    if z.is_nan() || z > 6.0 {
        // 1 − erf is below half a unit in the last place
        return if z.is_nan() { x } else { x.signum() };
    }
    let t = 2.0 / (2.0 + z);
    let (low, high) = (1.0 / 15.0, 0.8);
    let u = (2.0 * t - low - high) / (high - low);
    // Clenshaw's recurrence
    let (mut b, mut before) = (0.0, 0.0);
    for c in CHEBYSHEV[1..].iter().rev() {
        (b, before) = (2.0 * u * b - before + c, b);
    }
    let complement = t * (u * b - before + CHEBYSHEV[0] - z * z).exp();
    x.signum() * (1.0 - complement)
}
