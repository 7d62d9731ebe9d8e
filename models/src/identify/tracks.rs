//! Velocity and material from tracked particles, by Gauss–Newton with derivatives from forward mode.
//!
//! Where particles themselves are known (from another simulator, from markers, from the geometry stage of a method), no
//! rendering is needed and the residuals are their distances. A few unknowns and very many residuals ask for forward mode:
//! all columns of the Jacobian come from one rollout that carries a tangent for each unknown.

use std::ops::Range;

use gradreel::optim::{Fit, LevenbergMarquardt, Residuals};
use gradreel::{DType, Error, ErrorKind, Result, Tensor};

use crate::identify::model::linearise::row;
use crate::identify::model::unknowns::unit;
use crate::physics::{Law, Rollout, Schedule, World};

/// Where the particles of a body were.
#[derive(Debug, Clone)]
pub struct Tracks {
    /// Positions `[frames, n, 3]` \[m\]; computed with in their type.
    pub positions: Tensor,
    /// Time between frames \[s\].
    pub frame_dt: f64,
    /// Substeps between frames.
    pub substeps: usize,
    /// The first frame in which the body touches something.
    pub contact: usize,
    /// Surroundings.
    pub world: World,
    /// The material.
    pub law: Law,
    /// Density \[kg/m³\].
    pub density: f64,
}

/// What tracks say.
#[derive(Debug, Clone)]
pub struct TracksFit {
    /// Velocity at the start \[m/s\].
    pub velocity: [f64; 3],
    /// All parameters of the law, in its order and units.
    pub parameters: Vec<f64>,
    /// The last search: its unknowns are the velocity and the fitted parameters in their unconstrained form
    /// ([`Map::raw`](crate::physics::Map::raw)).
    pub fit: Fit,
    /// Work done, in rollouts over all frames; a tangent counts as [`TANGENT_COST`] rollouts.
    pub rollouts: f64,
    /// Root of the mean squared distance between tracked and simulated particles \[m\].
    pub distance: f64,
}

/// What carrying one tangent along costs, in rollouts: two to two and a half.
pub const TANGENT_COST: f64 = 2.5;

/// Derivatives serve again where no unknown has moved further than this, in its unconstrained form: the search then gains
/// about one digit a step instead of doubling them, at the cost of one rollout.
const NEAR: f64 = 0.03;

/// How far a parameter moves in one step at most, in units of its unconstrained form: a decade of a magnitude. Where the motion says
/// next to nothing of it, a step has no length of its own.
const FARTHEST: f64 = 1.0;

/// Frames from contact on that the material is fitted to, one search after the other.
const BEYOND: [usize; 3] = [1, 2, 4];

impl Tracks {
    /// Fits the velocity and the parameters listed in `fitted` (indices into the law's); the others stay as they `start`.
    ///
    /// First the velocity alone, on the frames before contact, where the material does not matter; then the material alone, on
    /// the first frame of contact and a few more at a time, where errors have not grown yet: over many frames a wrong modulus
    /// of what yields can look better than all that are near it. At last everything on all frames.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] for positions of another shape, [`ErrorKind::Input`] for too few frames or parameters that do not
    /// belong to the law, and what the rollout returns at the start. Trials that break down are stepped back from.
    pub fn fit(&self, velocity: [f64; 3], start: &[f64], fitted: &[usize]) -> Result<TracksFit> {
        let frames = match *self.positions.dims() {
            [frames, _, 3] if self.positions.dtype().is_real() => frames,
            _ => {
                return Err(Error::new(ErrorKind::Shape, "tracks have the wrong shape")
                    .found(self.positions.shape())
                    .wanted("[frames, particles, 3], f32 or f64"));
            }
        };
        let parameters = self.law.parameters();
        let known = |&k: &usize| k < parameters.len() && parameters[k].map.raw(start[k]).is_finite();
        if start.len() != parameters.len() || !fitted.iter().all(known) || frames < 2 {
            return Err(Error::new(ErrorKind::Input, "the tracks cannot be fitted")
                .found(format!("{frames} frames, parameters {start:?}, of which {fitted:?} are to be fitted"))
                .wanted(format!("at least two frames, and a value inside its range for each of {}", self.law.name())));
        }
        let raw = fitted.iter().map(|&k| parameters[k].map.raw(start[k]));
        let mut search =
            Search { tracks: self, start, fitted, x: velocity.into_iter().chain(raw).collect(), rollouts: 0.0 };
        let all = 0..search.x.len();
        // Without frames before contact, velocity and material cannot be told apart.
        let falls = self.contact >= 2;
        if falls {
            search.run(0..3, self.contact.min(frames), 1e-4)?;
        }
        let unknown = if falls { 3..all.end } else { all.clone() };
        for beyond in BEYOND {
            let around = (self.contact + beyond).max(2);
            if around < frames && !fitted.is_empty() {
                search.run(unknown.clone(), around, 1e-3)?;
            }
        }
        let fit = search.run(all, frames, 1e-4)?;
        let rollouts = search.rollouts;
        let mut values = start.to_vec();
        for (&k, &raw) in fitted.iter().zip(&fit.point[3..]) {
            values[k] = parameters[k].map.value(raw);
        }
        let distance = (2.0 * fit.cost / (fit.residuals.len() / 3).max(1) as f64).sqrt();
        let velocity = std::array::from_fn(|axis| fit.point[axis]);
        Ok(TracksFit { velocity, parameters: values, fit, rollouts, distance })
    }

