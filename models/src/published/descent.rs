//! A search along gradients that goes on where it was interrupted.

use gradreel::optim::Lbfgs;
use gradreel::{ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::identify::{Free, Problem, Substeps, Unknowns};

/// Length of the first trial in the coordinates of the unknowns: decades of a modulus, tenths of a metre per second.
const FIRST_MOVE: f64 = 0.25;

/// Longest move of one trial.
const LARGEST_MOVE: f64 = 0.5;

/// Least move that is still followed.
const TOLERANCE: f64 = 2e-3;

/// Trials of one line at most.
const TRIALS: usize = 6;

/// One evaluation of the forward model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Where.
    pub unknowns: Unknowns,
    /// The loss; nothing where the physics broke down.
    pub loss: Option<f64>,
    /// Its gradient in the coordinates of what is free; empty where it was not asked for.
    pub gradient: Vec<f64>,
    /// Substeps of a frame from here on.
    pub substeps: usize,
}

/// Loss and gradient at a point, with at least so many substeps.
type Evaluate<'e> = dyn FnMut(&mut Substeps) -> Result<(f64, Vec<f64>)> + 'e;

/// The answers of a search, those of an earlier process first.
pub(super) struct Answers<'a> {
    known: Vec<Answer>,
    next: usize,
    /// Substeps of a frame that the search has reached.
    substeps: Substeps,
    /// Hears of every new answer, with all of them.
    each: &'a mut dyn FnMut(&[Answer]) -> Result<()>,
}

impl<'a> Answers<'a> {
    /// The answers of an earlier process, to be gone through again.
    pub fn of(known: Vec<Answer>, each: &'a mut dyn FnMut(&[Answer]) -> Result<()>) -> Self {
        Self { known, next: 0, substeps: Substeps::default(), each }
    }

    /// The answer to the next request, made if it is not known. Where the physics breaks down there is no loss.
    ///
    /// # Errors
    /// What evaluating returns, but for [`ErrorKind::Physics`]; an error of the listener.
    pub fn at(&mut self, unknowns: &Unknowns, evaluate: &mut Evaluate<'_>) -> Result<Answer> {
        if self.next == self.known.len() {
            let (loss, gradient) = match evaluate(&mut self.substeps) {
                Err(error) if error.kind() == ErrorKind::Physics => (None, Vec::new()),
                found => {
                    let (loss, gradient) = found?;
                    match loss.is_finite() && gradient.iter().all(|g| g.is_finite()) {
                        true => (Some(loss), gradient),
                        false => (None, Vec::new()),
                    }
                }
            };
            self.known.push(Answer { unknowns: unknowns.clone(), loss, gradient, substeps: self.substeps.count });
            (self.each)(&self.known)?;
        }
        let answer = self.known[self.next].clone();
        self.substeps.count = answer.substeps;
        self.next += 1;
        Ok(answer)
    }

    /// Substeps for the next requests: those of a search with exact derivatives do not change without need.
    pub fn begin_with(&mut self, substeps: usize) {
        self.substeps.count = substeps;
    }

    /// What was said of retries with smaller steps.
    pub fn notes(&self) -> &[String] {
        &self.substeps.notes
    }
}

/// What counts beside the loss: its value and gradient at the coordinates of what is free.
pub(super) type Besides<'b> = dyn Fn(&[f64]) -> (f64, Vec<f64>) + 'b;

/// Minimises the loss of the first `frames` frames, and what counts `besides`, over what is free by L-BFGS, from `start`, with so many
/// evaluations at most; returns the best.
///
/// # Errors
/// What the problem returns; [`ErrorKind::Physics`] when it breaks down where the search starts.
pub(super) fn descend(
    problem: &Problem<'_>,
    start: &Unknowns,
    free: Free,
    frames: usize,
    evaluations: usize,
    besides: &Besides<'_>,
    answers: &mut Answers<'_>,
) -> Result<(Unknowns, f64)> {
    let mut best: Option<(Unknowns, f64)> = None;
    let mut scale = None;
    let mut objective = |x: &[f64]| {
        let unknowns = start.moved(&problem.law, free, x);
        let mut broke = None;
        let answer = answers.at(&unknowns, &mut |substeps| {
            let (loss, mut gradient) =
                problem.evaluate(&unknowns, free, frames, substeps).inspect_err(|error| broke = Some(error.clone()))?;
            let (more, slopes) = besides(x);
            gradient.iter_mut().zip(slopes).for_each(|(g, slope)| *g += slope);
            Ok((loss + more, gradient))
        })?;
        let Some(loss) = answer.loss else {
            return match (best.is_some(), broke) {
                // a trial too far
                (true, _) | (_, None) => Ok((f64::INFINITY, vec![0.0; x.len()])),
                (false, Some(error)) => Err(error),
            };
        };
        if best.as_ref().is_none_or(|(_, least)| loss < *least) {
            best = Some((unknowns, loss));
        }
        let steepest = answer.gradient.iter().fold(0.0f64, |most, g| most.max(g.abs()));
        let scale = *scale.get_or_insert(if steepest > 0.0 { FIRST_MOVE / steepest } else { 1.0 });
        Ok((loss * scale, answer.gradient.iter().map(|g| g * scale).collect()))
    };
    let search = Lbfgs {
        iterations: evaluations,
        evaluations,
        tolerance: TOLERANCE,
        largest_move: LARGEST_MOVE,
        trials: TRIALS,
        ..Lbfgs::default()
    };
    search.minimise(&start.coordinates(&problem.law, free), &mut objective, |_| Ok(()))?;
    best.ok_or_else(|| {
        gradreel::Error::new(ErrorKind::Physics, "the simulation breaks down where the search starts")
            .fix("start from other values of the material (--start)")
    })
}
