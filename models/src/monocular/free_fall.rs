//! Depth of a falling object: ballistic fit to the silhouettes of one camera.

use std::cell::Cell;

use gradreel::Result;
use gradreel::optim::{LevenbergMarquardt, Residuals};

use super::sighting::Sighting;
use crate::vector::{dot, times};
use crate::video::parabola::{GRAVITY, Parabola};
use crate::video::{Camera, Flight, PitchSpread};

/// Standard deviation of a silhouette's centroid: a share of its side, with a minimum in pixels.
const MIDDLE: [f64; 2] = [0.003, 0.25];

/// Standard deviation of the logarithm of a silhouette's side. It covers the error of the approximate body under
/// changing viewing directions; too small a value turns this error into spurious motion along the line of sight.
const SIZE: f64 = 0.05;

/// Standard deviation of the change of that logarithm over the fall that is not of depth: a body that turns, or is seen from elsewhere,
/// shows another side, little by little.
const TURNS: f64 = 0.1;

/// The same for blur: so much for a body that moves by its own size from one picture to the next, at the end of the fall. Faint edges are
/// lost, or a streak counts as the body.
const BLURRED: f64 = 0.3;

/// Standard deviation of the initial velocity along the line of sight \[m/s\] of what is let go or thrown before a camera, in films
/// whose scale is not known otherwise.
const TOWARDS: f64 = 0.3;

/// Number of times that sightings are trusted less because of their scatter.
const SOFTENED: usize = 3;

/// Maximum growth of the cost by another ballistic frame, as a multiple of the residual variance: the 5 % level for
/// its three residuals. Contact may displace the object by as little as half a pixel.
const SURPRISE: f64 = 4.0;

/// Direction of gravity in camera coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Down {
    /// Known: a unit vector in camera coordinates (x right, y up, looking along −z).
    Known([f64; 3]),
    /// The camera is upright and pitched downwards by an uncertain angle \[rad\].
    Tilted {
        /// Expected angle.
        angle: f64,
        /// Its standard deviation.
        deviation: f64,
    },
}

impl Down {
    /// The direction at an angle, and its derivative.
    fn at(self, angle: f64) -> ([f64; 3], [f64; 3]) {
        match self {
            Self::Known(direction) => (direction, [0.0; 3]),
            Self::Tilted { .. } => ([0.0, -angle.cos(), -angle.sin()], [0.0, angle.sin(), -angle.cos()]),
        }
    }
}

/// A ballistic trajectory in camera coordinates, in units of the initial depth along the camera axis.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeFall {
    /// Number of fitted frames, counted from the first.
    pub frames: usize,
    /// Initial position; its third component is −1.
    pub start: [f64; 3],
    /// Initial velocity \[1/s\].
    pub velocity: [f64; 3],
    /// Unit vector of gravity.
    pub down: [f64; 3],
    /// Downward pitch of the camera \[rad\], if fitted.
    pub angle: f64,
    /// Gravity \[1/s²\].
    pub gravity: f64,
    /// Relative standard deviation of `gravity`, and hence of every length derived from it.
    pub deviation: f64,
    /// Covariance of the metric velocity in units of the distance \[1/s²\]; it includes the uncertainty of
    /// `gravity`.
    pub spread: [[f64; 3]; 3],
    /// Covariance of that velocity with the logarithm of the distance \[1/s\].
    pub with_distance: [f64; 3],
    /// Variance of the pitch \[rad²\]; 0 if it is known.
    pub angle_variance: f64,
    /// Covariances of the pitch with that velocity \[rad/s\], in camera axes, and with the logarithm of the distance \[rad\].
    pub with_angle: ([f64; 3], f64),
    /// `½ Σ r²`, residuals in standard deviations.
    pub cost: f64,
}

/// What is known of a fall besides its sightings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Direction of gravity.
    pub down: Down,
    /// Downward acceleration in the image \[pixels/s²\], of the parabola through all positions of the fall, and its standard deviation.
    pub acceleration: Option<[f64; 2]>,
}

impl From<Down> for Prior {
    fn from(down: Down) -> Self {
        Self { down, acceleration: None }
    }
}

