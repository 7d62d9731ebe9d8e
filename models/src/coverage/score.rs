//! One unknown of one clip against its truth.

use serde::{Deserialize, Serialize};

use crate::identify::normal::below;

/// How an estimate compares with the truth, on the scale of the fit (decades for magnitudes).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// The estimate less the truth.
    pub error: f64,
    /// Whether the interval of 50 % holds the truth.
    pub inside_50: bool,
    /// Whether the interval of 90 % does.
    pub inside_90: bool,
    /// The share of the posterior below the truth.
    pub rank: f64,
    /// The logarithm of the posterior's density at the truth over the prior's: what the clip told, in nats.
    pub log_score: f64,
    /// Whether the fit says that the clip determines the unknown.
    pub determined: bool,
}

/// Quantiles of 95 % and 75 % of the standard normal distribution.
const Z: [f64; 2] = [1.644_853_626_951_472_2, 0.674_489_750_196_081_7];

impl Score {
    /// The score of an estimate with a posterior whose share below the truth is `rank` and whose density there is this; `ranks` are the
    /// shares below the ends of the interval of 90 %.
    pub fn of_posterior(error: f64, rank: f64, log_density: f64, determined: bool, log_prior: f64) -> Self {
        Self {
            error,
            inside_50: (0.25..=0.75).contains(&rank),
            inside_90: (0.05..=0.95).contains(&rank),
            rank,
            log_score: log_density - log_prior,
            determined,
        }
    }

    /// The score of a normal posterior with the mean `value` that has `interval_90` as its interval of 90 %; all on the scale
    /// of the fit. Of an interval that is not even about the value, the deviation is half its width over 1.645.
    pub fn normal(value: f64, interval_90: [f64; 2], determined: bool, truth: f64, log_prior: f64) -> Self {
        let deviation = (0.5 * (interval_90[1] - interval_90[0]) / Z[0]).max(f64::MIN_POSITIVE);
        let z = (truth - value) / deviation;
        let log_density = -0.5 * z * z - (deviation * std::f64::consts::TAU.sqrt()).ln();
        Self {
            error: value - truth,
            inside_50: z.abs() <= Z[1],
            inside_90: (interval_90[0]..=interval_90[1]).contains(&truth),
            rank: below(z),
            log_score: log_density - log_prior,
            determined,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_posterior_that_is_the_prior_tells_nothing() {
        let log_prior = |x: f64| -0.5 * x * x - std::f64::consts::TAU.sqrt().ln();
        for truth in [-1.7, -0.2, 0.9, 2.3] {
            let score = Score::normal(0.0, [-Z[0], Z[0]], false, truth, log_prior(truth));
            approx::assert_abs_diff_eq!(score.log_score, 0.0, epsilon = 1e-12);
            assert_eq!(score.inside_90, truth.abs() < Z[0]);
            assert_eq!(score.inside_50, truth.abs() < Z[1]);
        }
    }

    #[test]
    fn a_narrow_posterior_is_worth_more_where_it_is_right_and_less_where_it_is_wrong() {
        let of = |half: f64, value: f64| Score::normal(value, [value - half, value + half], true, 1.0, -1.0).log_score;
        assert!(of(0.1, 1.0) > of(1.0, 1.0));
        assert!(of(0.1, 1.5) < of(1.0, 1.5));
        // the standard tables: a truth at the 97.5 % quantile
        let score = Score::normal(0.0, [-Z[0], Z[0]], true, 1.959_964, -1.0);
        approx::assert_abs_diff_eq!(score.rank, 0.975, epsilon = 1e-6);
    }
}