    /// Where the particles would be, with this velocity \[m/s\] and these parameters: `[frames, n, 3]` \[m\].
    ///
    /// # Errors
    /// As [`Rollout::jvp`].
    pub fn motion(&self, velocity: [f64; 3], parameters: &[f64]) -> Result<Tensor> {
        let (rollout, inputs) = self.rollout(velocity, parameters, self.positions.dims()[0])?;
        rollout.jvp(&inputs, &[]).map(|(motion, _)| motion)
    }

    /// The simulation of the first `frames` frames, and its inputs.
    fn rollout(&self, velocity: [f64; 3], parameters: &[f64], frames: usize) -> Result<(Rollout, Vec<Tensor>)> {
        let dtype = self.positions.dtype();
        let schedule = Schedule { frames, frame_dt: self.frame_dt, substeps: self.substeps };
        let rollout = Rollout::of_one(&self.world, &self.law, schedule);
        let mut inputs =
            vec![row(&self.positions, 0), numbers(velocity.to_vec(), dtype)?, numbers(vec![self.density], dtype)?];
        for &value in parameters {
            inputs.push(numbers(vec![value], dtype)?);
        }
        Ok((rollout, inputs))
    }
}

/// The unknowns as they are so far: velocity, then fitted parameters in their unconstrained form.
struct Search<'a> {
    tracks: &'a Tracks,
    start: &'a [f64],
    fitted: &'a [usize],
    x: Vec<f64>,
    rollouts: f64,
}

