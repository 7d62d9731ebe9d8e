//! Estimates: unknowns moved by L-BFGS against the gradient that flows from the pixels.

use gradreel::optim::Lbfgs;
use gradreel::{ErrorKind, Result};

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
/// `each` sees every evaluation; an error from it (an interruption, say) ends the estimate and is returned. `notes` hears of
/// retries with smaller steps.
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
    notes: &mut dyn FnMut(String),
) -> Result<Evaluation> {
    let mut best: Option<Evaluation> = None;
    let mut substeps = 0;
    // the loss is a mean of squared residuals of order 0.01: scaled so that the optimiser's unit step is of order 1
    let mut scale = 1.0;
    let mut objective = |x: &[f64]| {
        let unknowns = start.moved(&problem.law, free, x);
        let first = best.is_none();
        let (loss, mut gradient) = match problem.evaluate(&unknowns, free, frames, &mut substeps, notes) {
            Err(error) if error.kind() == ErrorKind::Physics && !first => {
                notes(format!("a trial was given up: {error}"));
                (f64::INFINITY, vec![0.0; x.len()])
            }
            evaluated => evaluated?,
        };
        if first {
            let steepest = gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
            scale = if steepest > 0.0 { first_move(free) / steepest } else { 1.0 };
        }
        let evaluation = Evaluation { unknowns, loss };
        each(&evaluation)?;
        if best.as_ref().is_none_or(|best| loss < best.loss) {
            best = Some(evaluation);
        }
        gradient.iter_mut().for_each(|g| *g *= scale);
        Ok((loss * scale, gradient))
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
    Ok(best.expect("the start was evaluated"))
}

/// Length of the first trial in the optimiser's coordinates (decades of a modulus, tenths of a metre per second): bold where
/// the start may be far off, short where an estimate is refined.
fn first_move(free: Free) -> f64 {
    match free {
        Free::Velocity | Free::Magnitudes => 0.25,
        Free::Material | Free::Both => 0.06,
    }
}

/// Longest move of one trial.
const LARGEST_MOVE: f64 = 0.5;
