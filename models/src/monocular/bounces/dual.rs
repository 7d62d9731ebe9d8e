//! Numbers that carry their derivatives by the unknowns of a fit.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Largest number of unknowns.
pub(super) const MOST: usize = 64;

/// A value and its derivatives by each unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Dual {
    pub value: f64,
    pub slope: [f64; MOST],
}

impl Dual {
    /// A number that depends on nothing.
    pub fn of(value: f64) -> Self {
        Self { value, slope: [0.0; MOST] }
    }

    /// The unknown of a number.
    pub fn unknown(value: f64, number: usize) -> Self {
        let mut slope = [0.0; MOST];
        slope[number] = 1.0;
        Self { value, slope }
    }

    /// A function of it with its derivative.
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self { value, slope: self.slope.map(|s| derivative * s) }
    }

    /// A function of two with its derivatives.
    fn both(self, other: Self, value: f64, [a, b]: [f64; 2]) -> Self {
        Self { value, slope: std::array::from_fn(|k| a * self.slope[k] + b * other.slope[k]) }
    }

    pub fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }

    pub fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }

    pub fn exp(self) -> Self {
        self.chain(self.value.exp(), self.value.exp())
    }

    pub fn ln(self) -> Self {
        self.chain(self.value.ln(), 1.0 / self.value)
    }

    /// The root; next to 0, and below, of a number next to 0.
    pub fn sqrt(self) -> Self {
        let root = self.value.max(LEAST).sqrt();
        self.chain(root, 0.5 / root)
    }

    /// Variance for a covariance of the unknowns.
    pub fn variance(&self, covariance: &[Vec<f64>]) -> f64 {
        self.covariance_with(self, covariance)
    }

    /// Covariance with another number for one of the unknowns.
    pub fn covariance_with(&self, other: &Self, covariance: &[Vec<f64>]) -> f64 {
        let along = |row: &Vec<f64>| row.iter().zip(&other.slope).map(|(c, s)| c * s).sum::<f64>();
        covariance.iter().zip(&self.slope).map(|(row, s)| s * along(row)).sum()
    }
}

/// Least number whose root is taken.
const LEAST: f64 = 1e-12;

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.both(other, self.value + other.value, [1.0, 1.0])
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.both(other, self.value - other.value, [1.0, -1.0])
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.both(other, self.value * other.value, [other.value, self.value])
    }
}

impl Mul<f64> for Dual {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        self.chain(factor * self.value, factor)
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        self.both(other, value, [1.0 / other.value, -value / other.value])
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        self * -1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_differences() {
        let of = |x: [Dual; 3]| {
            let [a, b, c] = x;
            (a * b - c.sin()) / (b.exp() + a.cos() * 0.5) + (a * a + c * c).sqrt() - (-b).exp() * c.ln()
        };
        let at = [0.7, 0.4, 1.3];
        let value = of(std::array::from_fn(|k| Dual::unknown(at[k], k)));
        for k in 0..3 {
            let shifted =
                |sign: f64| of(std::array::from_fn(|j| Dual::of(at[j] + if j == k { sign * 1e-6 } else { 0.0 })));
            let difference = (shifted(1.0).value - shifted(-1.0).value) / 2e-6;
            assert!((value.slope[k] - difference).abs() < 1e-8, "{k}: {} for {difference}", value.slope[k]);
        }
    }

    #[test]
    fn deviations_propagate() {
        let (a, b) = (Dual::unknown(2.0, 0), Dual::unknown(3.0, 1));
        let covariance = vec![vec![0.04, 0.01], vec![0.01, 0.09]];
        // d(ab) = 3 da + 2 db
        assert!(((a * b).variance(&covariance) - (9.0 * 0.04 + 12.0 * 0.01 + 4.0 * 0.09)).abs() < 1e-12);
        assert!((a.covariance_with(&b, &covariance) - 0.01).abs() < 1e-12);
    }
}
