//! Unknowns moved by L-BFGS against the gradient that flows from the pixels, on the tape.

use gradreel::optim::Lbfgs;
use gradreel::{ErrorKind, Result};

use crate::identify::{Free, Problem, Substeps, Unknowns};

/// One evaluation of the forward model.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Where.
    pub unknowns: Unknowns,
    /// The loss there; infinite when the physics broke down.
    pub loss: f64,
}

/// Minimises the loss of the first `frames` frames over the free unknowns by reverse mode, within a number of evaluations, and
/// returns the best of them: for laws with many parameters, of which least squares would simulate each.
///
/// `each` sees every evaluation; an error from it (an interruption, say) ends the estimate and is returned. Retries with smaller steps
/// are noted with the `substeps`.
///
/// # Errors
/// What the problem returns at the start; later break-downs count as an infinite loss.
pub fn estimate(
    problem: &Problem<'_>,
    start: &Unknowns,
    free: Free,
    frames: usize,
    evaluations: usize,
    each: &mut dyn FnMut(&Evaluation) -> Result<()>,
    substeps: &mut Substeps,
) -> Result<Evaluation> {
    let mut best: Option<Evaluation> = None;
    let mut scale = None;
    // the loss is a mean of squared residuals of order 0.01: scaled so that the optimiser's unit step is of order 1
    let mut objective = |x: &[f64]| {
        let unknowns = start.moved(&problem.law, free, x);
        let (loss, gradient) = match problem.evaluate(&unknowns, free, frames, substeps) {
            Err(error) if error.kind() == ErrorKind::Physics && best.is_some() => {
                substeps.notes.push(format!("a trial was given up: {error}"));
                (f64::INFINITY, vec![0.0; x.len()])
            }
            found => found?,
        };
        let here = Evaluation { unknowns, loss };
        each(&here)?;
        if best.as_ref().is_none_or(|best| loss < best.loss) {
            best = Some(here);
        }
        let steepest = gradient.iter().fold(0.0f64, |most, g| most.max(g.abs()));
        let scale = *scale.get_or_insert(if steepest > 0.0 { FIRST_MOVE / steepest } else { 1.0 });
        Ok((loss * scale, gradient.iter().map(|g| g * scale).collect()))
    };
    let search = Lbfgs {
        iterations: evaluations,
        evaluations,
        tolerance: 2e-3,
        largest_move: LARGEST_MOVE,
        trials: 6,
        ..Lbfgs::default()
    };
    search.minimise(&start.coordinates(&problem.law, free), &mut objective, |_| Ok(()))?;
    Ok(best.expect("the start was evaluated"))
}

/// Length of the first trial in the optimiser's coordinates: decades of a modulus, tenths of a metre per second.
const FIRST_MOVE: f64 = 0.25;

/// Longest move of one trial.
const LARGEST_MOVE: f64 = 0.5;
