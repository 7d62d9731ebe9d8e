//! What the free fall says of the velocity of what a single camera saw, before the pixels after it are asked.

use faer::{Mat, Side};
use gradreel::{Error, ErrorKind, Result};

use crate::vector::{dot, minus};
use crate::video::Flight;

/// A velocity that is known to a covariance: a middle, and three directions at right angles along which it is unsure
/// independently.
#[derive(Debug, Clone)]
pub(super) struct Fallen {
    /// The expected velocity \[m/s\].
    pub middle: [f64; 3],
    /// Unit vectors.
    directions: [[f64; 3]; 3],
    /// Standard deviations along them \[m/s\].
    deviations: [f64; 3],
}

/// A velocity is nowhere surer than this \[m/s\]: what a silhouette's outline is wrong by.
const LEAST: f64 = 1e-3;

impl Fallen {
    /// What a fall says.
    ///
    /// # Errors
    /// [`ErrorKind::NonFinite`] for a covariance that is not finite.
    pub fn of(flight: &Flight) -> Result<Self> {
        let covariance = Mat::from_fn(3, 3, |i, j| flight.velocity_covariance[i][j]);
        let not_finite = || Error::new(ErrorKind::NonFinite, "the covariance of the velocity is not finite").at("fall");
        if !flight.velocity_covariance.iter().flatten().all(|value| value.is_finite()) {
            return Err(not_finite());
        }
        let eigen = covariance.self_adjoint_eigen(Side::Lower).map_err(|_| not_finite())?;
        let (u, s) = (eigen.U(), eigen.S().column_vector());
        let directions = std::array::from_fn(|k| std::array::from_fn(|i| u[(i, k)]));
        let deviations = std::array::from_fn(|k| s[k].max(0.0).sqrt().max(LEAST));
        Ok(Self { middle: flight.velocity, directions, deviations })
    }

    /// How far a velocity is from the middle along each direction, in standard deviations.
    pub fn standard(&self, velocity: [f64; 3]) -> [f64; 3] {
        let off = minus(velocity, self.middle);
        std::array::from_fn(|k| dot(self.directions[k], off) / self.deviations[k])
    }

    /// The derivative of direction `k`'s standard distance with respect to each component.
    pub fn rate(&self, k: usize) -> [f64; 3] {
        self.directions[k].map(|along| along / self.deviations[k])
    }

    /// How far one standard deviation along direction `k` leads \[m/s\].
    pub fn step(&self, k: usize) -> [f64; 3] {
        self.directions[k].map(|along| along * self.deviations[k])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps and rates are inverse, and steps make up the covariance.
    #[test]
    fn a_covariance_in_directions() {
        let covariance = [[0.05, 0.01, -0.02], [0.01, 0.02, 0.0], [-0.02, 0.0, 0.09]];
        let flight = Flight {
            centre: [0.0; 3],
            velocity: [1.0, -2.0, 0.5],
            velocity_covariance: covariance,
            gravity: [0.0, -9.8, 0.0],
            frames: 4,
            deviation: 0.05,
        };
        let fallen = Fallen::of(&flight).unwrap();
        for i in 0..3 {
            for j in 0..3 {
                let made: f64 = (0..3).map(|k| fallen.step(k)[i] * fallen.step(k)[j]).sum();
                approx::assert_relative_eq!(made, covariance[i][j], epsilon = 1e-12);
                approx::assert_relative_eq!(dot(fallen.step(i), fallen.rate(j)), f64::from(i == j), epsilon = 1e-12);
            }
        }
        let there = [0, 1, 2].map(|i| flight.velocity[i] + 2.0 * fallen.step(1)[i]);
        let z = fallen.standard(there);
        approx::assert_relative_eq!(z[1], 2.0, max_relative = 1e-9);
        assert!(z[0].abs() < 1e-9 && z[2].abs() < 1e-9);
        let lost = Flight { velocity_covariance: [[f64::NAN; 3]; 3], ..flight };
        assert_eq!(Fallen::of(&lost).unwrap_err().kind(), ErrorKind::NonFinite);
    }
}
