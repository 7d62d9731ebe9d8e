//! Profile of a flat direction: where the pictures hardly tell a coordinate, the likelihood is walked along instead of expanded.

use serde::{Deserialize, Serialize};

use super::covariance::Laplace;
use super::prior::Prior;
use crate::identify::model::unknowns::Unknown;

/// The likelihood along one coordinate, the others as the posterior expects them there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Profile {
    /// Place of the coordinate among the free unknowns.
    pub unknown: usize,
    /// Coordinates of all free unknowns at each point, in the order of the profiled one.
    pub line: Vec<Vec<f64>>,
    /// The mean of `ln L` over the frames there; nothing where it could not be simulated.
    pub log_loss: Vec<Option<f64>>,
}

/// A direction is flat if the pictures leave more than this share of the prior's deviation.
const FLAT: f64 = 0.5;

/// Points of a profile, and how far they reach in deviations of the prior.
const POINTS: usize = 9;
const REACH: f64 = 2.0;

/// The places of the parameters that the pictures hardly tell.
pub(crate) fn flat(laplace: &Laplace, prior: &Prior<'_>) -> Vec<usize> {
    let list = prior.free.list(prior.law);
    let open = |k: &usize| laplace.covariance[*k][*k].max(0.0).sqrt() > FLAT * prior.deviations()[*k];
    (0..list.len()).filter(|k| matches!(list[*k], Unknown::Parameter(_))).filter(open).collect()
}

/// Points along a coordinate through the range of the prior, the others at their conditional means.
pub(crate) fn line(laplace: &Laplace, prior: &Prior<'_>, k: usize) -> Vec<Vec<f64>> {
    let (deviation, limits) = (prior.deviations()[k], prior.limits());
    let point = |i: usize| {
        let z = REACH * (2.0 * i as f64 / (POINTS - 1) as f64 - 1.0);
        let [low, high] = limits[k];
        let x = (prior.mean[k] + z * deviation).clamp(low, high);
        let share = |j: usize| laplace.covariance[j][k] / laplace.covariance[k][k];
        let off = x - laplace.mean[k];
        let at =
            |j: usize| if j == k { x } else { (laplace.mean[j] + share(j) * off).clamp(limits[j][0], limits[j][1]) };
        (0..prior.mean.len()).map(at).collect::<Vec<f64>>()
    };
    let mut all: Vec<Vec<f64>> = (0..POINTS).map(point).collect();
    all.dedup_by(|a, b| a[k] == b[k]);
    all
}

impl Profile {
    /// The posterior along the coordinate, as normal parts with the logarithms of their weights, their means and deviations:
    /// `ln p = −½ count ln L / (1 + ΛD) + ln prior`, with `damped = 1 + ΛD`, by how much less the pictures count for what a simulation
    /// gets wrong. Nothing where fewer than three points could be simulated.
    pub fn parts(&self, prior: &Prior<'_>, count: f64, damped: f64) -> Vec<(f64, f64, f64)> {
        let known: Vec<(&Vec<f64>, f64)> =
            self.line.iter().zip(&self.log_loss).filter_map(|(x, log_loss)| Some((x, (*log_loss)?))).collect();
        let (Some(first), Some(last)) = (known.first(), known.last()) else { return Vec::new() };
        if known.len() < 3 {
            return Vec::new();
        }
        let (low, high) = (first.0[self.unknown], last.0[self.unknown]);
        let spacing = (high - low) / FINE as f64;
        let fine = |i: usize| {
            let x = low + spacing * i as f64;
            let (log_loss, at) = between(&known, self.unknown, x);
            (-0.5 * count * log_loss / damped - prior.cost(&at).0, x, spacing)
        };
        (0..=FINE).map(fine).collect()
    }
}

/// Parts of a profile's posterior.
const FINE: usize = 48;

