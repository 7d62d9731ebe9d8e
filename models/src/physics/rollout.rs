//! A whole simulation as one op of the tape.

mod cotangents;
mod gpu;
mod jvp;

use std::sync::Arc;

use gradreel::backend::gpu::Gpu;
use gradreel::{Backward, DType, Device, Error, ErrorKind, Forward, Op, Operands, Reads, Result, Spec, Tensor, Var};

use super::collider::Contact;
use super::law::Law;
use super::node_grid::neighbours;
use super::remat::Remat;
use super::row::Number;
use super::scene::{Scene, Substance, simulate};
use super::state::{State, V};
use super::substep::{Portion, Simulation};
use super::timestep::Schedule;
use super::trajectory::Trajectory;
use super::values::{Values, check_values};
use super::world::World;

/// Simulates particles and returns their positions at every frame; differentiable in all inputs.
///
/// | input | shape | unit |
/// |---|---|---|
/// | positions | `[n, 3]` | m |
/// | velocity | `[3]` or `[n, 3]` | m/s |
/// | density | `[1]` or `[n]` | kg/m³ |
/// | gravity, if [`Rollout::gravity`] | `[3]` | m/s² |
/// | friction, if [`Rollout::friction`] | `[1]` or `[colliders]` | - |
/// | each parameter of each material | `[1]` or `[n]` | its own |
///
/// The output is `[frames, n, 3]` \[m\]; frame 0 is the input. All inputs have the same dtype, `f32` or `f64`, and the
/// same device. On a GPU, in `f32`, all substeps run there, forward and backward; inputs are read once at the start,
/// and gradients that are sums over particles are summed on the CPU at the end. FLIP and forward mode are not available
/// on a GPU.
#[derive(Debug, Clone)]
pub struct Rollout {
    /// Grid, gravity, obstacles and limits.
    pub world: World,
    /// Materials.
    pub laws: Vec<Law>,
    /// The index in `laws` of each particle's material; `None` where there is only one.
    pub material_of: Option<Arc<[u32]>>,
    /// Whether gravity is an input, overriding that of `world`.
    pub gravity: bool,
    /// Whether the coefficients of [`Contact::Friction`] are an input, overriding those of the obstacles: one for all,
    /// or one per obstacle, used where the obstacle has friction.
    pub friction: bool,
    /// Times of frames and substeps.
    pub schedule: Schedule,
    /// States kept for the backward pass; `None` for a rollout that is not differentiated in reverse.
    pub remat: Option<Remat>,
}

/// The inputs of a [`rollout`] of one material; see [`Rollout`] for shapes and units.
#[derive(Debug, Clone)]
pub struct Body {
    /// Positions \[m\].
    pub positions: Var,
    /// Velocity \[m/s\].
    pub velocity: Var,
    /// Density \[kg/m³\].
    pub density: Var,
    /// The material's parameters, in order.
    pub parameters: Vec<Var>,
}

/// Simulates a body of one material; see [`Rollout`], and [`simulate`](super::simulate) for several.
///
/// ```
/// use gradreel::{Tape, Tensor};
/// use gradreel_models::physics::{Body, CFL, Collider, Law, Remat, Schedule, World, materials::NeoHookean, rollout};
///
/// let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(0.02) };
/// let law = Law::of(NeoHookean);
/// let sound = law.wave_speed(&[1e4, 0.3], 1000.0);
/// let schedule = Schedule::stable(&world, 3, 1.0 / 60.0, sound, 2.0, CFL);
///
/// let tape = Tape::new();
/// let cube = (0..64).flat_map(|i| [i / 16, i / 4 % 4, i % 4].map(|k| 0.02 + 0.01 * k as f32)).collect();
/// let young = tape.leaf(Tensor::from_vec(vec![1e4_f32], [1]));
/// let body = Body {
///     positions: tape.constant(Tensor::from_vec(cube, [64, 3])),
///     velocity: tape.constant(Tensor::from_vec(vec![0.0_f32, -2.0, 0.0], [3])),
///     density: tape.constant(Tensor::from_vec(vec![1000.0_f32], [1])),
///     parameters: vec![young.clone(), tape.constant(Tensor::from_vec(vec![0.3_f32], [1]))],
/// };
/// let motion = rollout(&world, &law, schedule, Remat::default(), &body)?;
/// assert_eq!(motion.dims(), [3, 64, 3]);
///
/// // How the sum of squares of all coordinates would change with stiffness: m²/Pa.
/// let gradients = motion.square().sum_all().backward()?;
/// assert!(gradients.wrt(&young)?.item()? != 0.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
///
/// [`ErrorKind::Physics`] when the simulation breaks down, naming particle, substep, time and position;
/// [`ErrorKind::NonFinite`] for inputs that are not finite; [`ErrorKind::Shape`] for inputs of the wrong shape.
pub fn rollout(world: &World, law: &Law, schedule: Schedule, remat: Remat, body: &Body) -> Result<Var> {
    let Body { positions, velocity, density, parameters } = body.clone();
    let materials = vec![Substance { law: law.clone(), parameters }];
    let scene = Scene { positions, velocity, density, gravity: None, friction: None, materials, material_of: None };
    simulate(world, &scene, schedule, remat)
}

