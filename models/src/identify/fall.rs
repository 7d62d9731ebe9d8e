//! What the free fall says of the velocity and the distance of what a single camera saw, before the pixels after it are asked.

use faer::{Mat, Side};
use gradreel::{Error, ErrorKind, Result};

use crate::video::Flight;

/// A velocity, and with it a distance, known to a covariance: what is expected, and directions at right angles along which it is unsure
/// independently.
#[derive(Debug, Clone)]
pub(crate) struct Fallen {
    /// The expected velocity \[m/s\]; the distance is expected to be what it was taken to be.
    pub middle: [f64; 3],
    /// Unit vectors of three components of the velocity and, if it may be another, the distance as a share of it.
    directions: Vec<Vec<f64>>,
    /// Standard deviations along them.
    deviations: Vec<f64>,
}

/// A velocity is nowhere surer than this \[m/s\]: the error of a silhouette's contour.
const LEAST: f64 = 1e-3;

impl Fallen {
    /// What a fall says of the velocity, and, if asked, of the distance with it: whoever is farther away falls as many pixels faster. Alone, the
    /// velocity is as unsure as it is with any distance.
    ///
    /// # Errors
    /// [`ErrorKind::NonFinite`] for a covariance that is not finite.
    pub fn of(flight: &Flight, distance: bool) -> Result<Self> {
        let count = if distance { 4 } else { 3 };
        let entry = |i: usize, j: usize| match (i.min(j), i.max(j)) {
            (3, 3) => flight.deviation * flight.deviation,
            (axis, 3) => flight.velocity_with_distance[axis],
            (i, j) => flight.velocity_covariance[i][j],
        };
        let covariance = Mat::from_fn(count, count, entry);
        let not_finite = || Error::new(ErrorKind::NonFinite, "the covariance of the velocity is not finite").at("fall");
        if !covariance.as_ref().is_all_finite() {
            return Err(not_finite());
        }
        let eigen = covariance.self_adjoint_eigen(Side::Lower).map_err(|_| not_finite())?;
        let (u, s) = (eigen.U(), eigen.S().column_vector());
        let directions = (0..count).map(|k| (0..count).map(|i| u[(i, k)]).collect()).collect();
        let deviations = (0..count).map(|k| s[k].max(0.0).sqrt().max(LEAST)).collect();
        Ok(Self { middle: flight.velocity, directions, deviations })
    }

    /// How many unknowns it tells of: the components of the velocity and, perhaps, the distance.
    pub fn count(&self) -> usize {
        self.deviations.len()
    }

    /// How far one standard deviation along direction `k` leads.
    pub fn step(&self, k: usize) -> Vec<f64> {
        self.directions[k].iter().map(|along| along * self.deviations[k]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps make up the covariance.
    #[test]
    fn a_covariance_in_directions() {
        let of_velocity = [[0.05, 0.01, -0.02], [0.01, 0.02, 0.0], [-0.02, 0.0, 0.09]];
        let flight = Flight {
            centre: [0.0; 3],
            velocity: [1.0, -2.0, 0.5],
            velocity_covariance: of_velocity,
            velocity_with_distance: [0.002, -0.004, 0.001],
            gravity: [0.0, -9.8, 0.0],
            frames: 4,
            distance: 2.0,
            diameter: 0.2,
            deviation: 0.05,
            scales_world: false,
        };
        let [a, b, c] = flight.velocity_with_distance;
        let whole: Vec<Vec<f64>> = (0..3)
            .map(|i| of_velocity[i].into_iter().chain([flight.velocity_with_distance[i]]).collect())
            .chain([vec![a, b, c, 0.05 * 0.05]])
            .collect();
        for distance in [false, true] {
            let fallen = Fallen::of(&flight, distance).unwrap();
            let count = fallen.count();
            assert_eq!(count, if distance { 4 } else { 3 });
            for i in 0..count {
                for j in 0..count {
                    let made: f64 = (0..count).map(|k| fallen.step(k)[i] * fallen.step(k)[j]).sum();
                    approx::assert_relative_eq!(made, whole[i][j], epsilon = 1e-12);
                }
            }
        }
        let lost = Flight { velocity_covariance: [[f64::NAN; 3]; 3], ..flight };
        assert_eq!(Fallen::of(&lost, false).unwrap_err().kind(), ErrorKind::NonFinite);
        let lost = Flight { deviation: f64::INFINITY, ..flight };
        assert_eq!(Fallen::of(&lost, true).unwrap_err().kind(), ErrorKind::NonFinite);
    }
}
