//! Every derivative rule against central differences in `f64`, and against its transpose.

use super::super::{Mat3, Program, Scalar, Vec3};
use super::{every_instruction, everything};

/// `∂yⱼ/∂xᵢ` by central differences, `[output][input]`.
fn differences(program: &Program, x: &[f64]) -> Vec<Vec<f64>> {
    let mut jacobian = vec![vec![0.0; x.len()]; program.outputs().len()];
    for i in 0..x.len() {
        let step = 1e-6 * x[i].abs().max(1.0);
        let shifted = |by: f64| {
            let mut x = x.to_vec();
            x[i] += by;
            program.eval(&x)
        };
        for (j, (high, low)) in shifted(step).into_iter().zip(shifted(-step)).enumerate() {
            jacobian[j][i] = (high - low) / (2.0 * step);
        }
    }
    jacobian
}

/// Compares both derivative programs with central differences.
#[track_caller]
pub(super) fn check(program: &Program, x: &[f64], tolerance: f64) {
    let wanted = differences(program, x);
    let unit = |n: usize, at: usize| (0..n).map(move |i| if i == at { 1.0 } else { 0.0 });
    let (vjp, jvp) = (program.vjp(), program.jvp());
    let close = |found: f64, j: usize, i: usize, which: &str| {
        let wanted = wanted[j][i];
        assert!(
            (found - wanted).abs() <= tolerance * (1.0 + wanted.abs()),
            "{} at {x:?}: d{}/d{}: {which} {found:e}, differences {wanted:e}",
            program.name(),
            program.outputs()[j],
            program.inputs()[i]
        );
    };
    for j in 0..program.outputs().len() {
        let arguments: Vec<f64> = x.iter().copied().chain(unit(program.outputs().len(), j)).collect();
        vjp.eval(&arguments).into_iter().enumerate().for_each(|(i, found)| close(found, j, i, "vjp"));
    }
    for i in 0..x.len() {
        let arguments: Vec<f64> = x.iter().copied().chain(unit(x.len(), i)).collect();
        jvp.eval(&arguments).into_iter().enumerate().for_each(|(j, found)| close(found, j, i, "jvp"));
    }
}

#[test]
fn every_instruction_matches_differences() {
    for program in every_instruction() {
        for x in [0.31, 0.77, 1.45, 2.6] {
            for y in [0.4, 1.9, 2.2] {
                check(&program, &[x, y, 1.3][..program.inputs().len()], 2e-8);
            }
        }
    }
}

#[test]
fn instructions_defined_below_zero_match_differences_there() {
    for program in every_instruction() {
        if !["ln", "sqrt", "powf"].contains(&program.name()) {
            for x in [-0.9, -0.35, -2.7].into_iter().filter(|&x| x > -1.0 || program.name() != "ln_1p") {
                check(&program, &[x, -1.1, 0.6][..program.inputs().len()], 2e-8);
            }
        }
    }
}

#[test]
fn composites_match_differences() {
    let program = Program::trace("composites", &["x", "y"], &["a", "b", "c", "d", "e"], |v| {
        let (x, y) = (v[0], v[1]);
        vec![x.powi(5) + y.powi(-3), x.powf(3.0) * y.powf(0.5), x.clamp(-0.5, 0.5) * y, x / y.square(), y.powf(y)]
    });
    check(&program, &[-1.2, 0.8], 1e-8);
    check(&program, &[0.3, 1.7], 1e-8);
    check(&everything(), &[0.3, -1.2, 0.9], 1e-7);
    check(&everything(), &[1.7, 0.6, -1.4], 1e-7);
}