/// State kept by the forward pass for the backward pass.
#[derive(Debug)]
struct Kept<T> {
    trajectory: Trajectory<T>,
    /// The caller's index of each particle in grid order.
    order: Vec<u32>,
}

impl Op for Rollout {
    fn name(&self) -> &str {
        "rollout"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let names = self.input_names();
        let fault = |what: String| Error::new(ErrorKind::Shape, what).at("rollout");
        if inputs.len() != names.len() {
            return Err(fault("wrong number of inputs".into()).found(inputs.len()).wanted(format!("{names:?}")));
        }
        let n = match inputs[0].shape.dims() {
            &[n, 3] => n,
            _ => return Err(fault("positions have the wrong shape".into()).found(&inputs[0].shape).wanted("[n, 3]")),
        };
        for (index, (spec, name)) in inputs.iter().zip(&names).enumerate().skip(1) {
            let dims = spec.shape.dims();
            let (fits, wanted) = match index {
                1 => (dims == [3] || dims == [n, 3], format!("[3] or [{n}, 3]")),
                3 if self.gravity => (dims == [3], "[3]".to_owned()),
                _ if self.friction && index == self.friction_at() => {
                    let colliders = self.world.colliders.len();
                    (dims == [1] || dims == [colliders], format!("[1] or [{colliders}], one per obstacle"))
                }
                _ => (dims == [1] || dims == [n], format!("[1] or [{n}]")),
            };
            if !fits {
                return Err(fault(format!("'{name}' has the wrong shape")).found(&spec.shape).wanted(wanted));
            }
        }
        self.check_materials(n)?;
        let dtype = inputs[0].dtype;
        if !dtype.is_real() || inputs.iter().any(|spec| spec.dtype != dtype) {
            let found: Vec<String> = inputs.iter().map(|spec| spec.dtype.to_string()).collect();
            return Err(fault("dtypes do not fit".into()).found(found.join(", ")).wanted("all f32, or all f64"));
        }
        Ok(Spec::new([self.schedule.frames, n, 3], dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        match inputs[0].dtype() {
            DType::F64 => self.forward::<f64>(&inputs),
            _ => self.forward::<f32>(&inputs),
        }
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        self.forward_on(gpu, &inputs)
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        cx.first_order_only(self.name())?;
        if self.remat.is_none() {
            return Err(Error::new(ErrorKind::NoGradient, "this rollout kept nothing for its backward pass")
                .at("rollout")
                .found("Rollout::remat is None")
                .fix("choose a Remat"));
        }
        match (cx.gradient().device(), cx.gradient().dtype()) {
            (Device::Gpu(gpu), _) => self.backward_on(&gpu, cx),
            (Device::Cpu, DType::F64) => self.backward::<f64>(cx),
            (Device::Cpu, _) => self.backward::<f32>(cx),
        }
    }
}

impl Rollout {
    /// A rollout of one material in a constant world, without reverse mode.
    pub fn of_one(world: &World, law: &Law, schedule: Schedule) -> Self {
        let (world, laws) = (world.clone(), vec![law.clone()]);
        Self { world, laws, material_of: None, gravity: false, friction: false, schedule, remat: None }
    }

    fn forward<T: Number>(&self, inputs: &[Tensor]) -> Result<Forward> {
        let n = inputs[0].dims()[0];
        let world = self.world_of::<T>(inputs)?;
        let (order, values) = self.prepare::<T>(inputs, &world)?;
        let mut simulation = self.simulation(&world, &values, &order)?;
        let start = start::<T>(&simulation, inputs, &order)?;
        let mut output = vec![[T::ZERO; 3]; self.schedule.frames * n];
        let trajectory = rayon::scope(|_| {
            Trajectory::forward(&mut simulation, start, self.schedule, self.remat, |frame, state| {
                for (p, &label) in order.iter().enumerate() {
                    output[frame * n + label as usize] = state.read(p, 0);
                }
            })
        })?;
        let output = Tensor::from_vec(output.into_flattened(), [self.schedule.frames, n, 3]);
        Ok(Forward::with_residual(output, Kept { trajectory, order }))
    }

    /// Validates the inputs. Returns the particle order, and densities and parameters in the caller's order.
    fn prepare<T: Number>(&self, inputs: &[Tensor], world: &World) -> Result<(Vec<u32>, Inputs<T>)> {
        finite("positions", inputs[0].slice::<T>(), 3)?;
        finite("velocity", inputs[1].slice::<T>(), 3)?;
        let positions: Vec<[T; 3]> = triples(&inputs[0]);
        let n = positions.len();
        world.check()?;
        self.schedule.check()?;
        let values = self.values::<T>(inputs, n)?;
        for (index, (law, parameters)) in self.laws.iter().zip(&values.parameters).enumerate() {
            let member = |particle: usize| self.material_of.as_ref().is_none_or(|of| of[particle] as usize == index);
            self.schedule.check_waves(world, law, &values.density, parameters, n, member)?;
        }
        Ok((self.order(&positions), values))
    }

    fn backward<T: Number>(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let Kept { trajectory, order } = cx.residual::<Kept<T>>();
        let inputs = cx.inputs().iter().map(|var| var.value().cloned()).collect::<Result<Vec<Tensor>>>()?;
        let n = order.len();
        let world = self.world_of::<T>(&inputs)?;
        let mut simulation = self.simulation(&world, &self.values::<T>(&inputs, n)?, order)?;
        let gradient = cx.gradient().value()?.clone();
        let frames: &[T] = gradient.slice();
        let start = rayon::scope(|_| {
            trajectory.backward(&mut simulation, n, |frame, cotangent| {
                for (p, &label) in order.iter().enumerate() {
                    let at = 3 * (frame * n + label as usize);
                    cotangent.add_to_position(p, [frames[at], frames[at + 1], frames[at + 2]]);
                }
            })
        })?;
        let start = [0, V].map(|component| (0..n).map(|p| start.read(p, component)).collect());
        self.hand_back(cx, &inputs, order, start, simulation.value_gradients())
    }

    /// The names of the inputs, in order.
    fn input_names(&self) -> Vec<&'static str> {
        let parameters = self.laws.iter().flat_map(|law| law.parameters()).map(|parameter| parameter.name);
        let gravity = self.gravity.then_some("gravity");
        let friction = self.friction.then_some("friction");
        ["positions", "velocity", "density"].into_iter().chain(gravity).chain(friction).chain(parameters).collect()
    }

    /// The index of the friction input.
    fn friction_at(&self) -> usize {
        3 + usize::from(self.gravity)
    }

    /// Number of inputs before the material parameters.
    fn inputs_of_world(&self) -> usize {
        self.friction_at() + usize::from(self.friction)
    }

    /// The world, with gravity and friction taken from the inputs.
    fn world_of<T: Number>(&self, inputs: &[Tensor]) -> Result<World> {
        let mut world = self.world.clone();
        if self.gravity {
            let gravity = inputs[3].slice::<T>();
            finite("gravity", gravity, 3)?;
            world.gravity = std::array::from_fn(|axis| gravity[axis].to_f64());
        }
        if self.friction {
            let given = inputs[self.friction_at()].slice::<T>();
            finite("friction", given, 1)?;
            let mut rough = 0;
            for (index, collider) in world.colliders.iter_mut().enumerate() {
                if let Contact::Friction(mu) = &mut collider.contact {
                    *mu = given[if given.len() == 1 { 0 } else { index }].to_f64();
                    rough += 1;
                }
            }
            if rough == 0 {
                return Err(Error::new(
                    ErrorKind::Input,
                    "a coefficient of friction is given, but nothing has friction",
                )
                .at("rollout")
                .found(format!("{} colliders, none with Contact::Friction", world.colliders.len()))
                .fix("give a collider the contact Contact::Friction(coefficient)"));
            }
        }
        Ok(world)
    }

    /// Densities and parameters in the caller's order, validated.
    fn values<T: Number>(&self, inputs: &[Tensor], n: usize) -> Result<Inputs<T>> {
        let values = |input: &Tensor| match input.slice::<T>() {
            &[one] if input.dims() == [1] => Values::Same(one),
            each => Values::Each(each.to_vec()),
        };
        let density = values(&inputs[2]);
        let mut rest = inputs[self.inputs_of_world()..].iter().map(values);
        let parameters: Vec<Vec<Values<T>>> =
            self.laws.iter().map(|law| rest.by_ref().take(law.parameters().len()).collect()).collect();
        for (law, parameters) in self.laws.iter().zip(&parameters) {
            check_values(law, &density, parameters, n)?;
        }
        Ok(Inputs { density, parameters })
    }

    /// The simulation of the particles in grid order.
    fn simulation<'a, T: Number>(
        &'a self,
        world: &'a World,
        values: &Inputs<T>,
        order: &[u32],
    ) -> Result<Simulation<'a, T>> {
        let sorted = |values: &Values<T>| match values {
            Values::Same(value) => Values::Same(*value),
            Values::Each(each) => Values::Each(order.iter().map(|&p| each[p as usize]).collect()),
        };
        let mut portions: Vec<Portion<'a, T>> = Vec::with_capacity(self.laws.len());
        for (index, (law, parameters)) in self.laws.iter().zip(&values.parameters).enumerate() {
            let start = portions.last().map_or(0, |portion| portion.particles.end);
            let count = match &self.material_of {
                None => order.len(),
                Some(of) => order[start..].iter().take_while(|&&p| of[p as usize] as usize == index).count(),
            };
            let parameters = parameters.iter().map(sorted).collect();
            let volume = world.particle_volume;
            portions.push(Portion { law, particles: start..start + count, volume, parameters });
        }
        let mut simulation = Simulation::of_portions(world, self.schedule.dt(), &sorted(&values.density), portions)?;
        simulation.label(order.to_vec());
        Ok(simulation)
    }

    fn order<T: Number>(&self, positions: &[[T; 3]]) -> Vec<u32> {
        neighbours(self.world.dx, positions, |p| self.material_of.as_ref().map_or(0, |of| of[p]))
    }

    /// Checks that every particle has a material.
    fn check_materials(&self, n: usize) -> Result<()> {
        let fault = |what: &str, found: String, wanted: String| {
            Err(Error::new(ErrorKind::Input, what).at("rollout").found(found).wanted(wanted))
        };
        let laws = self.laws.len();
        match &self.material_of {
            None if laws == 1 => Ok(()),
            None => fault(
                "it is not said which particle has which material",
                format!("{laws} materials"),
                "an index per particle in material_of".into(),
            ),
            Some(of) if of.len() != n => {
                fault("the list of materials has the wrong length", format!("{} entries", of.len()), format!("{n}"))
            }
            Some(of) => match of.iter().position(|&index| index as usize >= laws) {
                None => Ok(()),
                Some(p) => fault(
                    "a particle has no material",
                    format!("index {} of particle {p}", of[p]),
                    format!("less than {laws}"),
                ),
            },
        }
    }
}

