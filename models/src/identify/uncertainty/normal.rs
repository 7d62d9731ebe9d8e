//! The standard normal distribution.

use std::f64::consts::{SQRT_2, TAU};

use gradreel::scalar::Real;

/// The share of the distribution below `z`.
pub(crate) fn below(z: f64) -> f64 {
    0.5 * (1.0 + Real::erf(z / SQRT_2))
}

/// The logarithm of its density.
pub(crate) fn log_density(z: f64) -> f64 {
    -0.5 * (z * z + TAU.ln())
}

/// The number below which a share `p` of the distribution lies, to twelve digits; within ±8.
pub(crate) fn quantile(p: f64) -> f64 {
    let (mut low, mut high) = (-8.0, 8.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if below(middle) < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of the standard tables.
    #[test]
    fn shares_and_quantiles() {
        for (z, p) in [(0.0, 0.5), (1.0, 0.841_344_746), (1.644_853_627, 0.95), (-1.959_963_985, 0.025)] {
            approx::assert_abs_diff_eq!(below(z), p, epsilon = 1e-8);
            approx::assert_abs_diff_eq!(quantile(p), z, epsilon = 1e-7);
        }
        approx::assert_abs_diff_eq!(log_density(1.0).exp(), 0.241_970_725, epsilon = 1e-9);
    }
}
