//! A real material as an example: the Kirchhoff stress of a neo-Hookean solid.

use super::super::path::Path;
use super::super::{Lanes, Mat3, Program, Scalar};
use super::derivatives::check;

const INPUTS: [&str; 11] = ["f00", "f01", "f02", "f10", "f11", "f12", "f20", "f21", "f22", "mu", "lambda"];
const OUTPUTS: [&str; 9] = ["t00", "t01", "t02", "t10", "t11", "t12", "t20", "t21", "t22"];

/// `τ = μ F Fᵀ + (λ ln J − μ) I` [Pa]
fn stress() -> Program {
    Program::trace("neo_hookean", &INPUTS, &OUTPUTS, |x| {
        let (f, mu, lambda) = (Mat3::from_slice(x), x[9], x[10]);
        let pressure: Scalar = lambda * f.det().ln() - mu;
        (mu * (f * f.t()) + pressure * Mat3::eye()).to_vec()
    })
}

#[test]
fn stress_at_rest_is_zero_on_every_path() {
    let mut x = [0.0_f32; 11];
    (x[0], x[4], x[8], x[9], x[10]) = (1.0, 1.0, 1.0, 3.0e4, 5.0e4);
    for path in Path::available() {
        let inputs = x.map(Lanes::Same);
        let mut tau = [[7.0_f32; 20]; 9];
        let mut outputs = tau.each_mut().map(|t| &mut t[..]);
        stress().run_on(path, 20, &inputs, &mut outputs);
        assert_eq!(tau, [[0.0; 20]; 9], "{path:?}");
    }
}

#[test]
fn uniaxial_stretch_matches_the_closed_form() {
    let (stretch, mu, lambda) = (1.3_f64, 2.0, 3.0);
    let mut x = [0.0; 11];
    (x[0], x[4], x[8], x[9], x[10]) = (stretch, 1.0, 1.0, mu, lambda);
    let tau = stress().eval(&x);
    assert!((tau[0] - (mu * (stretch * stretch - 1.0) + lambda * stretch.ln())).abs() < 1e-14);
    assert!((tau[4] - lambda * stretch.ln()).abs() < 1e-14);
    assert_eq!(tau[1], 0.0);
}

#[test]
fn its_adjoint_matches_central_differences() {
    let x = [1.1, 0.2, -0.1, 0.05, 0.9, 0.3, -0.2, 0.1, 1.2, 1.7, 2.3];
    check(&stress(), &x, 1e-8);
    let rest = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.7, 2.3];
    check(&stress(), &rest, 1e-8);
}

#[test]
fn forward_and_adjoint_stay_small() {
    let (forward, adjoint) = (stress().len(), stress().vjp().len());
    assert!(forward <= 60, "{forward} instructions");
    assert!(adjoint <= 4 * forward, "{adjoint} instructions for the adjoint of {forward}");
}
