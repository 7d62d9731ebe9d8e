//! L-BFGS against the iterates of an independent implementation with the same rules.

#[path = "vectors/find.rs"]
mod find;

use std::path::Path;

use gradreel::io::safetensors::TensorFile;
use gradreel::optim::Lbfgs;

/// A function by its name in the vectors' metadata, and its gradient.
fn function(name: &str, a: &[f64], c: &[f64], p: &[f64]) -> (f64, Vec<f64>) {
    let d: Vec<f64> = p.iter().zip(c).map(|(p, c)| p - c).collect();
    let n = c.len();
    let ad: Vec<f64> = (0..n).map(|i| (0..n).map(|j| a[n * i + j] * d[j]).sum()).collect();
    let adt: Vec<f64> = (0..n).map(|i| (0..n).map(|j| a[n * j + i] * d[j]).sum()).collect();
    let quadratic = |k: f64| {
        let value = k * d.iter().zip(&ad).map(|(d, ad)| d * ad).sum::<f64>();
        (value, (0..n).map(|i| k * (ad[i] + adt[i])).collect::<Vec<f64>>())
    };
    match name {
        "stiff" => quadratic(6.0),
        "shallow" => quadratic(0.0008),
        "quadratic" => quadratic(0.02),
        "quartic" => {
            let (value, gradient) = quadratic(0.02);
            let more = 0.05 * d.iter().map(|d| d.powi(4)).sum::<f64>();
            (value + more, gradient.iter().zip(&d).map(|(g, d)| g + 0.2 * d.powi(3)).collect())
        }
        "rosenbrock" => {
            let (u, v, w) = (1.0 - p[0], p[1] - p[0] * p[0], p[2] - p[1]);
            let value = 0.1 * u * u + v * v + 0.3 * w * w;
            (value, vec![-0.2 * u - 4.0 * p[0] * v, 2.0 * v - 0.6 * w, 0.6 * w])
        }
        other => panic!("no function {other}"),
    }
}

#[test]
fn iterates_agree_with_an_independent_implementation() {
    let file = find::path(Path::new("tests/vectors"), find::DYNAMICS, "lbfgs.safetensors");
    let file = TensorFile::read(file).unwrap();
    let list = |name: &str| file.get(name).unwrap().to_vec().unwrap();
    let number = |name: &str| file.metadata[name].parse::<f64>().unwrap();
    let (a, c) = (list("A"), list("c"));
    let n = c.len();
    let search = Lbfgs {
        history: number("history") as usize,
        iterations: 40,
        first_step: number("first_step"),
        c1: number("c1"),
        c2: number("c2"),
        ..Lbfgs::default()
    };
    // on "shallow" the reference drops curvature pairs below 1e-8 in absolute size, which ours has no reason to do
    let names: Vec<&str> = file.tensors.keys().filter_map(|name| name.strip_suffix(".iterates")).collect();
    assert!(names.len() > 1);
    for name in names.into_iter().filter(|name| *name != "shallow") {
        let wanted = list(&format!("{name}.iterates"));
        let mut found = vec![wanted[..n].to_vec()];
        let mut f = |p: &[f64]| Ok(function(name, &a, &c, p));
        search
            .minimise(&wanted[..n], &mut f, |step| {
                found.push(step.point.to_vec());
                Ok(())
            })
            .unwrap();
        assert_eq!(found.len(), wanted.len() / n, "{name}: number of steps");
        for (i, (found, wanted)) in found.iter().zip(wanted.chunks(n)).enumerate() {
            for (x, y) in found.iter().zip(wanted) {
                assert!((x - y).abs() < 1e-9, "{name}, step {i}: {found:?}, not {wanted:?}");
            }
        }
    }
}

#[test]
fn a_function_that_is_not_finite_at_the_start_is_an_error() {
    let error = Lbfgs::default().minimise(&[0.0], &mut |_| Ok((f64::NAN, vec![0.0])), |_| Ok(())).unwrap_err();
    assert_eq!(error.kind(), gradreel::ErrorKind::NonFinite);
}

#[test]
fn an_infinite_trial_is_stepped_back_from() {
    // ln x with a wall at 0: the first unit step lands beyond it
    let mut f = |p: &[f64]| match p[0] {
        x if x > 0.0 => Ok((x - x.ln(), vec![1.0 - 1.0 / x])),
        _ => Ok((f64::INFINITY, vec![0.0])),
    };
    let search = Lbfgs { first_step: 8.0, tolerance: 1e-8, ..Lbfgs::default() };
    let found = search.minimise(&[4.0], &mut f, |_| Ok(())).unwrap();
    assert!((found[0] - 1.0).abs() < 1e-5, "{found:?}");
}
