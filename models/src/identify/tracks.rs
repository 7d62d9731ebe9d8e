//! Velocity and material from tracked particles, by Gauss–Newton with derivatives from forward mode.
//!
//! Where particles themselves are known (from another simulator, from markers, from the geometry stage of a method), no
//! rendering is needed and the residuals are their distances. A few unknowns and very many residuals ask for forward mode:
//! all columns of the Jacobian come from one rollout that carries a tangent for each unknown.

use gradreel::optim::{Fit, LevenbergMarquardt, Residuals};
use gradreel::{DType, Error, ErrorKind, Result, Tensor};

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

/// What carrying one tangent along costs, in rollouts: two to three.
pub const TANGENT_COST: f64 = 2.5;

impl Tracks {
    /// Fits the velocity and the parameters listed in `fitted` (indices into the law's); the others stay as they `start`.
    ///
    /// First the velocity alone, on the frames before contact, where the material does not matter; then everything on the
    /// frames around contact, where errors have not grown yet; then everything on all frames.
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
        let mut x: Vec<f64> = velocity.into_iter().chain(raw).collect();
        let mut rollouts = 0.0;
        if self.contact >= 2 {
            let before = self.contact.min(frames);
            let fit = self.search(&x[..3], start, &[], before, 8, &mut rollouts)?;
            x[..3].copy_from_slice(&fit.point);
        }
        let around = (self.contact + 4).clamp(2, frames);
        let mut fit = self.search(&x, start, fitted, around, 20, &mut rollouts)?;
        if around < frames {
            fit = self.search(&fit.point.clone(), start, fitted, frames, 20, &mut rollouts)?;
        }
        let mut values = start.to_vec();
        for (&k, &raw) in fitted.iter().zip(&fit.point[3..]) {
            values[k] = parameters[k].map.value(raw);
        }
        let distance = (2.0 * fit.cost / (fit.residuals.len() / 3).max(1) as f64).sqrt();
        let velocity = std::array::from_fn(|axis| fit.point[axis]);
        Ok(TracksFit { velocity, parameters: values, fit, rollouts, distance })
    }

    /// Minimises the distances in the first `frames` frames.
    fn search(
        &self,
        x: &[f64],
        start: &[f64],
        fitted: &[usize],
        frames: usize,
        evaluations: usize,
        rollouts: &mut f64,
    ) -> Result<Fit> {
        let share = (frames - 1) as f64 / (self.positions.dims()[0] - 1) as f64;
        let search = LevenbergMarquardt {
            evaluations,
            value_tolerance: 1e-4,
            gradient_tolerance: 1e-6,
            step_tolerance: 1e-6,
            ..LevenbergMarquardt::default()
        };
        let mut first = true;
        search.minimise(x, &mut |x, jacobian| {
            *rollouts += share * (1.0 + if jacobian { TANGENT_COST * x.len() as f64 } else { 0.0 });
            let found = self.residuals(x, start, fitted, frames, jacobian);
            let at_start = std::mem::replace(&mut first, false);
            match found {
                // A trial that breaks down is no better than an infinite distance.
                Err(error) if error.kind() == ErrorKind::Physics && !at_start => {
                    let values = vec![f64::NAN; 3 * (frames - 1) * self.positions.dims()[1]];
                    Ok(Residuals { values, columns: Vec::new() })
                }
                other => other,
            }
        })
    }

    fn residuals(
        &self,
        x: &[f64],
        start: &[f64],
        fitted: &[usize],
        frames: usize,
        jacobian: bool,
    ) -> Result<Residuals> {
        let (dtype, n) = (self.positions.dtype(), self.positions.dims()[1]);
        let parameters = self.law.parameters();
        let rollout = Rollout {
            world: self.world.clone(),
            laws: vec![self.law.clone()],
            material_of: None,
            gravity: false,
            friction: false,
            schedule: Schedule { frames, frame_dt: self.frame_dt, substeps: self.substeps },
            remat: None,
        };
        let tensor = |values: Vec<f64>| {
            let len = values.len();
            Tensor::from_vec(values, [len]).cast(dtype)
        };
        let mut values = start.to_vec();
        for (&k, &raw) in fitted.iter().zip(&x[3..]) {
            values[k] = parameters[k].map.value(raw);
        }
        let seen = &self.positions;
        let positions = match dtype {
            DType::F64 => Tensor::from_vec(seen.slice::<f64>()[..3 * n].to_vec(), [n, 3]),
            _ => Tensor::from_vec(seen.slice::<f32>()[..3 * n].to_vec(), [n, 3]),
        };
        let mut inputs = vec![positions, tensor(x[..3].to_vec())?, tensor(vec![self.density])?];
        for value in values {
            inputs.push(tensor(vec![value])?);
        }
        let mut directions = Vec::new();
        for unknown in 0..if jacobian { x.len() } else { 0 } {
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
        let seen = seen.to_vec()?;
        let values = motion.to_vec()?.iter().zip(&seen).skip(3 * n).map(|(x, y)| x - y).collect();
        let columns = changes.iter().map(|change| Ok(change.to_vec()?.split_off(3 * n)));
        Ok(Residuals { values, columns: columns.collect::<Result<_>>()? })
    }
}
