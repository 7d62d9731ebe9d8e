//! How sure a point is, by the curvature of its loss.
//!
//! With the loss `L` over `n` pictures that count as one each, `−log p = n/2 · log L`, so that the curvature `H` of Gauss and Newton
//! makes `n/(2L) · H` of it; plausible ranges add theirs. Shape and views are taken as they are: the intervals know nothing of
//! their errors.

use faer::prelude::Solve;
use faer::{Mat, Side};
use gradreel::Result;

use crate::identify::{Free, Interval, Problem, Substeps, Unknowns, coordinate};
use crate::physics::{Law, Map, NINETY};

/// Standard deviation of a component of the velocity that is known of nothing \[its coordinates: a tenth of a m/s\].
const FREE_SPEED: f64 = 30.0;

/// Intervals of what is free around an estimate; `None` where the curvature cannot be inverted.
///
/// # Errors
/// What the forward model returns.
pub(super) fn around(
    problem: &Problem<'_>,
    at: &Unknowns,
    free: Free,
    weights: &[f64],
    substeps: &mut Substeps,
) -> Result<Option<Vec<Interval>>> {
    let frames = problem.observed.targets.len();
    let linearised = problem.linearise(at, free, frames, substeps)?;
    let (sum, squares) = weights.iter().fold((0.0, 0.0), |(sum, squares), w| (sum + w, squares + w * w));
    let pictures = frames as f64 * if squares > 0.0 { sum * sum / squares } else { 1.0 };
    Ok(of_curvature(problem, at, free, linearised.loss, &linearised.curvature, pictures))
}

fn of_curvature(
    problem: &Problem<'_>,
    at: &Unknowns,
    free: Free,
    loss: f64,
    curvature: &[Vec<f64>],
    pictures: f64,
) -> Option<Vec<Interval>> {
    let law = &problem.law;
    let list = free.list(law);
    let count = list.len();
    let plausible: Vec<f64> = list.iter().map(|unknown| plausible(law, &unknown.name(law))).collect();
    let scale = pictures / (2.0 * loss.max(f64::MIN_POSITIVE));
    let information =
        Mat::from_fn(count, count, |i, j| scale * curvature[i][j] + if i == j { plausible[i].powi(-2) } else { 0.0 });
    let covariance = information.llt(Side::Lower).ok()?.solve(&Mat::<f64>::identity(count, count));
    let coordinates = at.coordinates(law, free);
    let interval = |k: usize| {
        let deviation = covariance[(k, k)].sqrt();
        let value = |sign: f64| {
            let mut moved = coordinates.clone();
            moved[k] += sign * NINETY * deviation;
            list[k].of(&at.moved(law, free, &moved))
        };
        let ends = [value(-1.0), value(1.0)];
        let interval_90 = within(law, &list[k].name(law), list[k].of(at), [ends[0].min(ends[1]), ends[0].max(ends[1])]);
        let sound = deviation.is_finite() && interval_90.iter().all(|end| end.is_finite());
        let determined = 3.0 * deviation <= plausible[k];
        sound.then(|| Interval { name: list[k].name(law), interval_90, determined })
    };
    (0..count).map(interval).collect()
}

/// The standard deviation of an unknown before anything is seen, in its coordinate.
fn plausible(law: &Law, name: &str) -> f64 {
    let parameter = law.parameters().iter().find(|parameter| parameter.name == name);
    let ends = parameter.map(|parameter| parameter.prior.map(|end| coordinate(law, name, end)));
    match ends {
        Some([Some((low, _)), Some((high, _))]) => (high - low) / (2.0 * NINETY),
        _ => FREE_SPEED,
    }
}

/// What bounds a parameter that is no magnitude bounds its interval, unless the estimate itself lies beyond.
fn within(law: &Law, name: &str, value: f64, [low, high]: [f64; 2]) -> [f64; 2] {
    let parameter = law.parameters().iter().find(|parameter| parameter.name == name);
    match parameter.filter(|parameter| parameter.map != Map::Log10) {
        Some(parameter) => [low.max(parameter.prior[0].min(value)), high.min(parameter.prior[1].max(value))],
        None => [low, high],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::materials;

    #[test]
    fn intervals_of_ratios_stay_within_what_is_possible() {
        let law = materials::find("neo_hookean").unwrap();
        let prior = law.parameters()[1].prior;
        assert_eq!(within(&law, "poisson", 0.3, [-2.0, 2.0]), prior);
        assert_eq!(within(&law, "young", 1e5, [1.0, 1e9]), [1.0, 1e9]);
        // an estimate beyond what is plausible stays in its interval
        assert_eq!(within(&law, "poisson", prior[1] + 0.01, [0.1, 2.0]), [0.1, prior[1] + 0.01]);
    }

    #[test]
    fn what_is_known_of_nothing_is_as_wide_as_what_is_plausible() {
        let law = materials::find("neo_hookean").unwrap();
        let [low, high] = law.parameters()[0].prior.map(f64::log10);
        assert!((plausible(&law, "young") - (high - low) / (2.0 * NINETY)).abs() < 1e-9);
        assert_eq!(plausible(&law, "velocity_x"), FREE_SPEED);
    }
}
