//! The frames before a body comes near the ground: it falls as it is, and there is nothing to simulate.

use gradreel::scalar::Real;
use gradreel::{DType, Result, Tensor, Var};

use crate::identify::flight::displacement;
use crate::identify::unknowns::Bound;
use crate::identify::{Problem, Unknowns};
use crate::physics::{Law, Schedule};

/// How many cells below a particle the nodes end that it moves: one and a half, and room for rounding.
const REACH: f64 = 2.0;

/// How much of a motion is free fall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FreeFall {
    /// Frames that nothing is simulated of; the one after them begins the simulation.
    pub frames: usize,
    /// When the simulation begins \[s\].
    pub time: f64,
    /// The times between frames.
    frame_dt: f64,
}

impl FreeFall {
    /// What is left to simulate.
    pub fn rest(&self, schedule: Schedule) -> Schedule {
        Schedule { frames: schedule.frames - self.frames, ..schedule }
    }

    /// The times of the frames that are not simulated \[s\].
    pub fn times(&self) -> impl Iterator<Item = f64> + use<> {
        let frame_dt = self.frame_dt;
        (0..self.frames).map(move |frame| frame as f64 * frame_dt)
    }

    /// The frames in free fall, position by position, before those that were simulated `[frames, particles, 3]`.
    pub fn before(&self, fallen: impl Fn(f64) -> Result<Vec<f64>>, simulated: Tensor) -> Result<Tensor> {
        fn join<T: Real>(first: &[f64], rest: &Tensor, shape: [usize; 3]) -> Tensor {
            let first = first.iter().map(|&x| T::from_f64(x));
            Tensor::from_vec(first.chain(rest.slice::<T>().iter().copied()).collect(), shape)
        }
        if self.frames == 0 {
            return Ok(simulated);
        }
        let first = self.times().map(fallen).collect::<Result<Vec<_>>>()?.concat();
        let shape = [simulated.dims()[0] + self.frames, simulated.dims()[1], 3];
        Ok(match simulated.dtype() {
            DType::F64 => join::<f64>(&first, &simulated, shape),
            _ => join::<f32>(&first, &simulated, shape),
        })
    }
}

impl Problem<'_> {
    /// How much of the schedule is free fall: up to the last frame in which all particles are too far above the ground to feel it. Nothing of a body
    /// that turns, nor of one whose material is under stress at rest.
    pub(super) fn free_fall(&self, unknowns: &Unknowns, turns: bool, schedule: Schedule) -> FreeFall {
        let Schedule { frames, frame_dt, .. } = schedule;
        let ([.., lift, _], dx) = (self.world.gravity, self.world.dx);
        let body = self.leaning(unknowns.lean);
        let lowest = body.positions.iter().fold(f64::INFINITY, |low, x| low.min(x[1])) - unknowns.contact * dx;
        let height = |frame: usize| {
            let fallen = displacement(unknowns.velocity, self.world.gravity, frame as f64 * frame_dt);
            lowest + fallen[1] - self.ground
        };
        // thrown up or down, it is lowest at one of the ends
        let falls = !turns && lift <= 0.0 && height(0) > REACH * dx && rests(&self.law, unknowns, schedule.dt());
        let last = (0..frames.saturating_sub(1)).rev().find(|&frame| height(frame) > REACH * dx);
        let frames = last.filter(|_| falls).unwrap_or(0);
        FreeFall { frames, time: frames as f64 * frame_dt, frame_dt }
    }

    /// The same of unknowns on a tape.
    pub(super) fn free_fall_of(&self, bound: &Bound, schedule: Schedule) -> Result<FreeFall> {
        let values = |var: &Var| var.value()?.to_vec();
        let velocity = values(&bound.velocity)?;
        let parameters: Result<Vec<Vec<f64>>> = bound.parameters.iter().map(values).collect();
        let unknowns = Unknowns {
            velocity: std::array::from_fn(|axis| velocity[axis]),
            parameters: parameters?.into_iter().map(|values| values[0]).collect(),
            contact: bound.contact,
            lean: bound.lean,
            ..Unknowns::default()
        };
        Ok(self.free_fall(&unknowns, bound.spin.is_some(), schedule))
    }
}

/// Whether nothing happens to this material as long as nothing moves it.
fn rests(law: &Law, unknowns: &Unknowns, dt: f64) -> bool {
    const EYE: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let history: Vec<f64> = law.history().iter().map(|variable| variable.start).collect();
    let after = law.program().eval(&[&EYE[..], &[0.0; 9], &[dt], &unknowns.parameters, &history].concat());
    after == [&EYE[..], &[0.0; 9], &history].concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::materials;

    #[test]
    fn laws_are_at_rest_undeformed() {
        for law in materials::all() {
            let parameters = law.parameters().iter().map(|p| p.start).collect();
            let unknowns = Unknowns { parameters, ..Unknowns::default() };
            assert!(rests(&law, &unknowns, 1e-4), "{}", law.name());
        }
    }
}
