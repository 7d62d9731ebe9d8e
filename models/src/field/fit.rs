//! Fitting of the voxels to the frames.

use gradreel::optim::{Adam, Bound, Params};
use gradreel::{Result, Tape, Var};

use crate::field::{Faces, Field};

/// Settings of the voxel fit.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Adam iterations on the first frame; half as many on the frames of free flight.
    pub iterations: usize,
    /// Adam iterations once the motion through all frames is known.
    pub in_motion: usize,
    /// Weight of the surface area (`Faces::area`) for bodies seen by several cameras. It
    /// prevents pits where no camera faces the surface. With a single camera, fluid-like bodies use `Faces::carved`;
    /// others have no such term.
    pub smoothness: f64,
    /// Learning rate of the raw density.
    #[serde(skip)]
    pub density_rate: f64,
    /// Learning rate of the raw density once the motion is known.
    #[serde(skip)]
    pub density_rate_in_motion: f64,
    /// Learning rate of the raw colour.
    #[serde(skip)]
    pub colour_rate: f64,
    /// Learning rate of the material, fitted jointly with the voxels once the motion is known, in search coordinates
    /// (decades of a modulus). 0 keeps the material fixed.
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

    /// The optimiser once the motion is known; `material` is the path of the material parameters that are fitted along,
    /// if any.
    pub(crate) fn adam_in_motion(&self, material: Option<&str>) -> Adam {
        let adam = Adam::new(self.colour_rate).with_rate("field.density", self.density_rate_in_motion);
        match material {
            Some(path) => adam.with_rate(path, self.material_rate),
            None => adam,
        }
    }
}

/// State after one iteration, for progress reports and checkpoints.
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

/// Fits a store with raw density and colour (and possibly more) by Adam. The loss is a function of the store, opacity
/// `[voxels, 1]` and colour `[voxels, 3]`; the surface area is added with the weight `smoothness`.
///
/// The fit continues from the given store and optimiser, which a checkpoint can hold. Voxels behind the surface stay
/// filled ([`Field::fill_inside`]). `each` is called after every iteration.
///
/// # Errors
/// Propagates errors of the loss and of `each`, such as an interruption.
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
