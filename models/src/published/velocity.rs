//! The initial velocity: the field's motion before contact, then gradients through the pictures of the flight.

use gradreel::Result;

use super::descent::{Answers, descend};
use crate::identify::{Free, Problem, Substeps, Unknowns};
use crate::vector::{dot, inverse, minus, times};

/// Standard deviation of each component that the fall's own is not below \[m/s\].
const LEAST: f64 = 0.03;

/// How well the fall tells the velocity: the inverse of its covariance \[s²/m²\].
pub(super) fn precision(covariance: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let mut spread = covariance;
    (0..3).for_each(|axis| spread[axis][axis] += LEAST * LEAST);
    inverse(spread)
}

/// The velocity that fits the pictures of the first `frames` frames, which are in free flight, from where `start` has it.
///
/// Pictures of one camera tell little of the velocity along its sight, and imagined ones tell it wrong. What the fall of a single camera's
/// film says counts as it does in a likelihood: with the loss `L` over `n` pictures, `n/2 · log L + ½ dᵀ C⁻¹ d`.
///
/// # Errors
/// As [`descend`].
pub(super) fn refined(
    problem: &Problem<'_>,
    start: &Unknowns,
    frames: usize,
    evaluations: usize,
    fall: Option<([f64; 3], [[f64; 3]; 3])>,
    answers: &mut Answers<'_>,
) -> Result<Unknowns> {
    if evaluations == 0 || frames < 2 {
        return Ok(start.clone());
    }
    let flying = problem.flying();
    let unit = Free::Velocity.list(&flying.law).first().map_or(1.0, |unknown| start.slope(&flying.law, *unknown));
    let least = flying.misfit(start, frames, &mut Substeps::default())?;
    let counts = 2.0 * least / frames as f64;
    let besides = |x: &[f64]| match &fall {
        None => (0.0, vec![0.0; x.len()]),
        Some((fallen, precision)) => {
            let off = minus([0, 1, 2].map(|axis| unit * x[axis]), *fallen);
            let pull = times(precision, off);
            (0.5 * counts * dot(off, pull), pull.map(|p| counts * unit * p).to_vec())
        }
    };
    let found = descend(&flying, start, Free::Velocity, frames, evaluations, &besides, answers);
    found.map(|(unknowns, _)| unknowns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fall_is_never_told_exactly() {
        let known = precision([[0.0; 3]; 3]);
        for axis in 0..3 {
            assert!((known[axis][axis] * LEAST * LEAST - 1.0).abs() < 1e-12);
        }
        let wide = precision([[0.01, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]);
        assert!(wide[0][0] < 0.1 * wide[1][1]);
    }
}
