//! Obstacles as a table, nine rows of four numbers each. Mirrors `models/kernels/shared/contact.wgsl`.

use crate::physics::collider::{Collider, Contact, Region};
use crate::physics::contact::Placed;
use crate::physics::world::World;
use crate::vector::{dot, minus};

/// The table of all obstacles, one copy per substep if any of them moves.
#[derive(Debug)]
pub(super) struct Table {
    /// Four numbers per row.
    pub rows: Vec<f32>,
    moving: bool,
    obstacles: usize,
}

impl Table {
    /// The table for substeps of `dt` \[s\].
    pub fn of(world: &World, dt: f64, steps: usize) -> Self {
        let moving = world.colliders.iter().any(|c| c.motion.velocity != [0.0; 3] || c.motion.spin != [0.0; 3]);
        let times = if moving { steps } else { 1 };
        let mut rows = Vec::new();
        for step in 0..times {
            world.colliders.iter().for_each(|collider| rows.extend(entry(collider, step as f64 * dt)));
        }
        if rows.is_empty() {
            rows.resize(4, 0.0);
        }
        Self { rows, moving, obstacles: world.colliders.len() }
    }

    /// The index of the first obstacle of a substep.
    pub fn first(&self, step: usize) -> usize {
        if self.moving { step * self.obstacles } else { 0 }
    }
}

/// An obstacle at a time \[s\]: kind, contact; region relative to its pivot; pivot; motion; rotation.
fn entry(collider: &Collider, time: f64) -> [f32; 36] {
    let (contact, friction) = match collider.contact {
        Contact::Sticky => (0.0, 0.0),
        Contact::Slip => (1.0, 0.0),
        Contact::Separate => (2.0, 0.0),
        Contact::Friction(mu) => (3.0, mu),
    };
    let ([x, y, z], turn) = Placed::new(collider, time).pose();
    // Obstacles at rest keep world coordinates, to avoid rounding.
    let pivot = if collider.is_at_rest() { [0.0; 3] } else { collider.motion.pivot };
    let from = |point: [f64; 3]| minus(point, pivot);
    let (kind, a, size, b, length) = match collider.region {
        Region::Plane { point, normal } => (0.0, from(point), 0.0, normal, 0.0),
        Region::Cylinder { start, end, radius } => {
            let axis = minus(end, start);
            let length = dot(axis, axis).sqrt();
            (1.0, from(start), radius, axis.map(|a| a / length), length)
        }
        Region::Sphere { centre, radius } => (2.0, from(centre), radius, [0.0; 3], 0.0),
        Region::Cuboid { centre, half } => (3.0, from(centre), 0.0, half, 0.0),
    };
    let [velocity, spin] = [collider.motion.velocity, collider.motion.spin];
    let row = |v: [f64; 3], last: f64| [v[0], v[1], v[2], last];
    let rows = [
        [kind, f64::from(u8::from(collider.container)), contact, friction],
        row(a, size),
        row(b, length),
        row([x, y, z], 0.0),
        row(velocity, 0.0),
        row(spin, 0.0),
        row(turn[0], 0.0),
        row(turn[1], 0.0),
        row(turn[2], 0.0),
    ];
    let mut entry = [0.0; 36];
    entry.iter_mut().zip(rows.as_flattened()).for_each(|(to, &from)| *to = from as f32);
    entry
}
