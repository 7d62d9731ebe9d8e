//! Fitting the voxels to the first frame by differentiable volume rendering.

use std::sync::Arc;

use gradreel::optim::{Adam, Params};
use gradreel::{Result, Tape, Tensor};

use crate::field::Field;
use crate::render::{Rays, Splat, Surface, Target, render};

/// How the voxels are fitted.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Adam iterations on the first frame; half as many on those of free flight.
    pub iterations: usize,
    /// Adam iterations once the motion through all frames is known.
    pub in_motion: usize,
    /// Rate of the raw density.
    pub density_rate: f64,
    /// Rate of the raw colour.
    pub colour_rate: f64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { iterations: 80, in_motion: 25, density_rate: 0.2, colour_rate: 0.05 }
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

/// One picture of the voxels: where they are in it, and what was filmed.
pub struct Pose<'a> {
    /// Positions of the voxels \[m\], `[voxels, 3]`.
    pub positions: Tensor,
    /// The pixels.
    pub target: &'a Target,
    /// Their rays.
    pub rays: &'a Arc<Rays>,
}

/// Fits raw density and colour to the mean loss of some poses, from `start` (a store and an optimiser, both of which a
/// checkpoint can hold) on.
///
/// # Errors
/// What rendering returns, and what `each` returns (an interruption, say), which is called after every iteration.
#[expect(clippy::too_many_arguments, reason = "the stage's whole input, named")]
pub fn fit(
    field: &Field,
    mut params: Params,
    mut adam: Adam,
    iterations: std::ops::Range<usize>,
    poses: &[Pose<'_>],
    surface: &Surface,
    splat: &Splat,
    mut each: impl FnMut(FitState<'_>) -> Result<()>,
) -> Result<Params> {
    for iteration in iterations {
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let (opacity, colour) = (field.opacity(&bound)?, field.colour(&bound)?);
        let mut total = tape.constant(Tensor::scalar(0.0, opacity.dtype()));
        for pose in poses {
            let pixels = render(&tape.constant(pose.positions.clone()), &opacity, &colour, pose.rays, splat, surface)?;
            total = &total + &pose.target.loss(&pixels);
        }
        let loss = &total / poses.len() as f64;
        let gradients = bound.gradients(&loss.backward()?)?;
        adam.step(&mut params, &gradients)?;
        each(FitState { iteration: iteration + 1, loss: loss.item()?, params: &params, adam: &adam })?;
    }
    Ok(params)
}