/// The value at `x` and the coordinates there, between the neighbours on either side.
fn between(known: &[(&Vec<f64>, f64)], k: usize, x: f64) -> (f64, Vec<f64>) {
    let last = known.len() - 1;
    let right = known.iter().position(|(at, _)| at[k] >= x).unwrap_or(last).clamp(1, last);
    let ((a, low), (b, high)) = (known[right - 1], known[right]);
    let share = (x - a[k]) / (b[k] - a[k]);
    (low + share * (high - low), a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::uncertainty::mixture::Marginal;
    use crate::identify::{Free, Unknowns};
    use crate::physics::materials;

    fn with<R>(of: impl FnOnce(&Prior<'_>) -> R) -> R {
        let law = materials::find("neo_hookean").unwrap();
        let start = Unknowns { parameters: vec![1e5, 0.3], ..Unknowns::default() };
        of(&Prior::of(&law, Free::Magnitudes, &start, None))
    }

    fn laplace(mean: f64, deviation: f64) -> Laplace {
        Laplace { mean: vec![mean], covariance: vec![vec![deviation * deviation]], log_evidence: 0.0 }
    }

    #[test]
    fn what_the_pictures_tell_is_not_flat() {
        with(|prior| {
            let deviation = prior.deviations()[0];
            assert_eq!(flat(&laplace(0.0, 0.4 * deviation), prior), Vec::<usize>::new());
            assert_eq!(flat(&laplace(0.0, 0.6 * deviation), prior), [0]);
        });
    }

    /// The product of a normal likelihood and the prior is the normal distribution of the textbooks.
    #[test]
    fn a_parabola_has_a_normal_posterior() {
        with(|prior| {
            let (mean, own) = (prior.mean[0], prior.deviations()[0]);
            let (at, width) = (mean + 0.6 * own, 0.8 * own);
            let line = line(&laplace(mean, own), prior, 0);
            assert_eq!(line.len(), POINTS);
            // twenty residuals: −½ 20 ln L is −½ ((x − at)/width)²
            let log_loss = line.iter().map(|x| Some(((x[0] - at) / width).powi(2) / 20.0)).collect();
            let found = Marginal::of(Profile { unknown: 0, line, log_loss }.parts(prior, 20.0, 1.0));
            let precision = width.powi(-2) + own.powi(-2);
            let middle = (at * width.powi(-2) + mean * own.powi(-2)) / precision;
            approx::assert_abs_diff_eq!(found.quantile(0.5), middle, epsilon = 0.02 * own);
            let wide = found.quantile(0.841_344_746) - found.quantile(0.158_655_254);
            approx::assert_relative_eq!(wide, 2.0 / precision.sqrt(), max_relative = 0.05);
        });
    }

    /// Of a body that is too stiff to deform only the least stiffness is known, and the prior says the rest.
    #[test]
    fn a_wall_on_one_side_is_an_end_of_the_interval() {
        with(|prior| {
            let (mean, own) = (prior.mean[0], prior.deviations()[0]);
            let line = line(&laplace(mean, own), prior, 0);
            let log_loss = line.iter().map(|x| Some(if x[0] < mean - 1e-9 { 4.0 } else { 0.0 })).collect();
            let profile = Profile { unknown: 0, line, log_loss };
            let found = Marginal::of(profile.parts(prior, 20.0, 1.0));
            assert!(found.quantile(0.05) > mean - 0.5 * own, "{} {mean} {own}", found.quantile(0.05));
            // the upper half of a normal distribution: its median is 0.674 deviations above the middle
            approx::assert_abs_diff_eq!(found.quantile(0.5), mean + 0.674 * own, epsilon = 0.15 * own);
            // what a simulation gets wrong makes the wall low
            let low = Marginal::of(profile.parts(prior, 20.0, 1e3));
            assert!(low.quantile(0.25) < mean - 0.3 * own, "{}", low.quantile(0.25));
        });
    }

    #[test]
    fn what_could_not_be_simulated_is_left_out() {
        with(|prior| {
            let line = line(&laplace(prior.mean[0], 1.0), prior, 0);
            let mut log_loss = vec![Some(0.0); line.len()];
            log_loss[8] = None;
            let profile = Profile { unknown: 0, line, log_loss };
            assert!(profile.parts(prior, 20.0, 1.0).iter().all(|part| part.0.is_finite()));
            let broken = Profile { log_loss: vec![None; 9], ..profile };
            assert!(broken.parts(prior, 20.0, 1.0).is_empty());
        });
    }
}
