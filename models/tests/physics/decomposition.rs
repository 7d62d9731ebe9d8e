//! The singular value decomposition of scalar programs against vectors: values, and the published derivative of the frames.

use gradreel::scalar::{Lanes, Mat3, Program};

use crate::scene::{Vectors, close, close_norm};

fn columns(values: &[f64], width: usize) -> Vec<Vec<f64>> {
    (0..width).map(|k| values.iter().skip(k).step_by(width).copied().collect()).collect()
}

#[test]
fn singular_values_frames_and_their_derivative() {
    let file = Vectors::load("svd");
    let names = |prefix: &str, count: usize| (0..count).map(|k| format!("{prefix}{k}")).collect::<Vec<_>>();
    let (inputs, outputs) = (names("f", 9), names("y", 21));
    let [inputs, outputs] = [&inputs, &outputs].map(|names| names.iter().map(String::as_str).collect::<Vec<_>>());
    let program = Program::trace("svd", &inputs, &outputs, |f| {
        let principal = Mat3::from_slice(f).principal();
        [principal.u().to_vec(), principal.stretches().0.to_vec(), principal.v().to_vec()].concat()
    });
    let matrices = columns(file.get("A"), 9);
    let n = matrices[0].len();
    let run = |program: &Program, inputs: &[Vec<f64>]| {
        let lanes: Vec<Lanes<'_, f64>> = inputs.iter().map(|column| Lanes::Each(column)).collect();
        let mut found = vec![vec![0.0; n]; program.outputs().len()];
        program.run(n, &lanes, &mut found.iter_mut().map(Vec::as_mut_slice).collect::<Vec<_>>());
        found
    };
    let found = run(&program, &matrices);
    for k in 0..3 {
        close("sigma", &found[9 + k], &columns(file.get("sigma"), 3)[k], 1e-12);
    }
    // Frames are known up to the signs of their columns, which U and V share.
    let (u, v) = (columns(file.get("U"), 9), columns(file.get("V"), 9));
    let (mut on_u, mut on_v) = (columns(file.get("cot_U"), 9), columns(file.get("cot_V"), 9));
    for p in 0..n {
        for k in 0..3 {
            let same: f64 = (0..3).map(|i| found[3 * i + k][p] * u[3 * i + k][p]).sum();
            for i in 0..3 {
                let entry = 3 * i + k;
                on_u[entry][p] *= same.signum();
                on_v[entry][p] *= same.signum();
                let gap = columns(file.get("sigma"), 3);
                let apart = (0..3).filter(|&j| j != k).map(|j| (gap[k][p] - gap[j][p]).abs()).fold(1.0, f64::min);
                let tolerance = 1e-12 / apart;
                assert!((found[entry][p] - same.signum() * u[entry][p]).abs() < tolerance, "U of matrix {p}");
                assert!((found[12 + entry][p] - same.signum() * v[entry][p]).abs() < tolerance, "V of matrix {p}");
            }
        }
    }
    let inputs = [matrices, on_u, columns(file.get("cot_sigma"), 3), on_v].concat();
    let gradient = run(&program.vjp(), &inputs);
    for (k, wanted) in columns(file.get("g_A"), 9).iter().enumerate() {
        close_norm("g_A", &gradient[k], wanted, 1e-7);
    }
}
