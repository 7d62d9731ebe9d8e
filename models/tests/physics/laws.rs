//! Every shipped material: stress at rest, objectivity, and its generated derivative against central differences.

use gradreel::scalar::Lanes;
use gradreel_models::physics::{Law, materials};

type Matrix = [f64; 9];

const IDENTITY: Matrix = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
const DT: f64 = 1e-4;

/// Inputs of the law's program: `F, C, dt, parameters`.
fn inputs(law: &Law, f: Matrix) -> Vec<f64> {
    let c = [0.3, -0.2, 0.1, 0.4, 0.2, -0.5, -0.1, 0.6, -0.3];
    let values = law.parameters().iter().map(|parameter| parameter.start);
    f.into_iter().chain(c).chain([DT]).chain(values).collect()
}

/// `F′` and `τ`.
fn evaluate(law: &Law, inputs: &[f64]) -> Vec<f64> {
    run(law.program(), inputs, 18)
}

fn run(program: &gradreel::scalar::Program, inputs: &[f64], outputs: usize) -> Vec<f64> {
    let lanes: Vec<Lanes<'_, f64>> = inputs.iter().map(|&x| Lanes::Same(x)).collect();
    let mut found = vec![0.0; outputs];
    let mut slices: Vec<&mut [f64]> = found.chunks_mut(1).collect();
    program.run(1, &lanes, &mut slices);
    found
}

fn stress(law: &Law, f: Matrix) -> Matrix {
    let mut inputs = inputs(law, f);
    inputs[9..18].fill(0.0);
    evaluate(law, &inputs)[9..].try_into().unwrap()
}

fn times(a: Matrix, b: Matrix) -> Matrix {
    std::array::from_fn(|k| (0..3).map(|i| a[k / 3 * 3 + i] * b[3 * i + k % 3]).sum())
}

fn transposed(a: Matrix) -> Matrix {
    std::array::from_fn(|k| a[k % 3 * 3 + k / 3])
}

/// Rotation by these angles about z, then x.
fn rotation(a: f64, b: f64) -> Matrix {
    let about_z = [a.cos(), -a.sin(), 0.0, a.sin(), a.cos(), 0.0, 0.0, 0.0, 1.0];
    let about_x = [1.0, 0.0, 0.0, 0.0, b.cos(), -b.sin(), 0.0, b.sin(), b.cos()];
    times(about_x, about_z)
}

/// Rest, repeated stretches, a generic state, a large stretch with rotation.
fn states() -> Vec<(&'static str, Matrix)> {
    let stretch = |a: f64, b: f64, c: f64| [a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c];
    vec![
        ("rest", IDENTITY),
        ("two equal stretches", times(rotation(0.4, 1.1), stretch(1.1, 1.1, 0.9))),
        ("three equal stretches", times(rotation(-0.7, 0.2), stretch(0.95, 0.95, 0.95))),
        ("generic", [1.1, 0.2, -0.1, 0.05, 0.9, 0.15, -0.2, 0.1, 1.05]),
        ("large stretch", times(times(rotation(0.4, 1.1), stretch(2.5, 0.4, 1.3)), rotation(1.0, 2.0))),
    ]
}

#[test]
fn no_stress_at_rest() {
    for law in materials::all() {
        let scale = law.parameters()[0].start;
        let tau = stress(&law, IDENTITY);
        assert!(tau.iter().all(|t| t.abs() < 1e-12 * scale), "{}: {tau:?}", law.name());
    }
}

#[test]
fn rotating_the_body_rotates_its_stress() {
    for law in materials::all() {
        for (name, f) in states() {
            let r = rotation(0.8, -1.9);
            let (turned, tau) = (stress(&law, times(r, f)), stress(&law, f));
            let wanted = times(times(r, tau), transposed(r));
            let scale = law.parameters()[0].start;
            for (a, b) in turned.iter().zip(&wanted) {
                assert!((a - b).abs() < 1e-11 * scale, "{} at {name}: {turned:?} is not {wanted:?}", law.name());
            }
        }
    }
}

#[test]
fn generated_derivatives_agree_with_central_differences() {
    for law in materials::all() {
        let reverse = law.program().vjp();
        for (name, f) in states() {
            let x = inputs(&law, f);
            let scale = law.parameters()[0].start;
            let cotangent: Vec<f64> =
                (0..18).map(|k| (1.0 + 0.7 * f64::from(k)).sin() / if k < 9 { 1.0 } else { scale }).collect();
            let objective = |x: &[f64]| -> f64 { evaluate(&law, x).iter().zip(&cotangent).map(|(y, g)| y * g).sum() };
            let gradient = run(&reverse, &[x.as_slice(), &cotangent].concat(), x.len());
            for k in (0..x.len()).filter(|&k| k != 18) {
                let step = 1e-6 * x[k].abs().max(1e-2);
                let shifted = |by: f64| {
                    let mut x = x.clone();
                    x[k] += by;
                    objective(&x)
                };
                let difference = (shifted(step) - shifted(-step)) / (2.0 * step);
                let tolerance = 1e-7 * difference.abs().max(if k < 18 { 1.0 } else { 1.0 / x[k].abs() });
                let input = &law.program().inputs()[k];
                let found = gradient[k];
                let off = (found - difference).abs();
                assert!(off < tolerance, "{} at {name}, {input}: {found} is not {difference}", law.name());
            }
        }
    }
}
