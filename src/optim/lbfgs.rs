//! L-BFGS with a bracketing line search for the weak Wolfe conditions (Nocedal and Wright 2006, ch. 3 and 7).

use std::collections::VecDeque;

use crate::{Error, ErrorKind, Result};

/// Limited-memory BFGS for a function of a few to a few thousand numbers with its gradient.
///
/// ```
/// use gradreel::optim::Lbfgs;
///
/// // Rosenbrock's valley
/// let mut f = |p: &[f64]| {
///     let (a, b) = (1.0 - p[0], p[1] - p[0] * p[0]);
///     Ok((a * a + 100.0 * b * b, vec![-2.0 * a - 400.0 * p[0] * b, 200.0 * b]))
/// };
/// let found = Lbfgs { iterations: 200, tolerance: 1e-9, ..Lbfgs::default() }.minimise(&[-1.2, 1.0], &mut f, |_| Ok(()))?;
/// assert!((found[0] - 1.0).abs() < 1e-5 && (found[1] - 1.0).abs() < 1e-5);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Lbfgs {
    /// Curvature pairs kept.
    pub history: usize,
    /// Outer iterations at most.
    pub iterations: usize,
    /// Evaluations of the function at most.
    pub evaluations: usize,
    /// Stops when no coordinate moves by more than this.
    pub tolerance: f64,
    /// Length of the first trial along the direction.
    pub first_step: f64,
    /// Longest move of any coordinate in one trial.
    pub largest_move: f64,
    /// Armijo's constant: least relative decrease.
    pub c1: f64,
    /// The curvature constant: largest relative slope left.
    pub c2: f64,
    /// Trials of one line search at most.
    pub trials: usize,
}

impl Default for Lbfgs {
    fn default() -> Self {
        Self {
            history: 20,
            iterations: 100,
            evaluations: usize::MAX,
            tolerance: 1e-3,
            first_step: 1.0,
            largest_move: f64::INFINITY,
            c1: 1e-4,
            c2: 0.9,
            trials: 20,
        }
    }
}

/// One accepted step, for progress reports.
///
/// ```
/// use gradreel::optim::Lbfgs;
/// let mut f = |x: &[f64]| Ok(((x[0] - 2.0).powi(2), vec![2.0 * (x[0] - 2.0)]));
/// let mut losses = Vec::new();
/// Lbfgs::default().minimise(&[0.0], &mut f, |step| {
///     losses.push(step.value);
///     Ok(())
/// })?;
/// assert!(losses.is_sorted_by(|a, b| a >= b));
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct LbfgsStep<'a> {
    /// Outer iteration, from 1.
    pub iteration: usize,
    /// Evaluations so far.
    pub evaluations: usize,
    /// Where the step arrived.
    pub point: &'a [f64],
    /// The function there.
    pub value: f64,
    /// Largest move of a coordinate.
    pub moved: f64,
}

/// A value and its gradient.
type Sample = (f64, Vec<f64>);

/// A function that gives both at a point.
type Objective<'a> = dyn FnMut(&[f64]) -> Result<Sample> + 'a;

struct Pair {
    s: Vec<f64>,
    y: Vec<f64>,
}

