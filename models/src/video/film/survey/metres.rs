//! Metres from gravity: the acceleration in the picture against that of a falling body.

use super::chain::Chain;
use super::flight::{Flight, middle};
use super::search::Scene;
use crate::video::parabola::GRAVITY;

/// Relative deviation of the scale that a camera leaves whose pitch is known: distortion, and rows that are read one after the other
/// while the object moves along them.
const CAMERA: f64 = 0.05;

/// Mean and standard deviation of the logarithm of a size for a camera that looks down by an unknown angle, in that for a level one: of
/// the cosine of 20° ± 18°.
const PITCHED: (f64, f64) = (-0.12, 0.14);

/// Relative deviation of the size of a body whose length along its motion cannot be told from blur.
const SHAPE: f64 = 0.1;

/// Least relative deviation of the size by one flight.
const LEAST_OWN: f64 = 0.03;

/// Error of the edges of a component \[pixels\]: half a pixel on either side.
const EDGES: f64 = 0.7;

/// A diameter with its relative standard deviation: of the disc that the object covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::video::film) struct Size {
    /// Diameter \[m\].
    pub metres: f64,
    /// Relative standard deviation.
    pub deviation: f64,
    /// The same for a camera that is known to be level.
    pub level: [f64; 2],
}

impl Size {
    /// The diameter that the flights of a chain give, each by its own acceleration and width: an object that comes
    /// nearer grows in both.
    ///
    /// `D = g w / a`, with the extent `w` across the motion, which blur does not change.
    pub fn of(scene: &Scene<'_>, chain: &Chain) -> Self {
        let mut each: Vec<(f64, f64)> = Vec::new();
        for link in &chain.links {
            let (width, _) = width(scene, &link.flight);
            let own = (EDGES / width).hypot(link.own).max(LEAST_OWN);
            each.push((GRAVITY * width / link.acceleration, 1.0 / (own * own)));
        }
        let weights: f64 = each.iter().map(|(_, weight)| weight).sum();
        let mean = each.iter().map(|(size, weight)| size.ln() * weight).sum::<f64>() / weights;
        let off = each.iter().map(|(size, weight)| (size.ln() - mean).powi(2) * weight).sum::<f64>();
        // scatter beyond that of the fits widens it; the edges err alike in all
        let excess = (off / (each.len() as f64 - 1.0).max(1.0)).max(1.0);
        let width = middle(chain.links.iter().map(|link| link.flight.across).collect());
        let is_known = chain.links.iter().any(|link| self::width(scene, &link.flight).1);
        let shape = if is_known { 0.0 } else { SHAPE };
        let deviation = (excess / weights).sqrt().hypot(EDGES / width).hypot(CAMERA).hypot(shape);
        Self { metres: (mean + PITCHED.0).exp(), deviation: deviation.hypot(PITCHED.1), level: [mean.exp(), deviation] }
    }

    /// Bounds that hold it with a probability of 90 %.
    pub fn interval_90(&self) -> [f64; 2] {
        [-1.645, 1.645].map(|z| self.metres * (z * self.deviation).exp())
    }
}

/// Diameter of the disc that the object of a flight covers \[pixels\], by its extents across the motion and along it; blur lengthens the
/// latter and grows with the speed. Whether the length is known; else the extent across the motion stands for both.
pub(super) fn width(scene: &Scene<'_>, flight: &Flight) -> (f64, bool) {
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
    let is_known = slowest < 0.25 * fastest && still > 0.0;
    // longer than it can be, or thinner: the fit of the blur failed
    let still = still.clamp(flight.across / LONGEST, flight.across * LONGEST);
    (if is_known { (still * flight.across).sqrt() } else { flight.across }, is_known)
}

/// Largest ratio of the extents of a body.
const LONGEST: f64 = 3.0;
