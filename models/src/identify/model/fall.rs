//! What the free fall says of velocity, distance and pitch of what a single camera saw, before the pixels after it are asked.

use faer::{Mat, Side};
use gradreel::{Error, ErrorKind, Result};

use crate::identify::model::unknowns::Unknown;
use crate::video::Flight;

/// A velocity, and with it a distance and a pitch, known to a covariance: what is expected, and directions at right angles along which it
/// is unsure independently.
#[derive(Debug, Clone)]
pub(crate) struct Fallen {
    /// The expected velocity \[m/s\]; distance and pitch are expected to be what they were taken to be.
    pub middle: [f64; 3],
    /// What it tells of.
    pub unknowns: Vec<Unknown>,
    /// Unit vectors in the space of these.
    directions: Vec<Vec<f64>>,
    /// Standard deviations along them.
    deviations: Vec<f64>,
}

/// A velocity is nowhere surer than this \[m/s\]: the error of a silhouette's contour.
const LEAST: f64 = 1e-3;

impl Fallen {
    /// What a fall says of the velocity, and, if they may be others, of the distance and the pitch with it: what is further away falls
    /// as many pixels faster. Alone, the velocity is as unsure as it is with any distance and pitch.
    ///
    /// # Errors
    /// [`ErrorKind::NonFinite`] for a covariance that is not finite.
    pub fn of(flight: &Flight, distance: bool, pitch: bool) -> Result<Self> {
        let open = [distance.then_some(Unknown::DISTANCE), pitch.then_some(Unknown::PITCH)];
        let unknowns: Vec<Unknown> = (0..3).map(Unknown::Velocity).chain(open.into_iter().flatten()).collect();
        let count = unknowns.len();
        let entry = |i: usize, j: usize| match (unknowns[i.min(j)], unknowns[i.max(j)]) {
            (Unknown::Velocity(i), Unknown::Velocity(j)) => flight.velocity_covariance[i][j],
            (Unknown::Velocity(axis), Unknown::DISTANCE) => flight.velocity_with_distance[axis],
            (Unknown::Velocity(axis), _) => flight.pitch.with_velocity[axis],
            (Unknown::DISTANCE, Unknown::DISTANCE) => flight.deviation * flight.deviation,
            (Unknown::DISTANCE, _) => flight.pitch.with_distance,
            _ => flight.pitch.deviation * flight.pitch.deviation,
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
        Ok(Self { middle: flight.velocity, unknowns, directions, deviations })
    }

    /// How far one standard deviation along direction `k` leads.
    pub fn step(&self, k: usize) -> Vec<f64> {
        self.directions[k].iter().map(|along| along * self.deviations[k]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::video::PitchSpread;

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
            pitch: PitchSpread { deviation: 0.3, with_velocity: [0.01, -0.02, 0.03], with_distance: 0.01 },
        };
        let [a, b, c] = flight.velocity_with_distance;
        let whole = [
            [0.05, 0.01, -0.02, a, 0.01],
            [0.01, 0.02, 0.0, b, -0.02],
            [-0.02, 0.0, 0.09, c, 0.03],
            [a, b, c, 0.05 * 0.05, 0.01],
            [0.01, -0.02, 0.03, 0.01, 0.3 * 0.3],
        ];
        for (distance, pitch) in [(false, false), (true, false), (false, true), (true, true)] {
            let fallen = Fallen::of(&flight, distance, pitch).unwrap();
            let kept: Vec<usize> = (0..5).filter(|k| *k < 3 || [distance, pitch][k - 3]).collect();
            assert_eq!(fallen.unknowns.len(), kept.len());
            for (i, &row) in kept.iter().enumerate() {
                for (j, &column) in kept.iter().enumerate() {
                    let made: f64 = (0..kept.len()).map(|k| fallen.step(k)[i] * fallen.step(k)[j]).sum();
                    approx::assert_relative_eq!(made, whole[row][column], epsilon = 1e-12);
                }
            }
        }
        let lost = Flight { velocity_covariance: [[f64::NAN; 3]; 3], ..flight };
        assert_eq!(Fallen::of(&lost, false, false).unwrap_err().kind(), ErrorKind::NonFinite);
        let lost = Flight { deviation: f64::INFINITY, ..flight };
        assert_eq!(Fallen::of(&lost, true, true).unwrap_err().kind(), ErrorKind::NonFinite);
    }
}
