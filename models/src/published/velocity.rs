//! The initial velocity: the field's motion before contact, then gradients through the pictures of the flight.

use gradreel::Result;

use super::descent::{Answers, descend};
use crate::identify::{Free, Problem, Unknowns};

/// The velocity that fits the pictures of the first `frames` frames, which are in free flight, from where `start` has it.
///
/// # Errors
/// As [`descend`].
pub(super) fn refined(
    problem: &Problem<'_>,
    start: &Unknowns,
    frames: usize,
    evaluations: usize,
    answers: &mut Answers<'_>,
) -> Result<Unknowns> {
    if evaluations == 0 || frames < 2 {
        return Ok(start.clone());
    }
    let flying = problem.flying();
    descend(&flying, start, Free::Velocity, frames, evaluations, answers).map(|(unknowns, _)| unknowns)
}
