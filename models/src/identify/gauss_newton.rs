//! Gauss–Newton on the pixels: steps within a region of trust, from normal equations.

use faer::Mat;
use faer::linalg::solvers::Solve;
use gradreel::Result;

use crate::identify::oracle::{Answer, Listener, Oracle};
use crate::identify::plausible::Plausible;
use crate::identify::{Evaluation, Free, Problem, Unknowns};

/// Minimises the loss of the first `frames` frames over the free unknowns by Levenberg and Marquardt's method, with at most
/// `steps` steps, and returns the best evaluation.
///
/// A step solves `(C + μ diag C + ν D) h = −g` with gradient and curvature of [`Problem::linearise`]; `μ` follows how well
/// steps keep what they promise (Nielsen 1999), `ν D` is the least that makes no parameter move farther than half of what its
/// plausible range calls a standard deviation (0.6 decades of four), and no velocity farther than 0.2 m/s. What the
/// law holds to be implausible costs extra. `known`, `each` and `notes` as in [`estimate`](crate::identify::estimate).
///
/// # Errors
/// What the problem returns at the start; later break-downs are stepped back from.
#[expect(clippy::too_many_arguments, reason = "what is searched, and who hears of it, named")]
pub fn gauss_newton(
    problem: &Problem<'_>,
    start: &Unknowns,
    free: Free,
    frames: usize,
    steps: usize,
    known: &[Answer],
    each: &mut Listener<'_>,
    notes: &mut dyn FnMut(String),
) -> Result<Evaluation> {
    let law = &problem.law;
    let mut oracle = Oracle::new(problem, frames, known, each, notes);
    oracle.plausible = Some(Plausible { law, free });
    let mut here = start.clone();
    let mut x = start.coordinates(law, free);
    let limits = Plausible { law, free }.limits();
    let (mut damping, mut growth) = (1e-3, 2.0);
    'search: for _ in 0..steps {
        // the step of the simulation that the unknowns need now: that of a stiffer start would damp the motion otherwise
        oracle.substeps = 0;
        let Answer { loss, gradient, curvature, .. } = oracle.linearised(&here, free)?;
        let (Some(value), false) = (loss, curvature.is_empty()) else { break };
        let longest = Plausible { law, free }.longest_step(&here);
        let mut decrease = 0.0;
        for _ in 0..TRIALS {
            let Some(step) = damped_step(&gradient, &curvature, damping, &longest) else { break 'search };
            if step.iter().all(|h| h.abs() < NEGLIGIBLE) {
                break 'search;
            }
            let within = |((x, h), [low, high]): ((&f64, &f64), &[f64; 2])| (x + h).clamp(low.min(*x), high.max(*x));
            let moved: Vec<f64> = x.iter().zip(&step).zip(&limits).map(within).collect();
            let step: Vec<f64> = moved.iter().zip(&x).map(|(moved, x)| moved - x).collect();
            let there = start.moved(law, free, &moved);
            let new = oracle.loss(&there)?.unwrap_or(f64::INFINITY);
            let gain = (value - new) / promised(&gradient, &curvature, &step);
            if new < value {
                damping = (damping * (1.0f64 / 3.0).max(1.0 - (2.0 * gain - 1.0).powi(3))).clamp(1e-6, 1e3);
                growth = 2.0;
                decrease = value - new;
                (x, here) = (moved, there);
                break;
            }
            damping *= 2.0 * growth;
            growth *= 2.0;
        }
        if decrease <= LITTLE * value {
            break;
        }
    }
    if steps == 0 {
        oracle.loss(start)?;
    }
    Ok(oracle.best.expect("the start was evaluated"))
}

/// Trials of one step at most, each shorter.
const TRIALS: usize = 5;

/// A step is over when no coordinate moves farther than this.
const NEGLIGIBLE: f64 = 1e-3;

/// A search is over when a step lowers the loss by less than this share.
const LITTLE: f64 = 1e-5;

