//! The material: gradients through the simulation and the renderer, from the best of a few magnitudes.

use gradreel::Result;

use super::descent::{Answers, descend};
use crate::identify::{Free, Problem, RangePenalty, Unknowns};
use crate::physics::{Law, Map};

/// Where the search may start: as the law starts, and with all magnitudes that are free evenly over their plausible ranges.
pub(super) fn starts(law: &Law, start: &Unknowns, held: &[&str], ranges: &RangePenalty, count: usize) -> Vec<Unknowns> {
    let magnitude = |share: f64| {
        let mut tried = start.clone();
        for (parameter, value) in law.parameters().iter().zip(&mut tried.parameters) {
            if parameter.map == Map::Log10 && !held.contains(&parameter.name) {
                let [low, high] = ranges.range(law, parameter).map(f64::log10);
                *value = 10f64.powf(low + share * (high - low));
            }
        }
        tried
    };
    let shares = (0..count).map(|k| (k as f64 + 0.5) / count as f64);
    std::iter::once(start.clone()).chain(shares.map(magnitude)).collect()
}

/// The material that fits the pictures of all frames: the best start, then L-BFGS with exact derivatives.
///
/// # Errors
/// As [`descend`].
pub(super) fn searched(
    problem: &Problem<'_>,
    starts: &[Unknowns],
    free: Free,
    evaluations: usize,
    answers: &mut Answers<'_>,
) -> Result<Unknowns> {
    let frames = problem.observed.targets.len();
    let mut best: Option<(&Unknowns, f64)> = None;
    // a single start needs no comparison
    for start in starts.iter().filter(|_| starts.len() > 1) {
        answers.begin_with(0);
        let quick = Problem { least_speed: 0.0, ..problem.clone() };
        let answer = answers.at(start, &mut |substeps| Ok((quick.misfit(start, frames, substeps)?, Vec::new())))?;
        if let Some(loss) = answer.loss.filter(|loss| best.is_none_or(|(_, least)| *loss < least)) {
            best = Some((start, loss));
        }
    }
    let start = best.map_or(&starts[0], |(start, _)| start);
    if free.list(&problem.law).is_empty() {
        return Ok(start.clone());
    }
    answers.begin_with(0);
    let nothing = |x: &[f64]| (0.0, vec![0.0; x.len()]);
    descend(problem, start, free, frames, evaluations, &nothing, answers).map(|(unknowns, _)| unknowns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::materials;

    #[test]
    fn starts_are_spread_over_what_is_plausible() {
        let law = materials::find("neo_hookean").unwrap();
        let start = Unknowns { parameters: law.start_values(), ..Unknowns::default() };
        let found = starts(&law, &start, &[], &RangePenalty::default(), 5);
        assert_eq!((found.len(), &found[0]), (6, &start));
        let young: Vec<f64> = found[1..].iter().map(|at| at.parameters[0].log10()).collect();
        for (found, wanted) in young.iter().zip([3.85, 4.55, 5.25, 5.95, 6.65]) {
            assert!((found - wanted).abs() < 1e-9, "{young:?}");
        }
        assert!(found.iter().all(|at| at.parameters[1] == start.parameters[1]), "Poisson's ratio is no magnitude");
        let held = starts(&law, &start, &["young"], &RangePenalty::default(), 2);
        assert!(held.iter().all(|at| at.parameters == start.parameters));
    }
}
