//! The posterior as a mixture of normal distributions, and what it says of each unknown.

use serde::{Deserialize, Serialize};

use super::normal;

/// What is known of one coordinate: a mixture of normal distributions.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Marginal {
    /// Weight, mean and standard deviation of each part; the weights sum to 1.
    pub parts: Vec<[f64; 3]>,
}

impl Marginal {
    /// A mixture of parts with these logarithms of weights.
    pub fn of(parts: impl IntoIterator<Item = (f64, f64, f64)>) -> Self {
        let parts: Vec<(f64, f64, f64)> = parts.into_iter().collect();
        let most = parts.iter().map(|part| part.0).fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = parts.iter().map(|part| (part.0 - most).exp()).sum();
        let part = |(log, mean, deviation): (f64, f64, f64)| [(log - most).exp() / total, mean, deviation];
        Self { parts: parts.into_iter().map(part).collect() }
    }

    /// The share below `x`.
    pub fn below(&self, x: f64) -> f64 {
        self.parts.iter().map(|[weight, mean, deviation]| weight * normal::below((x - mean) / deviation)).sum()
    }

    /// The logarithm of the density at `x`.
    pub fn log_density(&self, x: f64) -> f64 {
        let terms: Vec<f64> = self
            .parts
            .iter()
            .map(|[weight, mean, deviation]| {
                weight.max(f64::MIN_POSITIVE).ln() + normal::log_density((x - mean) / deviation) - deviation.ln()
            })
            .collect();
        let most = terms.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
        most + terms.iter().map(|term| (term - most).exp()).sum::<f64>().ln()
    }

    /// The number below which a share `p` lies.
    pub fn quantile(&self, p: f64) -> f64 {
        let ends = |sign: f64| self.parts.iter().map(move |[_, mean, deviation]| mean + sign * 9.0 * deviation);
        let (mut low, mut high) =
            (ends(-1.0).fold(f64::INFINITY, f64::min), ends(1.0).fold(f64::NEG_INFINITY, f64::max));
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if self.below(middle) < p { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mixture_of_one_is_normal() {
        let one = Marginal::of([(-700.0, 2.0, 0.5)]);
        approx::assert_abs_diff_eq!(one.below(2.5), 0.841_344_746, epsilon = 1e-8);
        approx::assert_abs_diff_eq!(one.quantile(0.95), 2.0 + 0.5 * 1.644_853_627, epsilon = 1e-7);
        approx::assert_abs_diff_eq!(one.log_density(2.5).exp(), 2.0 * 0.241_970_725, epsilon = 1e-8);
    }

    #[test]
    fn parts_count_by_their_weights() {
        // three to one
        let two = Marginal::of([(3f64.ln(), -10.0, 0.1), (0.0, 10.0, 0.1)]);
        approx::assert_abs_diff_eq!(two.below(0.0), 0.75, epsilon = 1e-12);
        approx::assert_abs_diff_eq!(two.quantile(0.375), -10.0, epsilon = 1e-6);
        approx::assert_abs_diff_eq!(two.quantile(0.875), 10.0, epsilon = 1e-6);
        let nowhere = Marginal::of([(0.0, 0.0, 1.0), (f64::NEG_INFINITY, 99.0, 1.0)]);
        assert_eq!(nowhere.parts[1][0], 0.0);
    }
}
