//! The uniform words of every kernel. Mirrors `models/kernels/shared/substep.wgsl`.

use super::portion::OnDevice;
use crate::physics::world::World;

/// Number of words of the struct.
pub(super) const COUNT: usize = 24;

/// The constants of a rollout, and the arguments of a dispatch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Words([u32; COUNT]);

impl Words {
    /// The words of a world; `capacity` is that of the grid in nodes.
    pub fn of(world: &World, dt: f64, particles: usize, capacity: usize, tracked: bool) -> Self {
        let mut words = [0; COUNT];
        words[0] = word(particles);
        words[2] = word(capacity);
        words[3] = word(world.colliders.len());
        let dx = world.dx as f32;
        words[8..11].copy_from_slice(&[dx, (1.0 / world.dx) as f32, dt as f32].map(f32::to_bits));
        let [low, high] = world.bounds.unwrap_or([[f64::MIN; 3], [f64::MAX; 3]]);
        let most = |x: f64| (x as f32).clamp(f32::MIN, f32::MAX).to_bits();
        for axis in 0..3 {
            words[12 + axis] = ((world.gravity[axis] * dt) as f32).to_bits();
            words[16 + axis] = most(low[axis]);
            words[20 + axis] = most(high[axis]);
        }
        words[15] = (world.least_mass() as f32).to_bits();
        words[19] = ((world.dx / dt) as f32).to_bits();
        words[23] = u32::from(tracked);
        Self(words)
    }

    /// Sets the substep.
    pub fn at(mut self, step: usize, first_obstacle: usize) -> Self {
        self.0[1] = word(step);
        self.0[4] = word(first_obstacle);
        self
    }

    /// Sets the portion of one material.
    pub fn portion(mut self, portion: &OnDevice<'_>) -> Self {
        self.0[5] = word(portion.first);
        self.0[6] = word(portion.count);
        self.0[11] = portion.stress_scale.to_bits();
        self
    }

    /// Sets the frame.
    pub fn frame(mut self, frame: usize) -> Self {
        self.0[7] = word(frame);
        self
    }

    /// Sets the length of a scan.
    pub fn scan(mut self, numbers: usize) -> Self {
        self.0[2] = word(numbers);
        self
    }

    /// The words in the layout of the kernels.
    pub fn as_slice(&self) -> &[u32] {
        &self.0
    }
}

/// Counts fit: buffers of more than 2³² entries are refused at creation.
#[allow(clippy::cast_possible_truncation)]
fn word(count: usize) -> u32 {
    count as u32
}
