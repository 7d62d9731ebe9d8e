//! The least squares fit of all flights together.

use gradreel::optim::{LevenbergMarquardt, Residuals};

use super::dual::{Dual, MOST};
use super::path::{Begin, GRAVITY, GROUND, PITCH, ROLL, SHARED, SIZE, SLOPE, Struck, Way};
use crate::monocular::free_fall::Down;
use crate::video::parabola::{GRAVITY as EARTH, Parabola};
use crate::video::{Camera, FreeFlight, Sight};

/// Standard deviations of the camera's roll and of the slope of a floor \[rad\].
const ROLLED: f64 = 0.07;
const SLOPES: f64 = 0.02;

/// Standard deviation of a pitch that was given \[rad\].
const GIVEN: f64 = 0.02;

/// Standard deviations of the speed along the line of sight, and of what a hit changes in it \[m/s\], and usual share that a
/// hit leaves of it.
const NEARING: f64 = 1.0;
const TURNS: f64 = 0.3;
const KEEPS: f64 = 0.8;

/// Standard deviation of the logarithm of a width, alike in one flight.
const WIDTH: f64 = 0.08;

/// Standard deviation of the height of the ground about where the first two flights meet, in depths, and of the depth at
/// which a flight begins that no hit joins to the one before.
const HEIGHT: f64 = 0.3;
const DEPTH: f64 = 0.3;

/// Largest mean square of a flight's residuals, in those of the flights before: beyond it the flight is another thing's.
const FITS: f64 = 16.0;

/// Deviations by which a restitution may be above 1.
const LIKELY: f64 = 3.0;

/// Evaluations of a fit.
const EVALUATIONS: usize = 60;

/// A fitted way.
pub(super) struct Fitted {
    pub way: Way,
    /// Covariance of its unknowns.
    pub covariance: Vec<Vec<f64>>,
    /// Number of flights in it.
    pub flights: usize,
}

/// What is fitted.
pub(super) struct Task<'a> {
    camera: &'a Camera,
    flights: &'a [FreeFlight],
    /// Time of the first sight.
    origin: f64,
    /// Expected pitch and its standard deviation \[rad\].
    pitch: [f64; 2],
    /// First guess of gravity in depths \[1/s²\].
    gravity: f64,
    /// Height at which the first two flights that a hit joins meet, in depths.
    ground: f64,
}

/// The parabola of a flight, with the acceleration of another if its own is not known.
fn parabola(flight: &FreeFlight, other: Option<[f64; 2]>) -> Option<Parabola> {
    let points: Vec<(f64, [f64; 2])> = flight.sights.iter().map(|sight| (sight.seconds, sight.middle)).collect();
    Parabola::fit(&points, other)
}

impl<'a> Task<'a> {
    /// `None` if the first flight does not tell gravity, or no hit joins two flights.
    pub fn of(camera: &'a Camera, flights: &'a [FreeFlight], down: Down) -> Option<Self> {
        let pitch = match down {
            Down::Known([_, y, z]) => [(-z).atan2(-y), GIVEN],
            Down::Tilted { angle, deviation } => [angle, deviation],
        };
        let joined = (0..flights.len().saturating_sub(1)).find(|k| flights[*k].bounces)?;
        let paths: Vec<Parabola> = flights.iter().take(joined + 2).map(|f| parabola(f, None)).collect::<Option<_>>()?;
        let longest = flights.iter().take(joined + 2).enumerate().max_by_key(|(_, flight)| flight.sights.len())?.0;
        let gravity = paths[longest].acceleration[1] / (camera.fy * pitch[0].cos());
        let origin = flights[0].sights.first()?.seconds;
        let (time, _) = paths[joined].meets(&paths[joined + 1])?;
        let y = -(paths[joined].at(time)[1] - camera.cy) / camera.fy;
        // in the plane in which the depth is 1
        let ground = y * pitch[0].cos() - pitch[0].sin();
        (gravity > 0.0 && ground.is_finite()).then_some(Self { camera, flights, origin, pitch, gravity, ground })
    }

