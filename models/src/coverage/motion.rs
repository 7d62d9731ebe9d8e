//! A recipe in motion: the truth that the cameras film.

use gradreel::{ErrorKind, Result};

use super::Recipe;
use crate::identify::Config;
use crate::physics::{Collider, Law, Schedule, Simulation, State, Values, World, neighbours};
use crate::vector::{cross, dot, norm};
use crate::views::objects::Dice;

/// The particles of a clip at the times of its frames.
pub struct Motion {
    /// Positions \[m\] of each frame.
    pub positions: Vec<Vec<[f32; 3]>>,
    /// The volume of all particles in each frame \[m³\].
    pub volumes: Vec<f64>,
    /// Distance between particles at rest \[m\].
    pub spacing: f64,
}

/// Times that the substeps are halved where the simulation breaks down.
const HALVINGS: usize = 3;

/// Simulates a recipe on its own grid, with its own step.
///
/// # Errors
/// [`ErrorKind::Physics`] where the simulation breaks down with any step.
pub fn simulate(recipe: &Recipe) -> Result<Motion> {
    let law = &recipe.law;
    let settings = Config::default().world;
    let (dx, spacing) = (recipe.spacings[1], 0.5 * recipe.spacings[1]);
    let mut positions = filling(recipe, spacing);
    let body = super::draw::volume(&recipe.body) * recipe.size.powi(3);
    let volume = body / positions.len().max(1) as f64;
    let world = World {
        gravity: settings.gravity,
        colliders: vec![Collider::ground(0.0)],
        particle_volume: volume,
        ..World::new(dx)
    };
    let order = neighbours(dx, &positions, |_| 0);
    positions = order.iter().map(|&p| positions[p as usize]).collect();
    let parameters: Vec<f64> = law.parameters().iter().map(|p| recipe.parameters[p.name]).collect();
    let fall = (2.0 * norm(world.gravity) * recipe.start[1]).sqrt();
    let speed = norm(recipe.velocity) + fall;
    let sound = law.wave_speed_on(&parameters, settings.density, dx).max(settings.least_speed - speed);
    let Schedule { frames, frame_dt, .. } = recipe.schedule;
    let mut schedule = Schedule::stable(&world, frames, frame_dt, sound, speed, settings.cfl * recipe.step);
    let mut halvings = 0;
    loop {
        match roll(law, &world, schedule, &positions, recipe.velocity, &parameters, settings.density) {
            Err(error) if halvings < HALVINGS && matches!(error.kind(), ErrorKind::Physics | ErrorKind::NonFinite) => {
                halvings += 1;
                schedule = schedule.halved();
            }
            found => return found.map(|(positions, volumes)| Motion { positions, volumes, spacing }),
        }
    }
}

/// Positions and volumes of all frames.
type Rolled = (Vec<Vec<[f32; 3]>>, Vec<f64>);

fn roll(
    law: &Law,
    world: &World,
    schedule: Schedule,
    start: &[[f32; 3]],
    velocity: [f64; 3],
    parameters: &[f64],
    density: f64,
) -> Result<Rolled> {
    let values = parameters.iter().map(|value| Values::Same(*value as f32)).collect();
    let density = Values::Same(density as f32);
    let mut simulation = Simulation::<f32>::new(world, law, schedule.dt(), start.len(), &density, values)?;
    let mut now = simulation.at_rest(start, &vec![velocity.map(|v| v as f32); start.len()])?;
    let mut next = now.zeros_like();
    let (mut positions, mut volumes) = Rolled::default();
    for frame in 0..schedule.frames {
        if frame > 0 {
            for _ in 0..schedule.substeps {
                simulation.substep(&now, &mut next)?;
                std::mem::swap(&mut now, &mut next);
            }
        }
        positions.push(now.positions());
        volumes.push(world.particle_volume * volume_ratio(&now));
    }
    Ok((positions, volumes))
}

/// The sum of `det F` over all particles.
fn volume_ratio(state: &State<f32>) -> f64 {
    let determinant = |f: [[f32; 3]; 3]| {
        let [a, b, c] = f.map(|row| row.map(f64::from));
        dot(a, cross(b, c))
    };
    state.deformation_gradients().into_iter().map(determinant).sum()
}

/// Particles in the body, on a grid of their own.
fn filling(recipe: &Recipe, spacing: f64) -> Vec<[f32; 3]> {
    let mut dice = Dice::new(recipe.paint.fold(1));
    let (half, field) = (recipe.body.half(), recipe.body.field());
    let shift = dice.three(0.0, 1.0);
    let count = half.map(|half| (2.0 * half * recipe.size / spacing).ceil() as i64 + 1);
    let mut positions = Vec::new();
    for i in 0..count[0] {
        for j in 0..count[1] {
            for k in 0..count[2] {
                let at = [i, j, k].map(|n| n as f64);
                let place: [f64; 3] =
                    std::array::from_fn(|axis| (at[axis] - shift[axis]) * spacing - half[axis] * recipe.size);
                if field.at(place.map(|x| x / recipe.size)) < 0.0 {
                    positions.push(std::array::from_fn(|axis| (recipe.start[axis] + place[axis]) as f32));
                }
            }
        }
    }
    positions
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::Split;

    #[test]
    fn a_body_falls_as_gravity_has_it_until_it_lands() {
        let recipe = Recipe::draw(Split::Development, 2, 7, None).unwrap();
        let motion = simulate(&recipe).unwrap();
        assert_eq!(motion.positions.len(), recipe.schedule.frames);
        let middle = |frame: &[[f32; 3]], axis: usize| {
            frame.iter().map(|x| f64::from(x[axis])).sum::<f64>() / frame.len() as f64
        };
        let t = 2.0 * recipe.schedule.frame_dt;
        let fallen = middle(&motion.positions[2], 1) - middle(&motion.positions[0], 1);
        assert!((fallen - (recipe.velocity[1] * t - 4.9 * t * t)).abs() < 1e-3, "{fallen} m in {t} s");
        let last = motion.positions.last().unwrap();
        assert!(last.iter().all(|x| x[1] > -0.5 * motion.spacing as f32), "nothing is below the ground");
        let body = super::super::draw::volume(&recipe.body) * recipe.size.powi(3);
        assert!((motion.volumes[0] / body - 1.0).abs() < 1e-5);
    }
}