#[test]
fn matrices_and_vectors_match_differences() {
    let names: Vec<String> = (0..15).map(|i| format!("x{i}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let outputs: Vec<String> = (0..22).map(|i| format!("y{i}")).collect();
    let outputs: Vec<&str> = outputs.iter().map(String::as_str).collect();
    let program = Program::trace("algebra", &names, &outputs, |x| {
        let (m, u, v) = (Mat3::from_slice(x), Vec3::from_slice(&x[9..]), Vec3::from_slice(&x[12..]));
        let mut all = m.inverse().to_vec();
        all.extend((m.sym() * u.cross(v) + m.column(1).scale(u.norm()) - v).0);
        all.extend((m.t() * Mat3::outer(u, v).dev() - m.scale(m.trace()) * Mat3::eye()).to_vec());
        all.push(m.det() * m.ddot(m.cofactor()));
        all
    });
    let x = [1.2, 0.1, -0.3, 0.2, 0.9, 0.15, -0.1, 0.4, 1.1, 0.5, -0.7, 0.2, 0.3, 0.8, -0.4];
    check(&program, &x, 1e-7);
    let y = program.eval(&x);
    let identity = |i: usize, j: usize| (0..3).map(|k| x[3 * i + k] * y[3 * k + j]).sum::<f64>();
    for (i, j) in (0..9).map(|n| (n / 3, n % 3)) {
        assert!((identity(i, j) - f64::from(u8::from(i == j))).abs() < 1e-14, "F F⁻¹ at [{i}, {j}]");
    }
}

#[test]
fn second_derivatives_match_differences_of_first() {
    let program = Program::trace("waves", &["x", "y"], &["z"], |v| vec![(v[0] * v[1]).sin() * v[0].exp()]);
    check(&program.vjp(), &[0.4, 1.3, 0.7], 1e-8);
    check(&program.jvp(), &[0.4, 1.3, 0.7, -0.2], 1e-8);
}

#[test]
fn a_choice_of_inputs_gives_their_cotangents_with_less_code() {
    let program = everything();
    let (all, some) = (program.vjp(), program.vjp_wrt(&[2]));
    assert_eq!(some.inputs(), all.inputs());
    assert_eq!(some.outputs(), ["g_z"]);
    assert!(some.len() < all.len(), "{} of {} instructions", some.len(), all.len());
    let x = [0.3, -1.2, 0.9, 1.0, 2.0, 3.0, -1.0, 0.5];
    assert_eq!(some.eval(&x)[0], all.eval(&x)[2]);
}

#[test]
fn kinks_follow_the_documented_branch() {
    let slope = |f: fn(Scalar, Scalar) -> Scalar, x: f64, y: f64| {
        Program::trace("f", &["x", "y"], &["z"], |v| vec![f(v[0], v[1])]).vjp().eval(&[x, y, 1.0])
    };
    assert_eq!(slope(|x, _| x.abs(), 0.0, 0.0), [0.0, 0.0]);
    assert_eq!(slope(|x, y| x.min(y), 2.0, 2.0), [1.0, 0.0]);
    assert_eq!(slope(|x, y| x.max(y), 2.0, 2.0), [1.0, 0.0]);
    assert_eq!(slope(|x, _| x.clamp(0.0, 1.0), 1.0, 0.0), [1.0, 0.0]);
    assert_eq!(slope(|x, _| x.clamp(0.0, 1.0), 1.5, 0.0), [0.0, 0.0]);
    assert_eq!(slope(|x, y| x.floor() + y.sign(), 0.5, 0.5), [0.0, 0.0]);
    assert_eq!(slope(|x, y| x.powf(y), 0.0, 2.5), [0.0, 0.0]);
    let power: fn(Scalar, Scalar) -> Scalar = |x, y| x.powf(y);
    assert_eq!(slope(power, 0.0, 0.0), [0.0, 0.0]);
    assert_eq!(slope(power, 0.0, -3.0), [f64::NEG_INFINITY; 2]);
    let below = slope(power, -2.0, 3.0);
    assert!(below[0] == 12.0 && below[1].is_nan(), "{below:?}");
    assert_eq!(slope(|x, _| x.powi(-3), 0.0, 0.0), [f64::NEG_INFINITY, 0.0]);
}

#[test]
fn the_branch_not_taken_leaks_nothing() {
    let program = Program::trace("f", &["x"], &["y"], |v| {
        let x = v[0];
        let inside = x.gt(0.0);
        let safe = inside.select(x, 1.0);
        vec![inside.select(safe.ln() + safe.sqrt() / safe, x.exp_m1() + (1.0 - x).recip())]
    });
    // At 0 the first branch, taken with x itself, would have infinite value and slope; at 1 the second.
    assert_eq!(program.vjp().eval(&[0.0, 1.0]), [2.0]);
    assert_eq!(program.eval(&[0.0]), [1.0]);
    let unmasked =
        Program::trace("f", &["x"], &["y"], |v| vec![v[0].lt(2.0).select(v[0].square(), (v[0] * 1e3).exp() * v[0])]);
    // exp overflows in the branch not taken, whose cotangent is 0 before it meets the slope of the *outer* product.
    assert_eq!(unmasked.eval(&[1.0]), [1.0]);
    assert_eq!(unmasked.vjp().eval(&[0.5, 1.0]), [1.0]);
}