    /// Fits flight after flight, as long as they belong together and the unknowns are few enough; `None` if no hit is among
    /// them.
    pub fn fitted(&self) -> Option<Fitted> {
        let mut begins: Vec<Begin> = Vec::new();
        let mut values = vec![0.0; SHARED];
        (values[GRAVITY], values[PITCH], values[GROUND]) = (self.gravity.ln(), self.pitch[0], self.ground);
        values[SIZE] = (self.flights[0].sights[0].across / self.camera.fx).ln();
        let mut best: Option<(Fitted, f64)> = None;
        for flight in 0..self.flights.len() {
            let begin = match flight {
                0 => Begin::First,
                _ if self.flights[flight - 1].bounces => Begin::Hit,
                _ => Begin::Anywhere,
            };
            if values.len() + begin.unknowns() > MOST {
                break;
            }
            let Some(guess) = self.guess(flight, begin, best.as_ref().map(|(fitted, _)| &fitted.way)) else { break };
            begins.push(begin);
            values.extend(guess);
            let Some((fitted, point, spread)) = self.minimised(&begins, &values) else { break };
            let before = best.as_ref().map_or(1.0, |(_, spread)| spread.max(1.0));
            let gains = |hit: &Struck| {
                let deviation = hit.restitution.variance(&fitted.covariance).max(0.0).sqrt();
                hit.restitution.value > 1.0 + LIKELY * deviation
            };
            if flight > 0 && (self.misfit(&fitted.way, flight) > FITS * before || fitted.way.hits.iter().any(gains)) {
                break;
            }
            values = point;
            best = Some((fitted, spread));
        }
        best.map(|(fitted, _)| fitted).filter(|fitted| !fitted.way.hits.is_empty())
    }

    /// First guess of a flight's own unknowns.
    fn guess(&self, flight: usize, begin: Begin, way: Option<&Way>) -> Option<Vec<f64>> {
        let (camera, own) = (self.camera, &self.flights[flight]);
        let first = own.sights.first()?;
        let acceleration = [0.0, self.gravity * camera.fy * self.pitch[0].cos()];
        let path = parabola(own, None).filter(|path| path.acceleration[1] > 0.5 * acceleration[1]);
        let path = path.or_else(|| parabola(own, Some(acceleration)))?;
        let cosine = self.pitch[0].cos();
        let velocity = |time: f64| {
            let [x, y] = path.velocity_at(time);
            [x / camera.fx, -y / (camera.fy * cosine)]
        };
        let place = [(first.middle[0] - camera.cx) / camera.fx, -(first.middle[1] - camera.cy) / camera.fy];
        // in the plane in which the depth is 1
        let sine = self.pitch[0].sin();
        let up = place[1] * cosine - sine;
        let [right, rises] = velocity(first.seconds);
        match (begin, way) {
            (Begin::Hit, Some(way)) => {
                let (time, falls) = way.arrives()?;
                let [right, rises] = velocity(self.origin + time);
                Some(vec![(rises / falls.max(1e-9)).clamp(0.05, 1.05), right, 0.0])
            }
            (Begin::Hit, None) => None,
            (Begin::First, _) => Some(vec![place[0], up, right, rises, 0.0]),
            (Begin::Anywhere, _) => Some(vec![place[0], up, -cosine - place[1] * sine, right, rises, 0.0]),
        }
    }

