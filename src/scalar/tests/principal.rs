//! The singular value decomposition on every path, and isotropic functions against central differences.

use super::super::path::Path;
use super::super::{Lanes, Mat3, Principal, Program, Real, Scalar, Vec3};
use super::derivatives::check;

const F: [&str; 9] = ["f00", "f01", "f02", "f10", "f11", "f12", "f20", "f21", "f22"];

type Matrix = [f64; 9];

fn names(prefix: &str, count: usize) -> Vec<String> {
    (0..count).map(|n| format!("{prefix}{n}")).collect()
}

/// A program of nine entries, with any number of outputs.
fn of_matrix(name: &str, f: impl Fn(Principal) -> Vec<Scalar>) -> Program {
    let traced = |count: usize| {
        let outputs = names("y", count);
        let outputs: Vec<&str> = outputs.iter().map(String::as_str).collect();
        let all = |x: &[Scalar]| {
            let mut values = f(Mat3::from_slice(x).principal());
            values.resize(count, 0.0.into());
            values
        };
        Program::trace(name, &F, &outputs, all)
    };
    traced(if name == "svd" { 21 } else { 9 })
}

fn decomposition() -> Program {
    of_matrix("svd", |p| [p.u().to_vec(), p.stretches().0.to_vec(), p.v().to_vec()].concat())
}

fn times(a: Matrix, b: Matrix) -> Matrix {
    std::array::from_fn(|k| (0..3).map(|i| a[k / 3 * 3 + i] * b[3 * i + k % 3]).sum())
}

fn transposed(a: Matrix) -> Matrix {
    std::array::from_fn(|k| a[k % 3 * 3 + k / 3])
}

fn diagonal(d: [f64; 3]) -> Matrix {
    [d[0], 0.0, 0.0, 0.0, d[1], 0.0, 0.0, 0.0, d[2]]
}

/// A rotation about two axes.
fn rotation(a: f64, b: f64) -> Matrix {
    let about_z = [a.cos(), -a.sin(), 0.0, a.sin(), a.cos(), 0.0, 0.0, 0.0, 1.0];
    let about_x = [1.0, 0.0, 0.0, 0.0, b.cos(), -b.sin(), 0.0, b.sin(), b.cos()];
    times(about_x, about_z)
}

fn stretched(d: [f64; 3]) -> Matrix {
    times(times(rotation(0.7, -1.3), diagonal(d)), rotation(2.1, 0.4))
}

/// Everything that has made a decomposition stumble.
fn matrices() -> Vec<Matrix> {
    let mut all = vec![
        diagonal([1.0; 3]),
        diagonal([0.0; 3]),
        diagonal([-1.0; 3]),
        diagonal([1.0, -2.0, 3.0]),
        rotation(0.3, 2.0),
        [0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        [1.0; 9],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0],
        [0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1.0, 2.0, 3.0, 2.0, 4.0, 6.0, 0.5, 1.0, 1.5],
        stretched([1.0, 1e-3, 1e-7]),
        stretched([1.0, 1e-6, -1e-6]),
        stretched([2.0, 2.0, -2.0]),
        stretched([1.1, 1.1, 0.8]),
        stretched([1.0 + 1e-9, 1.0, 1.0 - 1e-9]),
        stretched([1e-15, 3e-15, 2e-15]),
        stretched([1e12, 2e12, 3e12]),
        stretched([1e3, 1.0, 0.05]),
    ];
    for p in 0..300 {
        all.push(std::array::from_fn(|k| {
            (1.7 * f64::from(p) + 2.3 * k as f64 + 0.1 * (p as f64) * k as f64).sin() * 1.4
        }));
    }
    all
}

