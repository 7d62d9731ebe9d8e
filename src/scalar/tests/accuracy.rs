//! The vector functions of `f32` against the standard library in `f64`, over all magnitudes, on every path.

use super::super::instruction::Unary;
use super::super::path::Path;
use super::super::{Lanes, Real};
use super::of_unary;

/// Numbers of every exponent and both signs, with the edges.
fn sweep() -> Vec<f32> {
    let mut x: Vec<f32> = (0..=u32::MAX).step_by(10_007).map(f32::from_bits).collect();
    x.extend((-40_000..40_000).map(|i| i as f32 * 0.002_7));
    x.extend((0..20_000).map(|i| 1.0 + (i - 10_000) as f32 * 3e-5));
    let edges =
        [0.0, f32::MIN_POSITIVE, 1e-45, 1.0, 0.5, 88.7, 88.722_84, 103.9, 104.0, 89.0, 150.0, f32::INFINITY, f32::MAX];
    x.extend(edges.into_iter().flat_map(|x| [x, -x]));
    x.push(f32::NAN);
    x
}

/// The distance between `f32` numbers around `x`.
fn ulp(x: f64) -> f64 {
    let x = (x.abs() as f32).clamp(f32::MIN_POSITIVE, f32::MAX);
    f64::from(x) - f64::from(f32::from_bits(x.to_bits() - 1))
}

/// The largest error of an instruction in units in the last place, and where, over `x` for which `keep` holds.
fn worst(op: Unary, path: Path, keep: fn(f32) -> bool) -> (f64, f32) {
    let x: Vec<f32> = sweep().into_iter().filter(|&x| keep(x)).collect();
    let mut y = vec![0.0; x.len()];
    of_unary(op).run_on(path, x.len(), &[Lanes::Each(&x)], &mut [&mut y]);
    let mut worst = (0.0, 0.0);
    for (&x, &y) in x.iter().zip(&y) {
        let wanted = op.eval(f64::from(x));
        if wanted.is_nan() || (wanted as f32).is_infinite() || wanted.abs() > f64::from(f32::MAX) {
            let same = if wanted.is_nan() { y.is_nan() } else { y == wanted as f32 || y == f32::MAX };
            assert!(same, "{op:?} on {path:?} of {x:e}: {y:e}, wanted {wanted:e}");
        } else {
            let error = (f64::from(y) - wanted).abs() / ulp(wanted);
            assert!(y.is_finite(), "{op:?} on {path:?} of {x:e}: {y:e}, wanted {wanted:e}");
            worst = if error > worst.0 { (error, x) } else { worst };
        }
    }
    worst
}

#[test]
fn vector_functions_are_accurate_everywhere() {
    let bounds = [
        (Unary::Exp, 1.5),
        (Unary::Ln, 1.5),
        (Unary::ExpM1, 2.0),
        (Unary::Ln1p, 2.0),
        (Unary::Tanh, 3.0),
        (Unary::Logistic, 3.0),
        (Unary::Softplus, 3.0),
        (Unary::Erf, 1.6),
        (Unary::Sqrt, 0.51),
        (Unary::Recip, 0.51),
    ];
    let mut failures = Vec::new();
    for path in Path::available() {
        for (op, bound) in bounds {
            let (error, x) = worst(op, path, |_| true);
            println!("{path:?} {op:?} {error:.2} ulp at {x:e}");
            if error > bound {
                failures.push(format!("{op:?} on {path:?}: {error:.2} ulp at {x:e}, {bound} allowed"));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// Numbers of mpmath 1.3 with 40 digits.
#[test]
fn the_error_function_of_f64_is_accurate() {
    let known = [
        (1e-10, 1.128_379_167_095_512_6e-10),
        (0.1, 0.112_462_916_018_284_89),
        (0.499, 0.5196206559894685),
        (0.5, 0.520_499_877_813_046_5),
        (0.501, 0.5213782208544119),
        (1.0, 0.842_700_792_949_714_9),
        (1.7, 0.9837904585907745),
        (2.5, 0.999_593_047_982_555),
        (4.2, 0.9999999971445058),
        (5.9, 0.9999999999999999),
        (6.5, 1.0),
    ];
    for (x, wanted) in known {
        for sign in [-1.0, 1.0] {
            let found = Unary::Erf.eval(sign * x);
            assert!((found - sign * wanted).abs() <= 4e-16 * wanted, "erf({}) = {found:e}", sign * x);
        }
    }
    assert!(Unary::Erf.eval(f64::NAN).is_nan());
    assert_eq!([Unary::Erf.eval(f64::INFINITY), Unary::Erf.eval(-0.0_f64)], [1.0, 0.0]);
}

#[test]
fn sine_and_cosine_have_small_absolute_error() {
    for path in Path::available() {
        for op in [Unary::Sin, Unary::Cos] {
            let x: Vec<f32> = sweep();
            let mut y = vec![0.0; x.len()];
            of_unary(op).run_on(path, x.len(), &[Lanes::Each(&x)], &mut [&mut y]);
            for (&x, &y) in x.iter().zip(&y) {
                let wanted = op.eval(f64::from(x));
                let error = (f64::from(y) - wanted).abs();
                assert!(error < 1.2e-7 || (wanted.is_nan() && y.is_nan()), "{op:?} {path:?} {x:e}: {y:e} {wanted:e}");
            }
        }
    }
}

#[test]
fn exact_instructions_agree_bit_for_bit_with_their_definition() {
    for path in Path::available() {
        for op in [Unary::Neg, Unary::Abs, Unary::Sign, Unary::Floor] {
            let x = sweep();
            let mut y = vec![0.0; x.len()];
            of_unary(op).run_on(path, x.len(), &[Lanes::Each(&x)], &mut [&mut y]);
            for (&x, &y) in x.iter().zip(&y) {
                let wanted: f32 = op.eval(x);
                assert!(
                    y.to_bits() == wanted.to_bits() || (y.is_nan() && Real::is_nan(wanted)),
                    "{op:?} {path:?} {x:e}"
                );
            }
        }
    }
}