impl Search<'_> {
    /// Minimises the distances in the first `frames` frames over some of the unknowns, until a step changes the motion by
    /// less than `tolerance`.
    fn run(&mut self, free: Range<usize>, frames: usize, tolerance: f64) -> Result<Fit> {
        let positions = &self.tracks.positions;
        let share = (frames - 1) as f64 / (positions.dims()[0] - 1) as f64;
        let search = LevenbergMarquardt {
            evaluations: 40,
            value_tolerance: 1e-3,
            gradient_tolerance: 1e-6,
            step_tolerance: tolerance,
            ..LevenbergMarquardt::default()
        };
        let (mut x, mut rollouts, mut first) = (self.x.clone(), 0.0, true);
        // The last values, and the last derivatives, each with where they are from.
        let mut values: Option<(Vec<f64>, Vec<f64>)> = None;
        let mut slopes: Option<(Vec<f64>, Vec<Vec<f64>>)> = None;
        let parameters = self.tracks.law.parameters();
        let unit_of = |unknown: usize| unknown.checked_sub(3).map(|k| unit(&parameters[self.fitted[k]]));
        let units: Vec<f64> = free.clone().map(|unknown| unit_of(unknown).unwrap_or(f64::INFINITY)).collect();
        // of a trial that breaks down: no better than an infinite distance
        let none = || {
            let none = vec![f64::NAN; 3 * (frames - 1) * positions.dims()[1]];
            Residuals { columns: vec![none.clone(); units.len()], values: none }
        };
        // where derivatives were asked for last: at the start, and then where a step led
        let mut reached = self.x[free.clone()].to_vec();
        let fit = search.minimise(&self.x[free.clone()], &mut |moved, jacobian| {
            let far = |((a, b), unit): ((&f64, &f64), &f64)| (a - b).abs() > FARTHEST * unit;
            if !jacobian && moved.iter().zip(&reached).zip(&units).any(far) {
                return Ok(none());
            }
            x[free.clone()].copy_from_slice(moved);
            let near = |at: &[f64]| at.iter().zip(moved).all(|(a, b)| (a - b).abs() < NEAR);
            let kept = slopes.as_ref().filter(|(at, _)| near(at)).map(|(_, columns)| columns.clone());
            if let (true, Some(columns), Some((at, values))) = (jacobian, &kept, &values)
                && at == moved
            {
                reached.copy_from_slice(moved);
                return Ok(Residuals { values: values.clone(), columns: columns.clone() });
            }
            let wanted = if jacobian && kept.is_none() { free.clone() } else { 0..0 };
            rollouts += share * (1.0 + TANGENT_COST * wanted.len() as f64);
            let at_start = std::mem::replace(&mut first, false);
            let mut found = match self.residuals(&x, frames, wanted.clone()) {
                Err(error) if breaks_down(&error) && !at_start => return Ok(none()),
                other => other?,
            };
            values = Some((moved.to_vec(), found.values.clone()));
            if !wanted.is_empty() {
                slopes = Some((moved.to_vec(), found.columns.clone()));
            } else if jacobian {
                found.columns = kept.unwrap_or_default();
            }
            if jacobian {
                reached.copy_from_slice(moved);
            }
            Ok(found)
        })?;
        self.x[free].copy_from_slice(&fit.point);
        self.rollouts += rollouts;
        Ok(fit)
    }

    /// Distances at `x`, and how they change with the unknowns `wanted`.
    fn residuals(&self, x: &[f64], frames: usize, wanted: Range<usize>) -> Result<Residuals> {
        let Self { tracks, start, fitted, .. } = self;
        let n = tracks.positions.dims()[1];
        let parameters = tracks.law.parameters();
        let mut values = start.to_vec();
        for (&k, &raw) in fitted.iter().zip(&x[3..]) {
            values[k] = parameters[k].map.value(raw);
        }
        let velocity = std::array::from_fn(|axis| x[axis]);
        let (rollout, inputs) = tracks.rollout(velocity, &values, frames)?;
        let tensor = |values: Vec<f64>| numbers(values, tracks.positions.dtype());
        let mut directions = Vec::new();
        for unknown in wanted {
            let mut direction = vec![None; inputs.len()];
            if unknown < 3 {
                let mut along = vec![0.0; 3];
                along[unknown] = 1.0;
                direction[1] = Some(tensor(along)?);
            } else {
                let k = fitted[unknown - 3];
                direction[3 + k] = Some(tensor(vec![parameters[k].map.derivative(x[unknown])])?);
            }
            directions.push(direction);
        }
        let (motion, changes) = rollout.jvp(&inputs, &directions)?;
        // The first frame is given.
        let seen = tracks.positions.to_vec()?;
        let values = motion.to_vec()?.iter().zip(&seen).skip(3 * n).map(|(x, y)| x - y).collect();
        let columns = changes.iter().map(|change| Ok(change.to_vec()?.split_off(3 * n)));
        Ok(Residuals { values, columns: columns.collect::<Result<_>>()? })
    }
}

/// Whether a simulation fails because of its numbers: unstable, not finite, or too stiff for any substep.
fn breaks_down(error: &Error) -> bool {
    matches!(error.kind(), ErrorKind::Physics | ErrorKind::NonFinite | ErrorKind::Input)
}

fn numbers(values: Vec<f64>, dtype: DType) -> Result<Tensor> {
    let len = values.len();
    Tensor::from_vec(values, [len]).cast(dtype)
}
