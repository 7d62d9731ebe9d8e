//! A damped Newton step within a box.

use faer::Mat;
use faer::linalg::solvers::Solve;

/// `−(H + μ diag H)⁻¹ g` within a box: a component that would be longer than `longest` is held at that length, and the others
/// are the best for it. `None` where there is no slope.
pub(crate) fn damped(gradient: &[f64], hessian: &[Vec<f64>], damping: f64, longest: &[f64]) -> Option<Vec<f64>> {
    let n = gradient.len();
    let largest = (0..n).fold(0.0f64, |m, k| m.max(hessian[k][k] * longest[k] * longest[k]));
    if !(largest > 0.0 && largest.is_finite() && gradient.iter().all(|g| g.is_finite())) {
        return None;
    }
    let mut held: Vec<Option<f64>> = vec![None; n];
    loop {
        let free: Vec<usize> = (0..n).filter(|&k| held[k].is_none()).collect();
        let m = free.len();
        let matrix = Mat::from_fn(m, m, |i, j| {
            let (k, l) = (free[i], free[j]);
            // directions without any slope stay where they are
            let least = 1e-9 * largest / (longest[k] * longest[k]);
            hessian[k][l] + if k == l { damping * hessian[k][k] + least } else { 0.0 }
        });
        let right = Mat::from_fn(m, 1, |i, _| {
            let bent = |l: usize| held[l].map_or(0.0, |h| hessian[free[i]][l] * h);
            -gradient[free[i]] - (0..n).map(bent).sum::<f64>()
        });
        let found = matrix.partial_piv_lu().solve(&right);
        let ratio = |i: usize| found[(i, 0)].abs() / longest[free[i]];
        let worst = (0..m).max_by(|&a, &b| ratio(a).total_cmp(&ratio(b)));
        match worst.filter(|&i| ratio(i) > 1.0 || ratio(i).is_nan()) {
            Some(i) => held[free[i]] = Some(longest[free[i]].copysign(found[(i, 0)])),
            None => {
                (0..m).for_each(|i| held[free[i]] = Some(found[(i, 0)]));
                return held.into_iter().collect();
            }
        }
    }
}

/// How much a step lowers a function that is as curved as it looks: `−g·h − ½ hᵀ H h`.
pub(crate) fn promised(gradient: &[f64], hessian: &[Vec<f64>], step: &[f64]) -> f64 {
    let n = step.len();
    let bent = |k: usize| (0..n).map(|l| hessian[k][l] * step[l]).sum::<f64>();
    (0..n).map(|k| -step[k] * (gradient[k] + 0.5 * bent(k))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_newtons_where_it_is_short_and_short_where_it_is_not() {
        let hessian = vec![vec![4.0, 1.0], vec![1.0, 2.0]];
        let step = damped(&[-1.0, 0.5], &hessian, 0.0, &[0.6, 0.6]).unwrap();
        // (4 1; 1 2) h = (1, −½): h = (2.5, −3)/7
        approx::assert_relative_eq!(step[0], 2.5 / 7.0, max_relative = 1e-6);
        approx::assert_relative_eq!(step[1], -3.0 / 7.0, max_relative = 1e-6);
        approx::assert_relative_eq!(promised(&[-1.0, 0.5], &hessian, &step), 2.0 / 7.0, max_relative = 1e-6);
        // flat along the second: it stays within the region of trust, and the first still goes its way
        let flat = vec![vec![4.0, 0.0], vec![0.0, 1e-7]];
        let step = damped(&[-1.0, -1e-6], &flat, 0.0, &[0.6, 0.6]).unwrap();
        assert!((step[0] - 0.25).abs() < 1e-3 && step[1] > 0.1 && step[1] <= 0.6, "{step:?}");
        assert!(damped(&[0.0], &[vec![0.0]], 1.0, &[1.0]).is_none());
    }
}