/// `−(C + μ diag C + ν diag longest⁻²)⁻¹ g` with the least `ν` of a rising series for which no component is longer than it may
/// be; nothing where there is no slope.
fn damped_step(gradient: &[f64], curvature: &[Vec<f64>], damping: f64, longest: &[f64]) -> Option<Vec<f64>> {
    let n = gradient.len();
    let largest = (0..n).fold(0.0f64, |m, k| m.max(curvature[k][k] * longest[k] * longest[k]));
    if !(largest > 0.0 && largest.is_finite() && gradient.iter().all(|g| g.is_finite())) {
        return None;
    }
    let right = Mat::from_fn(n, 1, |i, _| -gradient[i]);
    let mut shift = 1e-9 * largest;
    while shift < 1e9 * largest {
        let matrix = Mat::from_fn(n, n, |i, j| {
            curvature[i][j] + if i == j { damping * curvature[i][i] + shift / (longest[i] * longest[i]) } else { 0.0 }
        });
        let step = matrix.partial_piv_lu().solve(&right);
        let step: Vec<f64> = (0..n).map(|k| step[(k, 0)]).collect();
        if step.iter().zip(longest).all(|(h, longest)| h.abs() <= *longest) {
            return Some(step);
        }
        shift *= 2.0;
    }
    None
}

/// How much a step lowers the loss if it is as curved as it looks: `−g·h − ½ hᵀ C h`.
fn promised(gradient: &[f64], curvature: &[Vec<f64>], step: &[f64]) -> f64 {
    let n = step.len();
    let bent = |k: usize| (0..n).map(|l| curvature[k][l] * step[l]).sum::<f64>();
    (0..n).map(|k| -step[k] * (gradient[k] + 0.5 * bent(k))).sum()
}

/// The loss at some points, what is implausible of the free unknowns included: those where the physics breaks down have an infinite one.
///
/// `known`, `each` and `notes` as in [`estimate`](crate::identify::estimate).
///
/// # Errors
/// What `each` returns; what the problem returns but break-downs.
pub fn scan(
    problem: &Problem<'_>,
    points: &[Unknowns],
    free: Free,
    frames: usize,
    known: &[Answer],
    each: &mut Listener<'_>,
    notes: &mut dyn FnMut(String),
) -> Result<Vec<Evaluation>> {
    let mut oracle = Oracle::new(problem, frames, known, each, notes);
    oracle.plausible = Some(Plausible { law: &problem.law, free });
    oracle.lenient = true;
    let mut all = Vec::with_capacity(points.len());
    for point in points {
        // each has the step that it needs: soft ones would suffer from that of stiff ones
        oracle.substeps = 0;
        let loss = oracle.loss(point)?.unwrap_or(f64::INFINITY);
        all.push(Evaluation { unknowns: point.clone(), loss });
    }
    Ok(all)
}

/// The best of some evaluations that lie apart: each at least half a unit of a coordinate from those chosen before it.
pub fn apart(mut all: Vec<Evaluation>, law: &crate::physics::Law, free: Free, count: usize) -> Vec<Unknowns> {
    all.retain(|evaluation| evaluation.loss.is_finite());
    all.sort_by(|a, b| a.loss.total_cmp(&b.loss));
    let mut chosen: Vec<Unknowns> = Vec::new();
    for Evaluation { unknowns, .. } in all {
        let x = unknowns.coordinates(law, free);
        let near = |other: &Unknowns| other.coordinates(law, free).iter().zip(&x).all(|(a, b)| (a - b).abs() < 0.5);
        if chosen.len() < count && !chosen.iter().any(near) {
            chosen.push(unknowns);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_newtons_where_it_is_short_and_short_where_it_is_not() {
        let curvature = vec![vec![4.0, 1.0], vec![1.0, 2.0]];
        let step = damped_step(&[-1.0, 0.5], &curvature, 0.0, &[0.6, 0.6]).unwrap();
        // (4 1; 1 2) h = (1, −½): h = (2.5, −3)/7
        approx::assert_relative_eq!(step[0], 2.5 / 7.0, max_relative = 1e-6);
        approx::assert_relative_eq!(step[1], -3.0 / 7.0, max_relative = 1e-6);
        approx::assert_relative_eq!(promised(&[-1.0, 0.5], &curvature, &step), 2.0 / 7.0, max_relative = 1e-6);
        // flat along the second: it stays within the region of trust, and the first still goes its way
        let flat = vec![vec![4.0, 0.0], vec![0.0, 1e-7]];
        let step = damped_step(&[-1.0, -1e-6], &flat, 0.0, &[0.6, 0.6]).unwrap();
        assert!((step[0] - 0.25).abs() < 1e-3 && step[1] > 0.1 && step[1] <= 0.6, "{step:?}");
        assert!(damped_step(&[0.0], &[vec![0.0]], 1.0, &[1.0]).is_none());
    }
}
