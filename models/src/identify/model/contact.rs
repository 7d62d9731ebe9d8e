//! When the object first touches the ground.

use crate::identify::Unknowns;
use crate::identify::model::flight::displacement;
use crate::identify::model::spin::Gyration;
use crate::particles::Particles;
use crate::physics::World;

/// The first frame in which a falling object, had it kept its shape, would be within one grid cell of the ground; the number
/// of frames if it never is.
///
/// Up to that frame the motion is free flight and does not depend on the material.
pub fn first_contact(
    particles: &Particles,
    world: &World,
    ground: f64,
    unknowns: &Unknowns,
    frame_dt: f64,
    frames: usize,
) -> usize {
    let gyration = Gyration::of(particles);
    let turned = gyration.turned(unknowns.spin, frame_dt, frames);
    let touches = |(frame, turned): (usize, &_)| {
        let solid = particles.positions.iter().zip(&particles.opacity).filter(|(_, opacity)| **opacity > 0.5);
        let lowest = solid.map(|(x, _)| gyration.place(turned, *x)[1]).fold(f64::INFINITY, f64::min);
        let fallen = displacement(unknowns.velocity, world.gravity, frame as f64 * frame_dt);
        lowest - 0.5 * particles.spacing + fallen[1] < ground + world.dx
    };
    turned.iter().enumerate().position(touches).unwrap_or(frames)
}