impl Lbfgs {
    /// Minimises `f` from `start` and returns the best point seen. `each` is called after every accepted step; an error from
    /// it (an interruption, say) ends the search and is returned.
    ///
    /// ```
    /// use gradreel::optim::Lbfgs;
    /// let mut f = |x: &[f64]| Ok(((x[0] - 2.0).powi(2), vec![2.0 * (x[0] - 2.0)]));
    /// let found = Lbfgs::default().minimise(&[0.0], &mut f, |_| Ok(()))?;
    /// assert!((found[0] - 2.0).abs() < 1e-6);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::NonFinite`] when the function is not finite at the start; what `f` and `each` return.
    pub fn minimise(
        &self,
        start: &[f64],
        f: &mut Objective<'_>,
        mut each: impl FnMut(&LbfgsStep<'_>) -> Result<()>,
    ) -> Result<Vec<f64>> {
        let mut x = start.to_vec();
        let (mut value, mut gradient) = f(&x)?;
        if !value.is_finite() || gradient.iter().any(|g| !g.is_finite()) {
            return Err(Error::new(ErrorKind::NonFinite, "L-BFGS: the function is not finite at the start")
                .at(format!("{x:?}"))
                .found(format!("{value}, gradient {gradient:?}")));
        }
        let mut evaluations = 1;
        let mut pairs: VecDeque<Pair> = VecDeque::new();
        for iteration in 1..=self.iterations {
            let direction = two_loop(&gradient, &pairs);
            let slope = dot(&direction, &gradient);
            if slope >= 0.0 {
                break;
            }
            let reach = largest(&direction);
            let first = self.first_step.min(self.largest_move / reach);
            let (step, next) = self.line_search(&x, value, slope, &direction, first, f, &mut evaluations)?;
            let Some((new_value, new_gradient)) = next else {
                // the model of the curvature misled the search: forget it once, then give up
                if pairs.is_empty() {
                    break;
                }
                pairs.clear();
                continue;
            };
            let s: Vec<f64> = direction.iter().map(|d| step * d).collect();
            let y: Vec<f64> = new_gradient.iter().zip(&gradient).map(|(a, b)| a - b).collect();
            x.iter_mut().zip(&s).for_each(|(x, s)| *x += s);
            // a pair whose curvature is far below that of the model would spoil the next direction
            if dot(&y, &s) > 0.01 * step * step * -slope {
                pairs.push_back(Pair { s, y });
                if pairs.len() > self.history {
                    pairs.pop_front();
                }
            }
            (value, gradient) = (new_value, new_gradient);
            let moved = step * reach;
            each(&LbfgsStep { iteration, evaluations, point: &x, value, moved })?;
            if moved < self.tolerance {
                break;
            }
        }
        Ok(x)
    }

    /// Doubles the step until the minimum is bracketed, then bisects. Returns the accepted step with value and gradient, or
    /// the best decrease seen when the trials run out, or nothing when no trial was a decrease.
    #[expect(clippy::too_many_arguments, reason = "the state of one search, used here only")]
    fn line_search(
        &self,
        x: &[f64],
        value: f64,
        slope: f64,
        direction: &[f64],
        first: f64,
        f: &mut Objective<'_>,
        evaluations: &mut usize,
    ) -> Result<(f64, Option<Sample>)> {
        let (mut low, mut high, mut step) = (0.0, f64::INFINITY, first);
        let longest = self.largest_move / largest(direction);
        let mut best: (f64, Option<Sample>) = (0.0, None);
        for _ in 0..self.trials.min(self.evaluations.saturating_sub(*evaluations)) {
            let trial: Vec<f64> = x.iter().zip(direction).map(|(x, d)| x + step * d).collect();
            let (new, gradient) = f(&trial)?;
            *evaluations += 1;
            let armijo = new <= value + self.c1 * step * slope;
            let curvature = dot(&gradient, direction) >= self.c2 * slope;
            if new < best.1.as_ref().map_or(value, |(v, _)| *v) {
                best = (step, Some((new, gradient.clone())));
            }
            if !armijo || !new.is_finite() {
                high = step;
            } else if !curvature && step < longest {
                low = step;
            } else {
                return Ok((step, Some((new, gradient))));
            }
            step = if high.is_finite() { 0.5 * (low + high) } else { (2.0 * low).min(longest) };
        }
        Ok(best)
    }
}

/// `−H g` from the stored pairs; the initial scale is `yᵀs / yᵀy` of the newest.
fn two_loop(gradient: &[f64], pairs: &VecDeque<Pair>) -> Vec<f64> {
    let mut q: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut weights = Vec::with_capacity(pairs.len());
    for Pair { s, y } in pairs.iter().rev() {
        let weight = dot(s, &q) / dot(y, s);
        q.iter_mut().zip(y).for_each(|(q, y)| *q -= weight * y);
        weights.push(weight);
    }
    if let Some(Pair { s, y }) = pairs.back() {
        let scale = dot(y, s) / dot(y, y);
        q.iter_mut().for_each(|q| *q *= scale);
    }
    for (Pair { s, y }, weight) in pairs.iter().zip(weights.iter().rev()) {
        let correction = weight - dot(y, &q) / dot(y, s);
        q.iter_mut().zip(s).for_each(|(q, s)| *q += correction * s);
    }
    q
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
}
