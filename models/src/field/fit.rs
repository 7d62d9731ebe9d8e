//! Fitting the voxels to the first frame by differentiable volume rendering.

use std::sync::Arc;

use gradreel::optim::{Adam, Params};
use gradreel::{DType, Result, Tape, Tensor};

use crate::field::Field;
use crate::render::{Rays, Splat, Surface, Target, render};

/// How the voxels are fitted.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Adam iterations.
    pub iterations: usize,
    /// Rate of the raw density.
    pub density_rate: f64,
    /// Rate of the raw colour.
    pub colour_rate: f64,
    /// Weight of the mean opacity in the loss: what no image asks for fades away.
    pub volume_weight: f64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { iterations: 200, density_rate: 0.2, colour_rate: 0.05, volume_weight: 0.0 }
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

/// Fits raw density and colour to one frame, from `start` (a store and an optimiser, both of which a checkpoint can hold) on.
///
/// # Errors
/// What rendering returns, and what `each` returns (an interruption, say), which is called after every iteration.
#[expect(clippy::too_many_arguments, reason = "the stage's whole input, named")]
pub fn fit(
    field: &Field,
    mut params: Params,
    mut adam: Adam,
    done: usize,
    target: &Target,
    rays: &Arc<Rays>,
    surface: &Surface,
    splat: &Splat,
    settings: &FitSettings,
    mut each: impl FnMut(FitState<'_>) -> Result<()>,
) -> Result<Params> {
    let positions = Tensor::from(field.centres().into_dyn()).cast(DType::F32)?;
    for iteration in done + 1..=settings.iterations {
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let (opacity, colour) = (field.opacity(&bound)?, field.colour(&bound)?);
        let pixels = render(&tape.constant(positions.clone()), &opacity, &colour, rays, splat, surface)?;
        let photometric = target.loss(&pixels);
        let loss = &photometric + &(&opacity.mean_all() * settings.volume_weight);
        let gradients = bound.gradients(&loss.backward()?)?;
        adam.step(&mut params, &gradients)?;
        each(FitState { iteration, loss: photometric.item()?, params: &params, adam: &adam })?;
    }
    Ok(params)
}
