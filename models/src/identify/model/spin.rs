//! A body that turns while it flies: its velocities, and how it is turned after a while.

use gradreel::{DType, Result, Tensor};

use crate::particles::Particles;
use crate::vector::{EYE, cross, inverse, minus, plus, product, rotation, times, transposed};

type Vector = [f64; 3];
type Matrix = [Vector; 3];

/// How the mass of a body lies about its centre.
#[derive(Debug, Clone)]
pub(in crate::identify) struct Gyration {
    /// The centre of mass \[m\].
    pub centre: Vector,
    /// The inertia per mass, `Σ m (r² 1 − r rᵀ)/Σ m` with that of the particles' cubes \[m²\].
    inertia: Matrix,
    /// Its inverse \[1/m²\].
    inverse: Matrix,
}

/// Steps of the turning motion between two frames.
const STEPS: usize = 8;

impl Gyration {
    /// Of particles, each as heavy as it is opaque.
    pub fn of(particles: &Particles) -> Self {
        let centre = particles.centre_of_mass();
        let mass: f64 = particles.opacity.iter().sum();
        let mut inertia = EYE.map(|row| row.map(|one| one * particles.spacing.powi(2) / 6.0));
        for (x, opacity) in particles.positions.iter().zip(&particles.opacity) {
            let r = minus(*x, centre);
            let square: f64 = r.iter().map(|r| r * r).sum();
            for i in 0..3 {
                for j in 0..3 {
                    inertia[i][j] += opacity / mass * (square * EYE[i][j] - r[i] * r[j]);
                }
            }
        }
        Self { centre, inertia, inverse: inverse(inertia) }
    }

    /// The initial velocity of each particle for a spin of 1 rad/s about each axis, `[3, 3 particles]` \[m/s\], in a simulation on a
    /// grid of spacing `dx`.
    ///
    /// Particles begin without a velocity gradient of their own, which in an affine transfer carries the inertia `dx²/2` per mass about each axis;
    /// they begin that much faster, so that the body has the whole angular momentum.
    ///
    /// # Errors
    /// Never for `f32` and `f64`.
    pub fn velocities(&self, particles: &Particles, dx: f64, dtype: DType) -> Result<Tensor> {
        let mut values = Vec::with_capacity(9 * particles.len());
        for axis in EYE {
            let faster = plus(axis, times(&self.inverse, axis).map(|w| 0.5 * dx * dx * w));
            values.extend(particles.positions.iter().flat_map(|x| cross(faster, minus(*x, self.centre))));
        }
        Tensor::from_vec(values, [3, 3 * particles.len()]).cast(dtype)
    }

    /// How a body that begins with this spin \[rad/s\] is turned after each of `frames` frames, when nothing acts upon it: its angular
    /// momentum `L` stays, and it turns about `R I⁻¹ Rᵀ L` (Euler), not about one axis unless that is a principal one.
    pub fn turned(&self, spin: Vector, frame_dt: f64, frames: usize) -> Vec<Matrix> {
        let momentum = times(&self.inertia, spin);
        let rate = |turned: &Matrix| times(turned, times(&self.inverse, times(&transposed(*turned), momentum)));
        let after = |turned: Matrix, rate: Vector, dt: f64| product(rotation(rate.map(|w| w * dt)), turned);
        let dt = frame_dt / STEPS as f64;
        let mut turned = EYE;
        let mut all = Vec::with_capacity(frames);
        for _ in 0..frames {
            all.push(turned);
            for _ in 0..STEPS {
                let half = after(turned, rate(&turned), 0.5 * dt);
                turned = after(turned, rate(&half), dt);
            }
        }
        all
    }

    /// Where something at `x` is when the body is turned like this about its centre.
    pub fn place(&self, turned: &Matrix, x: Vector) -> Vector {
        plus(self.centre, times(turned, minus(x, self.centre)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::dot;

    /// A box of 6 × 4 × 2 particles.
    fn slab() -> Particles {
        let places = (0..48).map(|i| [i / 8, i / 2 % 4, i % 2].map(|k| 0.01 * k as f64));
        Particles { positions: places.collect(), opacity: vec![1.0; 48], colour: vec![[0.5; 3]; 48], spacing: 0.01 }
    }

    #[test]
    fn a_box_of_cubes_has_the_inertia_of_a_box() {
        let gyration = Gyration::of(&slab());
        let [a, b, c] = [0.06f64, 0.04, 0.02].map(|edge| edge * edge / 12.0);
        for (k, wanted) in [b + c, a + c, a + b].into_iter().enumerate() {
            approx::assert_relative_eq!(gyration.inertia[k][k], wanted, max_relative = 1e-12);
        }
        approx::assert_relative_eq!(gyration.inertia[0][1], 0.0, epsilon = 1e-18);
    }

    /// About a principal axis a body turns evenly; about another one both angular momentum and energy stay.
    #[test]
    fn nothing_acts_upon_a_body_that_flies() {
        let gyration = Gyration::of(&slab());
        let turned = gyration.turned([0.0, 0.0, 6.0], 0.05, 4)[3];
        approx::assert_relative_eq!(turned[1][0], 0.9f64.sin(), max_relative = 1e-9);
        approx::assert_relative_eq!(turned[2][2], 1.0, max_relative = 1e-12);
        let spin = [3.0, 4.0, -2.0];
        let momentum = times(&gyration.inertia, spin);
        let all = gyration.turned(spin, 1.0 / 24.0, 14);
        let energy = |turned: &Matrix| {
            let own = times(&transposed(*turned), momentum);
            dot(own, times(&gyration.inverse, own))
        };
        for turned in &all {
            approx::assert_relative_eq!(energy(turned), dot(spin, momentum), max_relative = 1e-3);
        }
        // as the simulation's Euler equations have it at the start: I dω/dt = −ω × I ω
        let ahead = 1e-3;
        let small = gyration.turned(spin, ahead, 3);
        let angle = |m: &Matrix| [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]].map(|a| 0.5 * a);
        let between = |a: &Matrix, b: &Matrix| angle(&product(*b, transposed(*a))).map(|w| w / ahead);
        let (first, second) = (between(&small[0], &small[1]), between(&small[1], &small[2]));
        let change = times(&gyration.inverse, cross(momentum, spin));
        for k in 0..3 {
            approx::assert_relative_eq!((second[k] - first[k]) / ahead, change[k], max_relative = 2e-2, epsilon = 0.05);
        }
    }
}
