//! Particles: the material points of a field.

mod seeding;

pub use seeding::{Jitter, Seeded, Seeding};

use gradreel::optim::Params;
use gradreel::{DType, ErrorKind, Result, Tape, Tensor};

use crate::field::Field;

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