#[track_caller]
fn check_decompositions<T: Real>(tolerance: f64) {
    let matrices: Vec<Matrix> = matrices().into_iter().map(|m| m.map(|x| T::from_f64(x).to_f64())).collect();
    let columns: Vec<Vec<T>> = (0..9).map(|k| matrices.iter().map(|m| T::from_f64(m[k])).collect()).collect();
    let inputs: Vec<Lanes<'_, T>> = columns.iter().map(|column| Lanes::Each(column)).collect();
    for path in Path::available() {
        let mut found = vec![vec![T::ZERO; matrices.len()]; 21];
        let mut outputs: Vec<&mut [T]> = found.iter_mut().map(Vec::as_mut_slice).collect();
        decomposition().run_on(path, matrices.len(), &inputs, &mut outputs);
        for (p, matrix) in matrices.iter().enumerate() {
            let at = |n: usize| found[n][p].to_f64();
            let (u, v): (Matrix, Matrix) = (std::array::from_fn(at), std::array::from_fn(|n| at(12 + n)));
            let sigma = [at(9), at(10), at(11)];
            let size = matrix.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let close = |what: &str, a: Matrix, b: Matrix, scale: f64| {
                let off = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(off <= tolerance * scale, "{path:?} {}: {what} of {matrix:?} is off by {off:e}", T::NAME);
            };
            close("U Σ Vᵀ", times(times(u, diagonal(sigma)), transposed(v)), *matrix, size);
            close("UᵀU", times(transposed(u), u), diagonal([1.0; 3]), 1.0);
            close("VᵀV", times(transposed(v), v), diagonal([1.0; 3]), 1.0);
            for (name, r) in [("U", u), ("V", v)] {
                let det = r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6])
                    + r[2] * (r[3] * r[7] - r[4] * r[6]);
                assert!((det - 1.0).abs() < 10.0 * tolerance, "{path:?}: {name} of {matrix:?} has determinant {det}");
            }
            let slack = tolerance * size;
            assert!(
                sigma[0] + slack >= sigma[1] && sigma[1] + slack >= sigma[2].abs() && sigma[1] >= 0.0,
                "{path:?}: {sigma:?} of {matrix:?}"
            );
        }
    }
}

#[test]
fn decompositions_hold_on_every_path() {
    check_decompositions::<f64>(4e-15);
    check_decompositions::<f32>(2e-6);
}

#[test]
fn entries_that_all_lanes_share_are_read_as_such() {
    let program = of_matrix("hencky", |p| p.left(p.stretches().map(|s| s.ln())).to_vec());
    let f = stretched([1.3, 1.1, 0.8]);
    let wanted = program.eval(&f);
    let columns: Vec<Vec<f64>> = f.iter().map(|&x| vec![x; 300]).collect();
    for shared in 0..512_u32 {
        let lanes: Vec<Lanes<'_, f64>> =
            (0..9).map(|n| if shared >> n & 1 == 1 { Lanes::Same(f[n]) } else { Lanes::Each(&columns[n]) }).collect();
        let mut found = vec![vec![0.0; 300]; 9];
        program.run(300, &lanes, &mut found.iter_mut().map(Vec::as_mut_slice).collect::<Vec<_>>());
        assert!(found.iter().zip(&wanted).all(|(column, y)| column.iter().all(|x| x == y)), "{shared:b}");
    }
}

#[test]
fn small_singular_values_keep_their_digits() {
    let sigma = decomposition().eval(&stretched([1.0, 1e-3, 1e-6]))[9..12].to_vec();
    for (found, wanted) in sigma.iter().zip([1.0, 1e-3, 1e-6]) {
        assert!((found / wanted - 1.0).abs() < 1e-9, "{found:e}");
    }
}

#[test]
fn a_nan_is_not_hidden() {
    for entry in 0..9 {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut f = stretched([1.2, 1.0, 0.9]);
            f[entry] = bad;
            let sigma = decomposition().eval(&f)[9..12].to_vec();
            assert!(sigma.iter().any(|s| s.is_nan()), "{bad} in entry {entry}: {sigma:?}");
        }
    }
}

