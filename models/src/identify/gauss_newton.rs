//! Gauss–Newton on the pixels: steps within a region of trust, from normal equations.

use gradreel::Result;

use crate::identify::oracle::{Answer, Listener, Oracle};
use crate::identify::plausible::Plausible;
use crate::identify::solve::{damped, promised};
use crate::identify::{Evaluation, Free, Linearised, Problem, Unknowns};

/// How many steps a search takes at most.
///
/// ```
/// use gradreel_models::identify::Steps;
///
/// assert_eq!(Steps::from(5), Steps { always: 5, falling: 0, hopeless: f64::INFINITY });
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// However little each of them gains.
    pub always: usize,
    /// More, as long as each lowers the loss by 1 %.
    pub falling: usize,
    /// The loss that half of the first have to reach: a search that is above it then ends.
    pub hopeless: f64,
}

impl From<usize> for Steps {
    fn from(always: usize) -> Self {
        Self { always, falling: 0, hopeless: f64::INFINITY }
    }
}

/// Minimises the loss of the first `frames` frames over the free unknowns by Levenberg and Marquardt's method, with at most
/// `steps` steps, and returns the best evaluation.
///
/// A step solves `(C + μ diag C) h = −g` with gradient and curvature of [`Problem::linearise`]; `μ` follows how well
/// steps keep what they promise (Nielsen 1999). No parameter moves farther than half of what its
/// plausible range calls a standard deviation (0.6 decades of four), and no velocity farther than 0.2 m/s, unless the loss
/// falls as promised; then up to four times as far. What the law holds to be implausible costs extra. `known`, `each` and `notes` as in [`estimate`](crate::identify::estimate).
///
/// # Errors
/// What the problem returns at the start; later break-downs are stepped back from.
#[expect(clippy::too_many_arguments, reason = "what is searched, and who hears of it, named")]
pub fn gauss_newton(
    problem: &Problem<'_>,
    start: &Unknowns,
    free: Free,
    frames: usize,
    steps: Steps,
    known: &[Answer],
    each: &mut Listener<'_>,
    notes: &mut dyn FnMut(String),
) -> Result<Evaluation> {
    let plausible = Plausible::new(&problem.law, free);
    search_most_probable(problem, plausible, start, None, frames, steps, known, each, notes)
}

/// The same, of the loss and what is said to be plausible.
#[expect(clippy::too_many_arguments, reason = "as above")]
pub(super) fn search_most_probable(
    problem: &Problem<'_>,
    plausible: Plausible<'_>,
    start: &Unknowns,
    first: Option<(Linearised, usize)>,
    frames: usize,
    steps: Steps,
    known: &[Answer],
    each: &mut Listener<'_>,
    notes: &mut dyn FnMut(String),
) -> Result<Evaluation> {
    let (law, free) = (&problem.law, plausible.free);
    let mut oracle = Oracle::new(problem, frames, known, each, notes);
    let limits = plausible.limits();
    (oracle.plausible, oracle.first) = (Some(plausible), first);
    let mut here = start.clone();
    let mut x = start.coordinates(law, free);
    if x.is_empty() {
        // everything is held: there is nothing to search
        oracle.loss(start)?;
        return Ok(oracle.best.expect("the start was evaluated"));
    }
    let (mut damping, mut growth) = (DAMPING, 2.0);
    let mut before: Option<Vec<f64>> = None;
    for taken in 1..=steps.always + steps.falling {
        // the step of the simulation that the unknowns need now: that of a stiffer start would damp the motion otherwise
        oracle.substeps = 0;
        let Answer { loss, gradient, curvature, .. } = oracle.linearised(&here, free)?;
        let (Some(value), false) = (loss, curvature.is_empty()) else { break };
        let longest = Plausible::new(law, free).longest_step(&here);
        let (mut decrease, mut failed) = (0.0, None::<Vec<f64>>);
        for trial in 0..TRIALS {
            if trial > 0 {
                damping *= 2.0 * growth;
                growth *= 2.0;
            }
            let Some(step) = damped(&gradient, &curvature, damping, &longest) else { break };
            if step.iter().all(|h| h.abs() < NEGLIGIBLE) {
                break;
            }
            if failed.as_ref().is_some_and(|failed| alike(failed, &step, &longest)) {
                continue;
            }
            failed = Some(step.clone());
            let moved = along(&x, &step, 1.0, &limits);
            let step: Vec<f64> = moved.iter().zip(&x).map(|(moved, x)| moved - x).collect();
            let there = start.moved(law, free, &moved);
            let new = oracle.loss(&there)?.unwrap_or(f64::INFINITY);
            let gain = (value - new) / promised(&gradient, &curvature, &step);
            if new < value {
                damping = (damping * (1.0f64 / 3.0).max(1.0 - (2.0 * gain - 1.0).powi(3))).clamp(1e-6, 1e3);
                growth = 2.0;
                let from = std::mem::replace(&mut x, moved);
                (decrease, here) = (value - new, there);
                // far from the minimum pictures change only at the edges of things, and a step is far too short: on along it
                let mut far = 2.0;
                let long = step.iter().zip(&longest).any(|(h, longest)| h.abs() > LONG * longest);
                // and in a narrow valley every step is, and goes the way of the one before
                let valley = before.as_ref().is_some_and(|before| cosine(before, &step, &longest) > STRAIGHT);
                let farthest = if valley { FARTHEST_ALONG } else { FARTHEST };
                while (valley || long && gain > KEPT) && far <= farthest {
                    let moved = along(&from, &step, far, &limits);
                    let there = start.moved(law, free, &moved);
                    let new = oracle.loss(&there)?.unwrap_or(f64::INFINITY);
                    if new >= value - decrease {
                        break;
                    }
                    (decrease, x, here) = (value - new, moved, there);
                    // it was damped too much
                    damping = (damping / 2.0).max(1e-6);
                    far *= 2.0;
                }
                // where it went it goes on most often: what is beyond tells more than what is behind
                oracle.sides = step.clone();
                before = Some(step);
                break;
            }
        }
        if decrease <= if problem.secant > 0.0 { LITTLE_BY_SECANTS } else { LITTLE } * value {
            // differences over a long way see no narrow valley: over a shorter one, or at the end
            if !oracle.reaches_less() {
                break;
            }
            (damping, growth) = (DAMPING, 2.0);
        }
        let hopeless = oracle.best.as_ref().is_some_and(|best| best.loss > steps.hopeless);
        let given_up = taken == steps.always / 2 && hopeless;
        if given_up || taken >= steps.always && decrease < FALLING * value {
            break;
        }
    }
    if steps.always + steps.falling == 0 {
        oracle.loss(start)?;
    }
    Ok(oracle.best.expect("the start was evaluated"))
}

