//! The frames before a body comes near the ground: it falls as it is, and there is nothing to simulate.

use gradreel::{Result, Var};

use crate::identify::model::flight::displacement;
use crate::identify::model::unknowns::Bound;
use crate::identify::{Problem, Unknowns};
use crate::physics::{Law, Schedule};

/// How many cells below a particle the nodes end that it moves: one and a half, and room for rounding.
const REACH: f64 = 2.0;

impl Problem<'_> {
    /// How many frames of the schedule are free fall, of which nothing need be simulated: those before the last in which all particles are too far above
    /// the ground to feel it. None of a body that turns, nor of one whose material is under stress at rest.
    pub(in crate::identify) fn free_fall(&self, unknowns: &Unknowns, turns: bool, schedule: Schedule) -> usize {
        let Schedule { frames, frame_dt, .. } = schedule;
        let (rise, dx) = (self.world.gravity[1], self.world.dx);
        let body = self.sheared(unknowns.depth);
        let lowest = body.positions.iter().fold(f64::INFINITY, |low, x| low.min(x[1])) - unknowns.contact * dx;
        let height = |frame: usize| {
            let fallen = displacement(unknowns.velocity, self.world.gravity, frame as f64 * frame_dt);
            lowest + fallen[1] - self.ground
        };
        // thrown up or down, it is lowest at one of the ends
        let falls = !turns && rise <= 0.0 && height(0) > REACH * dx && rests(&self.law, unknowns, schedule.dt());
        let last = (0..frames.saturating_sub(1)).rev().find(|&frame| height(frame) > REACH * dx);
        last.filter(|_| falls).unwrap_or(0)
    }

    /// The same of unknowns on a tape.
    pub(in crate::identify) fn free_fall_of(&self, bound: &Bound, schedule: Schedule) -> Result<usize> {
        let values = |var: &Var| var.value()?.to_vec();
        let velocity = values(&bound.velocity)?;
        let parameters: Result<Vec<Vec<f64>>> = bound.parameters.iter().map(values).collect();
        let unknowns = Unknowns {
            velocity: std::array::from_fn(|axis| velocity[axis]),
            parameters: parameters?.into_iter().map(|values| values[0]).collect(),
            contact: bound.contact,
            depth: bound.depth,
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