/// Functions of stretches, each in two forms.
fn isotropic() -> Vec<Program> {
    let form = |name: &str, f: fn(Principal) -> Mat3| of_matrix(name, move |p| f(p).to_vec());
    vec![
        form("hencky", |p| {
            let e = p.stretches().map(|s| s.max(0.05).ln());
            let trace = e[0] + e[1] + e[2];
            p.left(e.map(|e| 2.0 * e + 1.5 * trace))
        }),
        form("polar", |p| p.two_point(Vec3::new(1.0, 1.0, 1.0))),
        form("cube", |p| p.two_point(p.stretches().map(|s| s.powi(3)))),
        form("right", |p| p.right(p.stretches().map(|s| (s * 0.3).exp() - 1.0 / (s + 4.0)))),
        form("ogden", |p| p.left(p.stretches().map(|s| s.abs().powf(1.7) - 0.3 * (s + 3.0).sqrt()))),
        form("shrunk", |p| {
            let e = p.stretches().map(|s| s.max(0.05).ln());
            let mean = (e[0] + e[1] + e[2]) / 3.0;
            let norm = (e.map(|e| e - mean).norm_squared() + 1e-8).sqrt();
            let k = norm.gt(0.05).select(0.3 + 0.01 / norm, 1.0);
            let projected = p.two_point(e.map(|e| ((e - mean) * k + mean).exp()));
            let stretches = projected.principal().stretches();
            projected
                + p.left(stretches.map(|s| s.ln().exp_m1() + s / (1.0 + stretches[0] * stretches[1] * stretches[2])))
        }),
        // No rule for tanh: the quotient, or the derivative where stretches are close.
        form("without_rule", |p| p.left(p.stretches().map(|s| (0.5 * s).tanh() * s))),
        // Each value from the two others.
        form("others", |p| {
            let s = p.stretches();
            p.left(Vec3::new(s[1] * s[2], s[2] * s[0], s[0] * s[1]))
        }),
    ]
}

#[test]
fn isotropic_functions_match_differences() {
    for program in isotropic() {
        for d in [[1.3, 1.0, 0.8], [2.5, 0.9, 0.4], [1.2, 0.7, 0.03], [1.5, 0.8, -0.3]] {
            check(&program, &stretched(d), 2e-7);
        }
    }
}

#[test]
fn isotropic_functions_match_differences_where_stretches_coincide() {
    for program in isotropic() {
        let exact = program.name() != "without_rule";
        check(&program, &diagonal([1.0; 3]), 2e-8);
        check(&program, &rotation(0.4, 1.0), 2e-8);
        for d in [[1.3, 1.3, 0.8], [1.2, 0.7, 0.7], [0.9; 3], [1.0 + 1e-5, 1.0, 1.0 - 1e-5], [1.1, 1.1 - 1e-9, 0.8]] {
            check(&program, &stretched(d), if exact { 5e-8 } else { 1e-6 });
        }
    }
}

#[test]
fn frames_by_themselves_match_differences() {
    check(&decomposition(), &stretched([1.9, 1.0, 0.4]), 1e-7);
    check(&decomposition(), &stretched([1.9, 1.0, -0.4]), 1e-7);
}

#[test]
fn functions_of_functions_share_one_decomposition() {
    let program = of_matrix("twice", |p| {
        let once = p.two_point(p.stretches().map(|s| s.sqrt()));
        let again = once.principal();
        again.left(again.stretches().map(|s| s.square().ln())).to_vec()
    });
    assert_eq!(program.to_string().matches("= svd").count(), 1);
    let direct = of_matrix("direct", |p| p.left(p.stretches().map(|s| s.ln())).to_vec());
    let f = stretched([1.4, 1.0, 0.6]);
    for (a, b) in program.eval(&f).iter().zip(direct.eval(&f)) {
        assert!((a - b).abs() < 1e-14);
    }
}

#[test]
fn second_derivatives_match_differences_of_first() {
    let program = of_matrix("hencky", |p| p.left(p.stretches().map(|s| s.ln())).to_vec());
    let tangent: Matrix = [0.3, -0.2, 0.5, 0.1, 0.7, -0.4, 0.2, 0.6, -0.1];
    check(&program.jvp(), &[stretched([1.4, 1.0, 0.6]), tangent].concat(), 2e-6);
    check(&program.vjp(), &[stretched([1.4, 1.0, 0.6]), tangent].concat(), 2e-6);
}

#[test]
fn single_precision_derivatives_keep_their_digits() {
    for program in isotropic() {
        let vjp = program.vjp();
        for d in [[1.0, 1.0, 1.0], [1.0 + 1e-4, 1.0, 1.0 - 1e-6], [1.3, 1.29, 0.8], [1.2, 0.7, 0.03]] {
            let x = [stretched(d), std::array::from_fn(|k| (1.3 * k as f64).cos())].concat();
            let single: Vec<f32> = x.iter().map(|&x| x as f32).collect();
            let wanted = vjp.eval(&single.iter().map(|&x| f64::from(x)).collect::<Vec<_>>());
            let scale = wanted.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
            for (a, b) in vjp.eval(&single).iter().zip(&wanted) {
                assert!((f64::from(*a) - b).abs() < 2e-4 * scale, "{} at {d:?}: {a} is not {b}", program.name());
            }
        }
    }
}
