//! From motion to pixels through a radiance field: particles carry density and features, every frame is splatted anew.

use gradreel::{Result, Tensor, Var};

use crate::constant;
use crate::field::{ColourNet, RadianceField};
use crate::particles::Seeded;
use crate::physics::{Body, Law, Remat, Schedule, World, rollout};
use crate::render::{FeatureSplat, Pixels, RadianceSettings, Rays, render_radiance, splat_features};

/// Pixels of one frame.
#[derive(Debug, Clone)]
pub struct FramePixels {
    /// Their rays.
    pub rays: Rays,
    /// Their colours on the background, `[rays, 3]`.
    pub target: Tensor,
    /// What each counts, `[rays]`: 0 for excluded ones, the view's weight where views count differently.
    pub weight: Tensor,
}

/// How moving particles of a radiance field are rendered.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionSettings {
    /// How they are spread.
    pub splat: FeatureSplat,
    /// How they are rendered.
    pub radiance: RadianceSettings,
}

/// What the pixels of all frames say.
#[derive(Debug, Clone)]
pub struct MotionLoss {
    /// The sum over frames.
    pub total: Var,
    /// `Σ weight · (rgb − target)² / (rays · frames)` of each frame.
    pub frames: Vec<Var>,
    /// What was rendered.
    pub pixels: Vec<Pixels>,
    /// The first node of each frame's grid.
    pub first_nodes: Vec<[i64; 3]>,
}

/// Whether a parameter of a material is proportional to stiffness, and so to α³ in a particle of opacity α, as published.
pub fn is_stiffness(parameter: &str) -> bool {
    matches!(parameter, "young" | "shear" | "bulk" | "viscosity")
}

/// A body of seeded particles: density `α ρ`, moduli and viscosities times α³, all else as it is.
///
/// `velocity` `[3]` \[m/s\] and `parameters` (`[1]` each, SI units, in the order of the law) live on the CPU.
pub fn body_of(particles: &Seeded, velocity: &Var, law: &Law, parameters: &[Var], density: f64) -> Body {
    let here = |x: &Var| x.to_device(&gradreel::Device::Cpu);
    let opacity = here(&particles.opacity);
    let cubed = &opacity.square() * &opacity;
    let parameter = |(known, value): (&crate::physics::Parameter, &Var)| {
        if is_stiffness(known.name) { value * &cubed } else { value.clone() }
    };
    Body {
        positions: here(&particles.positions),
        velocity: velocity.clone(),
        density: &opacity * density,
        parameters: law.parameters().iter().zip(parameters).map(parameter).collect(),
    }
}

/// Renders every frame of a motion `[frames, n, 3]` \[m\] of particles with these features `[n, 1 + features]` and compares it
/// with pixels.
///
/// # Errors
/// What the ops return.
pub fn motion_loss(
    motion: &Var,
    features: &Var,
    field: &RadianceField,
    colours: &ColourNet,
    frames: &[FramePixels],
    settings: &MotionSettings,
) -> Result<MotionLoss> {
    let spacing = field.grid.spacing;
    let absorption = settings.radiance.absorption(spacing, field.base_spacing, field.shift);
    let device = features.device();
    let (mut losses, mut pixels, mut first_nodes) = (Vec::new(), Vec::new(), Vec::new());
    for (f, frame) in frames.iter().enumerate() {
        let positions = motion.select(0, f).to_device(&device);
        let observed = splat_features(&positions, features, spacing, &settings.splat)?;
        let seen =
            render_radiance(&observed.values, &observed.grid, colours, &frame.rays, &settings.radiance, &absorption)?;
        let count = frame.rays.len();
        let (target, weight) = (constant::tensor(features, &frame.target)?, constant::tensor(features, &frame.weight)?);
        let squares = (&seen.rgb - &target).square() * weight.reshape([count, 1]);
        losses.push(squares.sum_all() / (count * frames.len()) as f64);
        pixels.push(seen);
        first_nodes.push(observed.first);
    }
    let mut total = &losses[0] * 1.0;
    for loss in &losses[1..] {
        total = total + loss;
    }
    Ok(MotionLoss { total, frames: losses, pixels, first_nodes })
}

/// The dynamic step: particles → rollout → [`splat_features`] → samples → loss. Returns positions `[frames, n, 3]` \[m\] and
/// the loss, differentiable in velocity and parameters.
///
/// # Errors
/// What the rollout and the ops return.
#[expect(clippy::too_many_arguments, reason = "the stage's whole input, named")]
pub fn dynamic_step(
    body: &Body,
    features: &Var,
    world: &World,
    law: &Law,
    schedule: Schedule,
    field: &RadianceField,
    colours: &ColourNet,
    frames: &[FramePixels],
    settings: &MotionSettings,
) -> Result<(Var, MotionLoss)> {
    let motion = rollout(world, law, schedule, Remat::default(), body)?;
    let loss = motion_loss(&motion, features, field, colours, frames, settings)?;
    Ok((motion, loss))
}