    /// The minimum from a first guess, with the variance of a residual; `None` where it has no finite one.
    fn minimised(&self, begins: &[Begin], start: &[f64]) -> Option<(Fitted, Vec<f64>, f64)> {
        let search = LevenbergMarquardt { evaluations: EVALUATIONS, value_tolerance: 1e-10, ..Default::default() };
        // a guess that is behind the camera has no residuals
        let fit = search.minimise(start, &mut |values, _| Ok(self.residuals(begins, values))).ok()?;
        if !fit.cost.is_finite() || !fit.undetermined.is_empty() {
            return None;
        }
        // residuals are in standard deviations: their scatter counts only if it is larger
        let variance = fit.variance.unwrap_or(1.0);
        let factor = variance.max(1.0) / variance.max(f64::MIN_POSITIVE);
        let covariance = fit.covariance.iter().map(|row| row.iter().map(|c| factor * c).collect()).collect();
        let way = self.way(begins, &fit.point);
        Some((Fitted { way, covariance, flights: begins.len() }, fit.point, variance))
    }

    /// The way, with times from the first sight on.
    fn way(&self, begins: &[Begin], values: &[f64]) -> Way {
        let times: Vec<f64> = self.flights.iter().map(|flight| flight.sights[0].seconds - self.origin).collect();
        Way::of(begins, &times, values)
    }

    /// Time since the first sight.
    pub fn since(&self, seconds: f64) -> f64 {
        seconds - self.origin
    }

    /// A time of the way in the film.
    pub fn seconds(&self, time: f64) -> f64 {
        self.origin + time
    }

    /// Residuals of a sight, in standard deviations: to the right, downwards, and of the width.
    fn of_sight(&self, way: &Way, flight: usize, sight: &Sight) -> [Dual; 3] {
        let (camera, own) = (self.camera, &self.flights[flight]);
        let [x, y, z] = way.seen_from(flight, self.since(sight.seconds));
        let off = |along: Dual, focal: f64, middle: f64| (along / -z * focal + Dual::of(middle)) * (1.0 / own.scatter);
        let width = way.size / -z * camera.fx * (1.0 / sight.across.max(1e-3));
        let alike = WIDTH * (own.sights.len() as f64).sqrt();
        [
            off(x, camera.fx, camera.cx - sight.middle[0]),
            off(y, -camera.fy, camera.cy - sight.middle[1]),
            width.ln() * (1.0 / alike),
        ]
    }

    /// Mean square of the residuals of a flight's places.
    fn misfit(&self, way: &Way, flight: usize) -> f64 {
        let sights = &self.flights[flight].sights;
        let square =
            |sight: &Sight| self.of_sight(way, flight, sight)[..2].iter().map(|r| r.value.powi(2)).sum::<f64>();
        sights.iter().map(square).sum::<f64>() / (2 * sights.len()) as f64
    }

    fn residuals(&self, begins: &[Begin], values: &[f64]) -> Residuals {
        let way = self.way(begins, values);
        let mut all: Vec<Dual> = Vec::new();
        for flight in 0..begins.len() {
            for sight in &self.flights[flight].sights {
                all.extend(self.of_sight(&way, flight, sight));
            }
        }
        let mut expect = |number: usize, mean: f64, deviation: f64| {
            all.push((Dual::unknown(values[number], number) - Dual::of(mean)) * (1.0 / deviation));
        };
        expect(PITCH, self.pitch[0], self.pitch[1]);
        expect(ROLL, 0.0, ROLLED);
        expect(SLOPE, 0.0, SLOPES);
        expect(GROUND, self.ground, HEIGHT);
        // speeds in depths per second
        let metre = self.gravity / EARTH;
        let mut number = SHARED;
        for begin in begins {
            match begin {
                Begin::First => expect(number + 4, 0.0, NEARING * metre),
                Begin::Anywhere => {
                    expect(number + 2, -1.0, DEPTH);
                    expect(number + 5, 0.0, NEARING * metre);
                }
                Begin::Hit => {}
            }
            number += begin.unknowns();
        }
        for hit in &way.hits {
            all.push((hit.after[1] - hit.along[1] * KEEPS) * (1.0 / (TURNS * metre)));
        }
        Residuals {
            columns: (0..values.len()).map(|k| all.iter().map(|r| r.slope[k]).collect()).collect(),
            values: all.into_iter().map(|r| r.value).collect(),
        }
    }
}