impl FreeFall {
    /// Position at a time \[s\].
    pub fn at(&self, t: f64) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.start[axis] + self.velocity[axis] * t + 0.5 * self.gravity * self.down[axis] * t * t)
    }

    /// How the velocity in world axes changes with the pitch \[1/s\]: the camera's axes turn about the first, to the right.
    fn turning(&self, turn: &[[f64; 3]; 3]) -> [f64; 3] {
        if self.angle_variance == 0.0 {
            return [0.0; 3];
        }
        let [_, y, z] = self.velocity;
        times(turn, [0.0, z, -y])
    }

    /// Covariance of the velocity \[m²/s²\] in world axes, where `turn` rotates camera to world coordinates, at a
    /// distance \[m\].
    pub fn velocity_covariance(&self, turn: &[[f64; 3]; 3], distance: f64) -> [[f64; 3]; 3] {
        let (turning, with_angle) = (self.turning(turn), times(turn, self.with_angle.0));
        std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let of_axes = with_angle[i] * turning[j] + turning[i] * with_angle[j];
                let own = dot(turn[i], times(&self.spread, turn[j]));
                distance * distance * (own + of_axes + turning[i] * turning[j] * self.angle_variance)
            })
        })
    }

    /// Covariance of the velocity with the relative distance \[m/s\] for the same arguments.
    pub fn velocity_with_distance(&self, turn: &[[f64; 3]; 3], distance: f64) -> [f64; 3] {
        let (turning, own) = (self.turning(turn), times(turn, self.with_distance));
        std::array::from_fn(|axis| distance * (own[axis] + turning[axis] * self.with_angle.1))
    }

    /// How uncertain the pitch is, for the same arguments.
    pub fn pitch_spread(&self, turn: &[[f64; 3]; 3], distance: f64) -> PitchSpread {
        let (turning, own) = (self.turning(turn), times(turn, self.with_angle.0));
        PitchSpread {
            deviation: self.angle_variance.sqrt(),
            with_velocity: std::array::from_fn(|axis| distance * (own[axis] + turning[axis] * self.angle_variance)),
            with_distance: self.with_angle.1,
        }
    }

    /// Fits `sightings` with a ballistic trajectory. `bias` is the difference between a sighting and the projection
    /// of the object's centre: centroid \[pixels\] and log size.
    ///
    /// # Errors
    /// [`gradreel::ErrorKind::NonFinite`] for sightings that are not finite.
    ///
    /// # Panics
    /// If `sightings` is empty.
    pub fn fit(camera: &Camera, sightings: &[Sighting], bias: &[[f64; 3]], prior: Prior) -> Result<Self> {
        let Prior { down, acceleration } = prior;
        let first = sightings.first().expect("at least one sighting");
        let offset = |k: usize| bias.get(k).copied().unwrap_or_default();
        let middle = (MIDDLE[0] * first.size.exp()).max(MIDDLE[1]);
        let tilt = match down {
            Down::Known(_) => None,
            Down::Tilted { angle, deviation } => Some((angle, deviation)),
        };
        // x/d, y/d, velocity/d, gravity/d, log size at distance 1, the angle, and the change of the log size
        let drift = 7 + usize::from(tilt.is_some());
        let columns = drift + 1;
        let last = sightings.last().map_or(0.0, |last| last.time - first.time).max(f64::MIN_POSITIVE);
        let changes = TURNS.hypot(BLURRED * moved(sightings).min(1.0));
        let weights = Parabola::weights(&sightings.iter().map(|sighting| sighting.time).collect::<Vec<_>>());
        // residuals of the sightings count so much less where they scatter more than expected; what is known beforehand does not
        let firm = Cell::new(1.0);
        let mut model = |p: &[f64], _: bool| {
            let firm = firm.get();
            let rows = 3 * sightings.len() + 1 + usize::from(tilt.is_some()) + 2 * usize::from(acceleration.is_some());
            let mut all =
                Residuals { values: Vec::with_capacity(rows), columns: vec![Vec::with_capacity(rows); columns] };
            let (direction, turned) = down.at(if tilt.is_some() { p[7] } else { 0.0 });
            for (k, sighting) in sightings.iter().enumerate() {
                let (t, half) = (sighting.time, 0.5 * sighting.time * sighting.time);
                let x: [f64; 3] = std::array::from_fn(|axis| {
                    [p[0], p[1], -1.0][axis] + p[2 + axis] * t + p[5] * half * direction[axis]
                });
                let depth = if x[2] < 0.0 { -x[2] } else { f64::NAN };
                let [du, dv, ds] = offset(k);
                let gone = (sighting.time - first.time) / last;
                // each residual with its derivative with respect to x
                let rows: [(f64, [f64; 3]); 3] = [
                    (
                        (camera.cx + camera.fx * x[0] / depth + du - sighting.middle[0]) / middle,
                        [camera.fx / depth / middle, 0.0, camera.fx * x[0] / (depth * depth) / middle],
                    ),
                    (
                        (camera.cy - camera.fy * x[1] / depth + dv - sighting.middle[1]) / middle,
                        [0.0, -camera.fy / depth / middle, -camera.fy * x[1] / (depth * depth) / middle],
                    ),
                    ((p[6] + gone * p[drift] - depth.ln() + ds - sighting.size) / SIZE, [0.0, 0.0, 1.0 / depth / SIZE]),
                ];
                for (row, (value, by)) in rows.into_iter().enumerate() {
                    let (value, by) = (firm * value, by.map(|x| firm * x));
                    let along = |v: [f64; 3]| by[0] * v[0] + by[1] * v[1] + by[2] * v[2];
                    all.values.push(value);
                    let start = [by[0], by[1], t * by[0], t * by[1], t * by[2], half * along(direction)];
                    let size = [if row == 2 { firm / SIZE } else { 0.0 }];
                    let angle = tilt.map(|_| p[5] * half * along(turned));
                    let change = size.map(|by| gone * by);
                    let derivatives = start.into_iter().chain(size).chain(angle).chain(change);
                    all.columns.iter_mut().zip(derivatives).for_each(|(column, d)| column.push(d));
                }
            }
            let expected = tilt.map(|(angle, deviation)| (7, angle, deviation));
            for (index, value, deviation) in expected.into_iter().chain([(drift, 0.0, changes)]) {
                all.values.push((p[index] - value) / deviation);
                let by = |j: usize| if j == index { 1.0 / deviation } else { 0.0 };
                all.columns.iter_mut().enumerate().for_each(|(j, column)| column.push(by(j)));
            }
            if let Some(([pixels, deviation], weights)) = acceleration.zip(weights.as_ref()) {
                // that of the parabola through the positions, with the perspective that they have
                let of = |rows: &[f64]| -> f64 {
                    let down = weights.iter().enumerate().map(|(k, weight)| weight * rows[3 * k + 1]);
                    middle / firm / deviation * down.sum::<f64>()
                };
                let seen = weights.iter().zip(sightings).map(|(weight, sighting)| weight * sighting.middle[1]);
                let value = of(&all.values) + (seen.sum::<f64>() - pixels) / deviation;
                all.values.push(value);
                all.columns.iter_mut().for_each(|column| column.push(of(column)));
                // the velocity in m/s: gravity is the unit of length
                let metres = GRAVITY / p[5].abs().max(f64::MIN_POSITIVE) / TOWARDS;
                all.values.push(metres * p[4]);
                let by = |j: usize| match j {
                    4 => metres,
                    5 => -metres * p[4] / p[5],
                    _ => 0.0,
                };
                all.columns.iter_mut().enumerate().for_each(|(j, column)| column.push(by(j)));
            }
            Ok(all)
        };
        let [u, v] = first.middle;
        let pull = acceleration.map_or(0.0, |[pixels, _]| pixels / camera.fy);
        let mut start =
            vec![(u - camera.cx) / camera.fx, -(v - camera.cy) / camera.fy, 0.0, 0.0, 0.0, pull, first.size];
        start.extend(tilt.map(|(angle, _)| angle));
        start.push(0.0);
        let mut fit = LevenbergMarquardt::default().minimise(&start, &mut model)?;
        let cost = fit.cost;
        let scatter = |point: &[f64], model: &mut dyn FnMut(&[f64], bool) -> Result<Residuals>| {
            let rows = 3 * sightings.len();
            let sum: f64 = model(point, false)?.values[..rows].iter().map(|r| r * r).sum();
            Ok::<_, gradreel::Error>((sum / (rows as f64 - 7.0).max(1.0)).sqrt())
        };
        for _ in 0..SOFTENED {
            let more = scatter(&fit.point, &mut model)?;
            if more.is_nan() || more <= 1.1 {
                break;
            }
            firm.set(firm.get() / more);
            fit = LevenbergMarquardt::default().minimise(&start, &mut model)?;
        }
        let p = &fit.point;
        let angle = if tilt.is_some() { p[7] } else { 0.0 };
        // residuals are normalised: their scatter rescales the covariance only if it exceeds 1
        let variance = fit.variance.unwrap_or(1.0);
        let known = fit.undetermined.is_empty();
        let covariance = |i: usize, j: usize| {
            if known { fit.covariance[i][j] / variance * variance.max(1.0) } else { f64::INFINITY }
        };
        // v = g/γ w, so that dv = g/γ (dw − w dγ/γ)
        let rate = [p[2] / p[5], p[3] / p[5], p[4] / p[5]];
        let spread = |i: usize, j: usize| {
            let with_scale = rate[j] * covariance(2 + i, 5) + rate[i] * covariance(2 + j, 5);
            covariance(2 + i, 2 + j) - with_scale + rate[i] * rate[j] * covariance(5, 5)
        };
        // the distance is g/γ, hence d ln(distance) = −dγ/γ
        let with_distance = |i: usize| (rate[i] * covariance(5, 5) - covariance(2 + i, 5)) / p[5];
        let of_angle = |i: usize| if tilt.is_some() { covariance(i, 7) } else { 0.0 };
        let with_angle = std::array::from_fn(|i| of_angle(2 + i) - rate[i] * of_angle(5));
        Ok(Self {
            frames: sightings.len(),
            start: [p[0], p[1], -1.0],
            velocity: [p[2], p[3], p[4]],
            down: down.at(angle).0,
            angle,
            gravity: p[5],
            deviation: covariance(5, 5).sqrt() / p[5].abs(),
            spread: std::array::from_fn(|i| std::array::from_fn(|j| spread(i, j))),
            with_distance: std::array::from_fn(with_distance),
            angle_variance: of_angle(7),
            with_angle: (with_angle, -of_angle(5) / p[5]),
            cost,
        })
    }

    /// The longest ballistic phase from the first sighting on: frames are added until one does not fit. `None` with
    /// fewer than three frames, or if gravity is not resolved.
    ///
    /// # Errors
    /// Those of [`FreeFall::fit`].
    pub fn longest(camera: &Camera, sightings: &[Sighting], bias: &[[f64; 3]], prior: Prior) -> Result<Option<Self>> {
        let mut found: Option<Self> = None;
        for frames in Flight::LEAST_FRAMES..=sightings.len() {
            let longer = Self::fit(camera, &sightings[..frames], bias, prior)?;
            // the larger of expected and observed noise
            let noise = |shorter: &Self| (2.0 * shorter.cost / (3 * shorter.frames - 7) as f64).max(1.0);
            if found.as_ref().is_some_and(|shorter| longer.cost - shorter.cost > SURPRISE * noise(shorter)) {
                break;
            }
            found = Some(longer);
        }
        Ok(found.filter(Self::is_sure))
    }

    /// Whether its gravity, and hence the scale, is resolved.
    pub fn is_sure(&self) -> bool {
        self.gravity > 0.0 && self.deviation < UNSURE
    }
}

/// By how much a body moves between the last two pictures, in its size.
fn moved(sightings: &[Sighting]) -> f64 {
    let [.., a, b] = sightings else { return 0.0 };
    (b.middle[0] - a.middle[0]).hypot(b.middle[1] - a.middle[1]) / a.size.exp()
}

/// Maximum relative standard deviation of a usable depth scale.
const UNSURE: f64 = 0.5;
