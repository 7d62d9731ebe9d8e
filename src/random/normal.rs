//! Numbers of the standard normal distribution.

// the coefficients as they were published
#![allow(clippy::excessive_precision)]

use std::cell::OnceCell;

use super::Key;
use crate::scalar::{Lanes, Program, Real, Scalar};

/// Numerator and denominator of a rational function, lowest power first.
type Ratio = [[f64; 8]; 2];

/// The quantile function divided by `q = ½ − p`, in `0.425² − q²`, for `|q| ≤ 0.425`.
const CENTRE: Ratio = [
    [
        3.387_132_872_796_366_608,
        133.141_667_891_784_377_45,
        1_971.590_950_306_551_442_7,
        13_731.693_765_509_461_125,
        45_921.953_931_549_871_457,
        67_265.770_927_008_700_853,
        33_430.575_583_588_128_105,
        2_509.080_928_730_122_672_7,
    ],
    [
        1.0,
        42.313_330_701_600_911_252,
        687.187_007_492_057_908_3,
        5_394.196_021_424_751_107_7,
        21_213.794_301_586_595_867,
        39_307.895_800_092_710_61,
        28_729.085_735_721_942_674,
        5_226.495_278_852_854_561,
    ],
];

/// The quantile function in `√(−ln p) − 1.6`, for `√(−ln p) ≤ 5`.
const TAIL: Ratio = [
    [
        1.423_437_110_749_683_577_34,
        4.630_337_846_156_545_295_9,
        5.769_497_221_460_691_405_5,
        3.647_848_324_763_204_605_04,
        1.270_458_252_452_368_382_58,
        0.241_780_725_177_450_611_77,
        0.022_723_844_989_269_184_583_3,
        7.745_450_142_783_414_076_4e-4,
    ],
    [
        1.0,
        2.053_191_626_637_758_821_87,
        1.676_384_830_183_803_849_4,
        0.689_767_334_985_100_004_55,
        0.148_103_976_427_480_074_59,
        0.015_198_666_563_616_457_196_6,
        5.475_938_084_995_344_946e-4,
        1.050_750_071_644_416_843_24e-9,
    ],
];

/// The quantile function in `√(−ln p) − 5`, beyond.
const FAR: Ratio = [
    [
        6.657_904_643_501_103_777_2,
        5.463_784_911_164_114_369_9,
        1.784_826_539_917_291_335_8,
        0.296_560_571_828_504_891_23,
        0.026_532_189_526_576_123_093,
        0.001_242_660_947_388_078_438_6,
        2.711_555_568_743_487_578_15e-5,
        2.010_334_399_292_288_132_65e-7,
    ],
    [
        1.0,
        0.599_832_206_555_887_937_69,
        0.136_929_880_922_735_805_31,
        0.014_875_361_290_850_614_852_5,
        7.868_691_311_456_132_591e-4,
        1.846_318_317_510_054_681_8e-5,
        1.421_511_758_316_445_888_7e-7,
        2.044_263_103_389_939_785_64e-15,
    ],
];

fn ratio([numerator, denominator]: &Ratio, x: Scalar) -> Scalar {
    let polynomial = |c: &[f64; 8]| c.iter().rev().fold(Scalar::from(0.0), |sum, c| sum * x + *c);
    polynomial(numerator) / polynomial(denominator)
}

/// The number that a standard normal variable exceeds with probability `p ≤ ½`, as a function of `p` with a sign that
/// the result takes over (Wichura 1988, algorithm AS 241; relative error 1e-16 in `f64`).
fn quantile(signed: Scalar) -> Scalar {
    let p = signed.abs();
    let q = 0.5 - p;
    let centre = q * ratio(&CENTRE, 0.180_625 - q.square());
    let r = (-p.ln()).sqrt();
    let tail = r.le(5.0).select(ratio(&TAIL, r - 1.6), ratio(&FAR, r - 5.0));
    signed.sign() * q.le(0.425).select(centre, tail)
}

/// The quantile function as a program, traced once per thread.
pub(super) fn program() -> Program {
    thread_local! {
        static TRACED: OnceCell<Program> = const { OnceCell::new() };
    }
    let trace = || Program::trace("normal_quantile", &["p"], &["z"], |p| vec![quantile(p[0])]);
    TRACED.with(|traced| traced.get_or_init(trace).clone())
}

/// Writes the numbers of a key from the `start`-th on.
pub(super) fn fill<T: Real>(key: Key, start: u64, out: &mut [T]) {
    let half = T::from_f64(0.5);
    let (high, low) = (T::from_f64(1.0 / (1u64 << 33) as f64), T::from_f64(0.5 * (1.0 / (1u64 << 32) as f64).powi(2)));
    let signed = |counter: u64| {
        // one bit for the sign, 63 for the probability: all digits of the smallest ones
        let bits = key.bits(counter);
        let [upper, lower] = [(bits << 1) >> 32, (bits << 1) & 0xffff_ffff];
        let p = T::from_f64(upper as f64) * high + (T::from_f64(lower as f64) + half) * low;
        if bits >> 63 == 1 { -p } else { p }
    };
    let p: Vec<T> = (start..).take(out.len()).map(signed).collect();
    program().run(out.len(), &[Lanes::Each(&p)], &mut [out]);
}

#[cfg(test)]
mod tests {
    use super::program;

    /// Quantiles from mpmath 1.3 with 40 digits.
    #[test]
    fn quantiles_are_accurate() {
        let known: [(f64, f64); 12] = [
            (0.5, 0.0),
            (0.49999, 2.5066282748960008e-05),
            (0.3, 0.5244005127080408),
            (0.1, 1.2815515655446004),
            (0.0749, 1.4402382675279637),
            (0.0751, 1.43882539275254),
            (0.001, 3.0902323061678136),
            (1e-08, 5.612001244174789),
            (1.4e-11, 6.656723091518184),
            (1.3e-11, 6.667611456510741),
            (1e-15, 7.941345326170997),
            (1e-19, 9.013271153126674),
        ];
        for (p, z) in known {
            for sign in [-1.0, 1.0] {
                let found = program().eval(&[sign * p])[0];
                assert!((found - sign * z).abs() <= 2e-15 * z.max(1.0), "{p:e}: {found}, wanted {z}");
                let single = f64::from(program().eval(&[(sign * p) as f32])[0]);
                assert!((single - sign * z).abs() <= 2e-6 * z.max(1.0), "{p:e}: {single}, wanted {z}");
            }
        }
    }
}
