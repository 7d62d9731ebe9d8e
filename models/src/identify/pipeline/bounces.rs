//! What is found of a film whose contacts are shorter than the time between two pictures: the free flights on both sides
//! of the hits, and of the material what was known before.

use std::time::Instant;

use gradreel::{Error, ErrorKind, Result, Tensor};

use crate::identify::pipeline::context::Context;
use crate::identify::run::Run;
use crate::identify::{Interval, MaterialConfig, Stage, Unknowns};
use crate::particles::Particles;
use crate::physics::materials::FAMILIES;
use crate::physics::{Law, Map, NINETY};
use crate::video::{Bounces, Clip, ContactModel};

/// What the flights of a clip tell, unless its contact is to be simulated.
pub(in crate::identify) fn of<'a>(clip: &'a Clip, run: &Run) -> Option<&'a Bounces> {
    let treated = run.config.clip.film.contact == ContactModel::Auto;
    clip.story.as_ref()?.bounces.as_ref().filter(|_| treated)
}

/// What is known of a parameter without a film: its value, and ends of its interval.
fn plausible(law: &Law, number: usize, parameters: &[f64]) -> (f64, [f64; 2]) {
    let parameter = &law.parameters()[number];
    let [usual, deviation] = parameter.usual;
    let place = parameter.times.and_then(|base| law.parameters().iter().position(|other| other.name == base));
    let mean = usual * place.map_or(1.0, |base| parameters[base]);
    let ends = [-NINETY, NINETY].map(|z| match parameter.map {
        Map::Log10 => mean * 10f64.powf(z * deviation),
        _ => (mean + z * deviation).clamp(parameter.prior[0], parameter.prior[1]),
    });
    (mean, ends)
}

impl Context<'_> {
    /// Takes over what the flights tell, and what is plausible of the material.
    ///
    /// # Errors
    /// What writing returns.
    pub(in crate::identify) fn by_flights(&self, run: &mut Run, bounces: &Bounces, start: &Unknowns) -> Result<()> {
        if run.has_finished(Stage::FreeFlights) {
            return Ok(());
        }
        let since = Instant::now();
        if run.config.chooses_family() {
            // nothing of the film tells one from another
            run.config.material = MaterialConfig { name: FAMILIES[0].0.to_owned(), ..MaterialConfig::default() };
            run.save_config()?;
        }
        let mut unknowns = Unknowns { velocity: bounces.velocity.map(|known| known.value), ..start.clone() };
        let given = |name: &str| run.config.material.start.contains_key(name);
        let mut intervals = Vec::new();
        for (number, parameter) in self.law.parameters().iter().enumerate() {
            let (mean, interval_90) = plausible(self.law, number, &unknowns.parameters);
            if !given(parameter.name) {
                unknowns.parameters[number] = mean;
            }
            intervals.push(Interval { name: parameter.name.to_owned(), interval_90, determined: false });
        }
        for (axis, known) in ["x", "y", "z"].into_iter().zip(&bounces.velocity) {
            let determined = known.deviation * 3.0 < MOVES;
            intervals.push(Interval { name: format!("velocity_{axis}"), interval_90: known.interval_90(), determined });
        }
        run.state.intervals = intervals;
        run.state.bounces = Some(bounces.clone());
        run.note(bounces.why());
        run.finish_at(&unknowns, Stage::FreeFlights, since)
    }
}

/// Standard deviation of the velocity of a thing that is let go \[m/s\].
const MOVES: f64 = 1.0;

/// Positions of the particles in every frame, `[frames, particles, 3]` \[m\]: the body as it was, moved along its way.
///
/// # Errors
/// [`ErrorKind::Input`] for a way through another number of frames.
pub(in crate::identify) fn motion(particles: &Particles, bounces: &Bounces, frames: usize) -> Result<Tensor> {
    if bounces.path.len() != frames {
        return Err(Error::new(ErrorKind::Input, "the way of the object has another number of frames than the clip")
            .found(bounces.path.len())
            .wanted(frames)
            .fix("begin the run again with another --out"));
    }
    let moved = |by: &[f64; 3]| {
        particles.positions.iter().flat_map(|x| [0, 1, 2].map(|c| (x[c] + by[c]) as f32)).collect::<Vec<f32>>()
    };
    let all: Vec<f32> = bounces.path.iter().flat_map(moved).collect();
    Ok(Tensor::from_vec(all, [frames, particles.positions.len(), 3]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::config::law_of;

    #[test]
    fn what_is_plausible_of_a_material_that_nothing_is_known_of() {
        for (name, _) in FAMILIES {
            let law = law_of(name).unwrap();
            let starts = law.start_values();
            for (k, parameter) in law.parameters().iter().enumerate() {
                let (mean, [low, high]) = plausible(&law, k, &starts);
                assert!(low < high && low <= mean && mean <= high, "{} of {name}: {low} to {high}", parameter.name);
            }
        }
    }

    #[test]
    fn a_body_moves_as_a_whole() {
        let particles = Particles {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0]],
            opacity: vec![1.0; 2],
            colour: vec![[0.5; 3]; 2],
            spacing: 0.1,
        };
        let bounces = Bounces {
            contact: 0.01,
            flights: 2,
            hits: vec![],
            restitution: crate::video::Known { value: 0.5, deviation: 0.1 },
            tangential: None,
            velocity: [crate::video::Known { value: 0.0, deviation: 0.1 }; 3],
            path: vec![[0.0; 3], [0.0, -1.0, 0.5]],
        };
        let moved = motion(&particles, &bounces, 2).unwrap();
        assert_eq!(moved.slice::<f32>()[6..], [0.0, -1.0, 0.5, 1.0, -1.0, 0.5]);
        assert!(motion(&particles, &bounces, 3).is_err());
    }
}
