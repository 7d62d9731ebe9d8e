//! Estimates: unknowns moved by L-BFGS against the gradient that flows from the pixels.

use gradreel::Result;
use gradreel::optim::Lbfgs;

use crate::identify::oracle::{Answer, Listener, Oracle};
use crate::identify::{Free, Problem, Unknowns};

/// One evaluation of the forward model.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Evaluation {
    /// Where.
    pub unknowns: Unknowns,
    /// The loss there; infinite when the physics broke down.
    pub loss: f64,
}

/// Minimises the loss of the first `frames` frames over the free unknowns, within a number of evaluations, and returns the
/// best of them.
///
/// `known` are the answers of a search that was interrupted: it is gone through again without computing them. `each` sees
/// every evaluation, with its answer if it is new; an error from it (an interruption, say) ends the estimate and is returned.
/// `notes` hears of retries with smaller steps.
///
/// # Errors
/// What the problem returns at the start; later break-downs count as an infinite loss.
#[expect(clippy::too_many_arguments, reason = "what is searched, and who hears of it, named")]
pub fn estimate(
    problem: &Problem<'_>,
    start: &Unknowns,
    free: Free,
    frames: usize,
    evaluations: usize,
    known: &[Answer],
    each: &mut Listener<'_>,
    notes: &mut dyn FnMut(String),
) -> Result<Evaluation> {
    let mut oracle = Oracle::new(problem, frames, known, each, notes);
    if free.list(&problem.law).is_empty() {
        oracle.loss(start)?;
        return Ok(oracle.best.expect("the start was evaluated"));
    }
    // the loss is a mean of squared residuals of order 0.01: scaled so that the optimiser's unit step is of order 1
    let mut scale = 1.0;
    let mut first = true;
    let mut objective = |x: &[f64]| {
        let answer = oracle.gradient(&start.moved(&problem.law, free, x), free)?;
        let Some(loss) = answer.loss else { return Ok((f64::INFINITY, vec![0.0; x.len()])) };
        if std::mem::replace(&mut first, false) {
            let steepest = answer.gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
            scale = if steepest > 0.0 { first_move(free) / steepest } else { 1.0 };
        }
        Ok((loss * scale, answer.gradient.iter().map(|g| g * scale).collect()))
    };
    let search = Lbfgs {
        iterations: evaluations,
        evaluations,
        tolerance: 2e-3,
        largest_move: LARGEST_MOVE,
        trials: 6,
        ..Lbfgs::default()
    };
    let x = start.coordinates(&problem.law, free);
    search.minimise(&x, &mut objective, |_| Ok(()))?;
    Ok(oracle.best.expect("the start was evaluated"))
}

/// Length of the first trial in the optimiser's coordinates (decades of a modulus, tenths of a metre per second): bold where
/// the start may be far off, short where an estimate is refined.
fn first_move(free: Free) -> f64 {
    match free {
        Free::Velocity | Free::Magnitudes => 0.25,
        _ => 0.06,
    }
}

/// Longest move of one trial.
const LARGEST_MOVE: f64 = 0.5;
