//! Fitting the voxels to what was filmed.

use gradreel::optim::{Adam, Bound, Params};
use gradreel::{Result, Tape, Var};

use crate::field::{Faces, Field};

/// How the voxels are fitted.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Adam iterations on the first frame; half as many on those of free flight.
    pub iterations: usize,
    /// Adam iterations once the motion through all frames is known.
    pub in_motion: usize,
    /// What the area of the surface counts, in units of that of a cube of as many voxels ([`Faces::area`](crate::field::Faces::area)), of
    /// a body that several cameras filmed. Without, pits are dug where no camera looks straight at the surface. Of a body that flows and a single
    /// camera filmed, what is carved counts ([`Faces::carved`]), of others nothing does.
    pub smoothness: f64,
    /// Rate of the raw density.
    pub density_rate: f64,
    /// The same once the motion is known.
    pub density_rate_in_motion: f64,
    /// Rate of the raw colour.
    pub colour_rate: f64,
    /// Rate of the material, which is fitted with the voxels once the motion is known, in the coordinates that a search moves (decades of a
    /// modulus); 0 holds it.
    pub material_rate: f64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            iterations: 80,
            in_motion: 25,
            smoothness: 0.01,
            density_rate: 0.2,
            density_rate_in_motion: 0.4,
            colour_rate: 0.05,
            material_rate: 0.01,
        }
    }
}

impl FitSettings {
    /// The optimiser with these rates.
    pub(crate) fn adam(&self) -> Adam {
        Adam::new(self.colour_rate).with_rate("field.density", self.density_rate)
    }

    /// The same once the motion is known; `material` is the path of what of the material is fitted with the voxels, if any is.
    pub(crate) fn adam_in_motion(&self, material: Option<&str>) -> Adam {
        let adam = Adam::new(self.colour_rate).with_rate("field.density", self.density_rate_in_motion);
        match material {
            Some(path) => adam.with_rate(path, self.material_rate),
            None => adam,
        }
    }
}

/// What one iteration reached, for progress reports and checkpoints.
pub struct FitState<'a> {
    /// Iteration, from 1.
    pub iteration: usize,
    /// Its loss.
    pub loss: f64,
    /// The raw values after the step.
    pub params: &'a Params,
    /// The optimiser after the step.
    pub adam: &'a Adam,
}

/// Fits a store of raw density and colour, and of whatever else it holds, to a loss of the store, opacity `[voxels, 1]` and colour `[voxels, 3]`, to which the area of
/// the surface is added as often as `smoothness` says, from a store and an optimiser (both of which a checkpoint can hold) on. What lies behind the surface stays filled ([`Field::fill_inside`]).
///
/// # Errors
/// What the loss returns, and what `each` returns (an interruption, say), which is called after every iteration.
pub fn fit(
    field: &Field,
    mut params: Params,
    mut adam: Adam,
    iterations: std::ops::Range<usize>,
    smoothness: Option<(Faces, f64)>,
    loss: &dyn Fn(&Bound, &Var, &Var) -> Result<Var>,
    mut each: impl FnMut(FitState<'_>) -> Result<()>,
) -> Result<Params> {
    for iteration in iterations {
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let opacity = field.opacity(&bound)?;
        let loss = loss(&bound, &opacity, &field.colour(&bound)?)?;
        let whole = match &smoothness {
            Some((faces, counts)) => &loss + &(faces.area(&opacity)? * *counts),
            None => loss.clone(),
        };
        let gradients = bound.gradients(&whole.backward()?)?;
        adam.step(&mut params, &gradients)?;
        field.fill_inside(&mut params)?;
        each(FitState { iteration: iteration + 1, loss: loss.item()?, params: &params, adam: &adam })?;
    }
    Ok(params)
}
