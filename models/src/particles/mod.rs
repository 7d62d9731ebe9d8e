//! Particles: the material points of a field.

mod seeding;

#[doc(hidden)] // the benchmarks use it
pub use seeding::Jitter;
pub(crate) use seeding::{Seeded, Seeding};

use std::collections::BTreeMap;

use gradreel::optim::Params;
use gradreel::{DType, ErrorKind, Result, Tape, Tensor};

use crate::field::Field;
use crate::vector::minus;

/// Material points at rest, with opacity and colour from the field.
#[derive(Debug, Clone)]
pub struct Particles {
    /// Positions in the first frame \[m\].
    pub positions: Vec<[f64; 3]>,
    /// Opacity in (0, 1]: the filled share of the particle's volume.
    pub opacity: Vec<f64>,
    /// Colour in 0…1.
    pub colour: Vec<[f64; 3]>,
    /// Distance between neighbours \[m\]; a particle represents a cube of this edge length.
    pub spacing: f64,
}

impl Particles {
    /// One particle per voxel of at least this opacity.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the store holds no field, or no voxel is opaque enough.
    pub fn of_field(field: &Field, params: &Params, least: f64) -> Result<Self> {
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let opacity = field.opacity(&bound)?.value()?.to_vec()?;
        let colour = field.colour(&bound)?.value()?.to_vec()?;
        let centres = field.centres();
        let kept: Vec<usize> = (0..field.len()).filter(|&i| opacity[i] >= least).collect();
        if kept.is_empty() {
            return Err(gradreel::Error::new(ErrorKind::Input, "the fitted field is empty")
                .found(format!("no voxel with an opacity of {least} or more"))
                .fix("check the masks and cameras of the first frame with `gradreel check`"));
        }
        Ok(Self {
            positions: kept.iter().map(|&i| [centres[[i, 0]], centres[[i, 1]], centres[[i, 2]]]).collect(),
            opacity: kept.iter().map(|&i| opacity[i]).collect(),
            colour: kept.iter().map(|&i| [0, 1, 2].map(|c| colour[3 * i + c])).collect(),
            spacing: field.node_grid.spacing,
        })
    }

    /// The particles whose positions satisfy a predicate.
    #[must_use]
    pub fn within(&self, holds: impl Fn([f64; 3]) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.positions.len()).filter(|&i| holds(self.positions[i])).collect();
        Self {
            positions: kept.iter().map(|&i| self.positions[i]).collect(),
            opacity: kept.iter().map(|&i| self.opacity[i]).collect(),
            colour: kept.iter().map(|&i| self.colour[i]).collect(),
            spacing: self.spacing,
        }
    }

    /// Particles of twice the spacing, each in place of those in a cube of that edge: their mass, their centre of mass and their
    /// mean colour.
    #[must_use]
    pub fn merged(&self) -> Self {
        let edge = 2.0 * self.spacing;
        let mut cubes = BTreeMap::<[i64; 3], [f64; 7]>::new();
        for ((x, opacity), colour) in self.positions.iter().zip(&self.opacity).zip(&self.colour) {
            let sums = cubes.entry(x.map(|x| (x / edge).floor() as i64)).or_default();
            sums[0] += opacity;
            (0..3).for_each(|axis| sums[1 + axis] += opacity * x[axis]);
            (0..3).for_each(|c| sums[4 + c] += opacity * colour[c]);
        }
        let mut merged = Self { positions: vec![], opacity: vec![], colour: vec![], spacing: edge };
        for [mass, x, y, z, r, g, b] in cubes.into_values().filter(|sums| sums[0] > 0.0) {
            merged.positions.push([x, y, z].map(|sum| sum / mass));
            merged.opacity.push(mass / 8.0);
            merged.colour.push([r, g, b].map(|sum| sum / mass));
        }
        merged
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are no particles.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// The filled volume \[m³\].
    pub fn volume(&self) -> f64 {
        self.opacity.iter().sum::<f64>() * self.spacing.powi(3)
    }

    /// The centre of mass \[m\].
    pub fn centre_of_mass(&self) -> [f64; 3] {
        let mass: f64 = self.opacity.iter().sum();
        [0, 1, 2]
            .map(|axis| self.positions.iter().zip(&self.opacity).map(|(x, alpha)| alpha * x[axis]).sum::<f64>() / mass)
    }

    /// Where each particle is, relative to the centre of mass \[m\].
    pub(crate) fn places(&self) -> Vec<[f64; 3]> {
        let centre = self.centre_of_mass();
        self.positions.iter().map(|x| minus(*x, centre)).collect()
    }

    /// Positions as a tensor `[particles, 3]` \[m\].
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    pub fn positions(&self, dtype: DType) -> Result<Tensor> {
        Tensor::from_vec(self.positions.as_flattened().to_vec(), [self.len(), 3]).cast(dtype)
    }

    /// Opacities as a tensor `[particles, 1]`.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    pub fn opacity(&self, dtype: DType) -> Result<Tensor> {
        Tensor::from_vec(self.opacity.clone(), [self.len(), 1]).cast(dtype)
    }

    /// Colours as a tensor `[particles, 3]`.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    pub fn colour(&self, dtype: DType) -> Result<Tensor> {
        Tensor::from_vec(self.colour.as_flattened().to_vec(), [self.len(), 3]).cast(dtype)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_particles_keep_mass_and_centre_of_mass() {
        let mut body = Particles { positions: vec![], opacity: vec![], colour: vec![], spacing: 0.1 };
        for n in 0..27 {
            let place = [n % 3, n / 3 % 3, n / 9].map(|k| 0.1 * (k as f64 + 0.5));
            body.positions.push(place);
            body.opacity.push(if n % 2 == 0 { 1.0 } else { 0.4 });
            body.colour.push([place[0], 0.5, 1.0]);
        }
        let merged = body.merged();
        assert_eq!((merged.len(), merged.spacing), (8, 0.2));
        approx::assert_relative_eq!(merged.volume(), body.volume(), max_relative = 1e-12);
        for (a, b) in merged.centre_of_mass().into_iter().zip(body.centre_of_mass()) {
            approx::assert_relative_eq!(a, b, max_relative = 1e-12);
        }
        assert!(merged.opacity.iter().all(|opacity| (0.0..=1.0).contains(opacity)));
        // colours are where they were
        assert!(merged.positions.iter().zip(&merged.colour).all(|(x, c)| (x[0] - c[0]).abs() < 1e-12));
    }
}