/// The damping of a first step.
const DAMPING: f64 = 1e-3;

/// Trials of one step at most, each shorter.
const TRIALS: usize = 5;

/// A step that differs by less than this share from one that failed is not tried: the damping was far too small for either.
const ALIKE: f64 = 0.1;

/// Whether two steps are the same but for [`ALIKE`], each coordinate in units of the longest step.
fn alike(a: &[f64], b: &[f64], longest: &[f64]) -> bool {
    let square = |of: &dyn Fn(usize) -> f64| (0..a.len()).map(|k| (of(k) / longest[k]).powi(2)).sum::<f64>();
    square(&|k| a[k] - b[k]) < ALIKE * ALIKE * square(&|k| a[k])
}

/// A step that keeps this share of what it promises is followed farther…
const KEPT: f64 = 0.75;

/// …if it is at least this share of the longest: near the minimum a step is right as it is.
const LONG: f64 = 0.1;

/// How many times its length at most.
const FARTHEST: f64 = 4.0;

/// The cosine of the angle between two steps that is enough to follow the second farther, whatever its length…
const STRAIGHT: f64 = 0.8;

/// …how many times its length at most.
const FARTHEST_ALONG: f64 = 16.0;

/// The cosine of the angle between two steps, each coordinate in units of the longest step.
fn cosine(a: &[f64], b: &[f64], longest: &[f64]) -> f64 {
    let product = |a: &[f64], b: &[f64]| (0..a.len()).map(|k| a[k] * b[k] / longest[k].powi(2)).sum::<f64>();
    product(a, b) / (product(a, a) * product(b, b)).sqrt().max(f64::MIN_POSITIVE)
}

/// `x + far h`, no farther beyond the limits than `x` is.
fn along(x: &[f64], step: &[f64], far: f64, limits: &[[f64; 2]]) -> Vec<f64> {
    let within = |((x, h), [low, high]): ((&f64, &f64), &[f64; 2])| (x + far * h).clamp(low.min(*x), high.max(*x));
    x.iter().zip(step).zip(limits).map(within).collect()
}

/// A step is over when no coordinate moves farther than this.
const NEGLIGIBLE: f64 = 1e-3;

/// A search is over when a step lowers the loss by less than this share.
const LITTLE: f64 = 3e-4;

/// The same where derivatives are differences; they then reach less far, until they may not.
const LITTLE_BY_SECANTS: f64 = 1e-3;

/// A search goes on beyond the steps that it has in any case while each lowers the loss by this share.
const FALLING: f64 = 0.01;

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
    oracle.plausible = Some(Plausible::new(&problem.law, free));
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
    fn steps_are_alike_in_units_of_the_longest() {
        let longest = [0.6, 1e-3];
        assert!(alike(&[0.3, 0.0], &[0.28, 0.0], &longest));
        assert!(!alike(&[0.3, 0.0], &[0.25, 0.0], &longest));
        assert!(!alike(&[0.3, 0.0], &[0.3, 2e-4], &longest), "a short unknown counts as much");
        assert!(!alike(&[0.0, 0.0], &[0.0, 1e-9], &longest));
    }
}
