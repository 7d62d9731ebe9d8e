//! Bodies of several materials: inputs of a simulation, and the call.

use std::sync::Arc;

use gradreel::{Result, Var};

use super::law::Law;
use super::remat::Remat;
use super::rollout::Rollout;
use super::timestep::Schedule;
use super::world::World;

/// Particles of one or more materials; see [`Rollout`] for shapes and units.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Positions \[m\].
    pub positions: Var,
    /// Velocity \[m/s\].
    pub velocity: Var,
    /// Density \[kg/m³\].
    pub density: Var,
    /// Gravity \[m/s²\], overriding the world's, to be differentiated.
    pub gravity: Option<Var>,
    /// Friction coefficients, overriding those of the obstacles, to be differentiated: one for all obstacles with
    /// [`Contact::Friction`](super::Contact::Friction), or one per obstacle.
    pub friction: Option<Var>,
    /// The materials.
    pub materials: Vec<Substance>,
    /// The index in `materials` of each particle's material; optional if there is only one.
    pub material_of: Option<Arc<[u32]>>,
}

/// A material with its parameters, `[1]` or `[n]` each, in the order of [`Law::parameters`]. Of `n` entries, those of
/// the material's own particles are used.
#[derive(Debug, Clone)]
pub struct Substance {
    /// The material.
    pub law: Law,
    /// Its parameters.
    pub parameters: Vec<Var>,
}

/// Simulates a scene: positions `[frames, n, 3]` \[m\] at the times of the schedule.
///
/// ```
/// use gradreel::{Tape, Tensor};
/// use gradreel_models::physics::{CFL, Remat, Scene, Schedule, Substance, World, materials, simulate};
///
/// let tape = Tape::new();
/// let number = |value: f64| tape.leaf(Tensor::from_vec(vec![value], [1]));
/// let of = |name: &str, values: &[f64]| {
///     let law = materials::find(name).unwrap();
///     Substance { law, parameters: values.iter().map(|&value| number(value)).collect() }
/// };
/// // The lower half is sand, the upper half rubber.
/// let scene = Scene {
///     positions: tape.constant(Tensor::from_vec((0..24).map(|i| 0.01 * f64::from(i / 3)).collect(), [8, 3])),
///     velocity: tape.constant(Tensor::from_vec(vec![0.0, 0.0, 0.0], [3])),
///     density: number(1000.0),
///     gravity: Some(tape.leaf(Tensor::from_vec(vec![0.0, -9.8, 0.0], [3]))),
///     friction: None,
///     materials: vec![of("drucker_prager", &[1e5, 0.3, 35.0, 0.0]), of("neo_hookean", &[1e5, 0.3])],
///     material_of: Some([0, 0, 0, 0, 1, 1, 1, 1].into()),
/// };
/// let schedule = Schedule { frames: 2, frame_dt: 1e-2, substeps: 20 };
/// let motion = simulate(&World::new(0.02), &scene, schedule, Remat::default())?;
/// let gradients = motion.select(2, 1).mean_all().backward()?;
/// assert!(gradients.wrt(scene.gravity.as_ref().unwrap())?.to_vec()?[1] > 0.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
///
/// [`ErrorKind::Physics`](gradreel::ErrorKind::Physics) when the simulation breaks down, naming particle, substep, time
/// and position; [`ErrorKind::NonFinite`](gradreel::ErrorKind::NonFinite) for inputs that are not finite;
/// [`ErrorKind::Shape`](gradreel::ErrorKind::Shape) for inputs of the wrong shape;
/// [`ErrorKind::Input`](gradreel::ErrorKind::Input) for a particle without material.
pub fn simulate(world: &World, scene: &Scene, schedule: Schedule, remat: Remat) -> Result<Var> {
    let others: Vec<&Var> = [&scene.velocity, &scene.density]
        .into_iter()
        .chain(&scene.gravity)
        .chain(&scene.friction)
        .chain(scene.materials.iter().flat_map(|material| &material.parameters))
        .collect();
    let differentiable = scene.positions.is_differentiable() || others.iter().any(|var| var.is_differentiable());
    let op = Rollout {
        world: world.clone(),
        laws: scene.materials.iter().map(|material| material.law.clone()).collect(),
        material_of: scene.material_of.clone(),
        gravity: scene.gravity.is_some(),
        friction: scene.friction.is_some(),
        schedule,
        remat: differentiable.then_some(remat),
    };
    scene.positions.apply(op, &others)
}
