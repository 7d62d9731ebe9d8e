//! Metres from gravity: the acceleration in the picture against that of a falling body.

use super::chain::Chain;
use super::flight::{Flight, middle};
use super::search::{GRAVITY, Scene};

/// Relative deviation of the scale that an unknown camera leaves: its pitch, which shortens lengths along gravity, the
/// perspective, and rows that are read one after the other while the object moves along them.
const CAMERA: f64 = 0.1;

/// Least relative deviation of the size by one flight.
const LEAST_OWN: f64 = 0.03;

/// Error of the edges of a component \[pixels\]: half a pixel on either side.
const EDGES: f64 = 0.7;

/// A diameter with its relative standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::video::film) struct Size {
    /// Diameter \[m\].
    pub metres: f64,
    /// Relative standard deviation.
    pub deviation: f64,
}

impl Size {
    /// The diameter that the flights of a chain give, each by its own acceleration and width: an object that comes
    /// nearer grows in both.
    ///
    /// `D = g w / a`, with the extent `w` across the motion, which blur does not change.
    pub fn of(scene: &Scene<'_>, chain: &Chain) -> Self {
        let mut each: Vec<(f64, f64)> = Vec::new();
        for link in &chain.links {
            let width = width(scene, &link.flight);
            let own = (EDGES / width).hypot(link.own).max(LEAST_OWN);
            each.push((GRAVITY * width / link.acceleration, 1.0 / (own * own)));
        }
        let weights: f64 = each.iter().map(|(_, weight)| weight).sum();
        let mean = each.iter().map(|(size, weight)| size.ln() * weight).sum::<f64>() / weights;
        let off = each.iter().map(|(size, weight)| (size.ln() - mean).powi(2) * weight).sum::<f64>();
        // scatter beyond that of the fits widens it; the edges err alike in all
        let excess = (off / (each.len() as f64 - 1.0).max(1.0)).max(1.0);
        let width = middle(chain.links.iter().map(|link| link.flight.across).collect());
        let deviation = (excess / weights).sqrt().hypot(EDGES / width).hypot(CAMERA);
        Self { metres: mean.exp(), deviation }
    }

    /// Bounds that hold it with a probability of 90 %.
    pub fn interval_90(&self) -> [f64; 2] {
        [-1.645, 1.645].map(|z| self.metres * (z * self.deviation).exp())
    }
}

/// Diameter of the object of a flight \[pixels\]: the larger of the extent across the motion and that along it,
/// without the blur, which grows with the speed.
fn width(scene: &Scene<'_>, flight: &Flight) -> f64 {
    let points = flight.members.iter().map(|spot| {
        let (piece, velocity) = (scene.piece(*spot), flight.path.velocity_at(scene.times[spot.0]));
        let along = piece.across_direction([-velocity[1], velocity[0]]);
        (velocity[0].hypot(velocity[1]).powi(2), along * along)
    });
    let points: Vec<(f64, f64)> = points.collect();
    let count = points.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (v, l) = (mean(&|p| p.0), mean(&|p| p.1));
    let (vv, vl) = (mean(&|p| (p.0 - v).powi(2)), mean(&|p| (p.0 - v) * (p.1 - l)));
    // the square of the extent grows with that of the speed; a body without blur has slope 0
    let slope = if vv > 0.0 { (vl / vv).max(0.0) } else { 0.0 };
    let slowest = points.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let fastest = points.iter().map(|p| p.0).fold(0.0, f64::max);
    let still = (l - slope * v).max(0.0).sqrt();
    // a long body is longer at all speeds; where no slow picture tells it from blur, the width across counts
    match slowest < 0.25 * fastest && still > LONG * flight.across {
        true => still,
        false => flight.across,
    }
}

/// Least ratio of the extents of a body that is longer along its motion.
const LONG: f64 = 1.2;