/// Densities and parameters, by material.
struct Inputs<T> {
    density: Values<T>,
    parameters: Vec<Vec<Values<T>>>,
}

/// The initial state, in grid order.
fn start<T: Number>(simulation: &Simulation<'_, T>, inputs: &[Tensor], order: &[u32]) -> Result<State<T>> {
    let (positions, velocities): (Vec<[T; 3]>, Vec<[T; 3]>) = (triples(&inputs[0]), triples(&inputs[1]));
    let x: Vec<[T; 3]> = order.iter().map(|&p| positions[p as usize]).collect();
    let v: Vec<[T; 3]> = match velocities[..] {
        [one] if inputs[1].dims().len() == 1 => vec![one; order.len()],
        _ => order.iter().map(|&p| velocities[p as usize]).collect(),
    };
    simulation.at_rest(&x, &v)
}

/// The rows of a `[n, 3]` tensor.
fn triples<T: Number>(tensor: &Tensor) -> Vec<[T; 3]> {
    tensor.slice::<T>().as_chunks().0.to_vec()
}

/// Sums over particles, in `f64`, in grid order.
fn total<T: Number>(values: &[T], width: usize) -> Vec<T> {
    (0..width).map(|k| T::from_f64(values.iter().skip(k).step_by(width).map(|&value| value.to_f64()).sum())).collect()
}

fn finite<T: Number>(name: &str, values: &[T], width: usize) -> Result<()> {
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(at) => Err(Error::new(ErrorKind::NonFinite, format!("'{name}' of the rollout is not finite"))
            .at(format!("row {}, column {}", at / width, at % width))
            .found(values[at])
            .wanted("finite numbers")),
    }
}
