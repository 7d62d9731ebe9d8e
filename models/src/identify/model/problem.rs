//! The forward model: from unknowns to a loss, on one tape.

use std::borrow::Cow;
use std::sync::Arc;

use gradreel::{DType, ErrorKind, Result, Tape, Tensor, Var};

use crate::field::bounding_sphere;
use crate::identify::model::depth_shear::Sight;
use crate::identify::model::flight::displacement;
use crate::identify::model::shutter::{Beside, Instants, Rows, beside};
use crate::identify::{Bound, Config, Free, RangePenalty, Substeps, Unknowns};
use crate::particles::Particles;
use crate::physics::{Contact, Law, Parameter, Remat, Scene, Schedule, Substance, World, simulate};
use crate::render::{Rays, Robust, Splat, Surface, Target, Trajectory, render};
use crate::vector::{norm, transposed};
use crate::video::{Clip, Shutter};

/// How far the step may exceed what the unknowns ask for before it is made smaller; the recommended step leaves more room
/// than this.
const SLACK: f64 = 1.45;

/// The least opacity of what is simulated: that of a voxel may become 0, and no particle's density may.
const EMPTY: f64 = 1e-6;

/// The pixels of all frames and the rays that belong to them.
pub struct Observed {
    /// The rays of all cameras.
    pub rays: Arc<Rays>,
    /// Number of rays of each camera, in their order.
    pub views: Vec<usize>,
    /// One target per frame, in the order of the rays.
    pub targets: Vec<Target>,
    /// Time between frames \[s\].
    pub frame_dt: f64,
    /// Whether each camera is one that nobody filmed with.
    pub imagined: Vec<bool>,
    /// The line of sight of a single camera, along which nobody knows how the body lies.
    pub sight: Option<Sight>,
    /// The rows of a film.
    pub(in crate::identify) rows: Option<Rows>,
}

impl Observed {
    /// All pixels of a clip.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when views count by their angles and no camera sees the object in the first frame.
    pub fn of(clip: &Clip, config: &Config, dtype: DType) -> Result<Self> {
        let loss = &config.loss;
        let views = match clip.imagined.contains(&true) {
            true => loss.view_weights(clip, bounding_sphere(clip, 0)?.centre),
            false => vec![1.0; clip.cameras.len()],
        };
        let robust = loss.robust_beyond(&clip.imagined).map(|delta| Robust::of(clip, delta, dtype)).transpose()?;
        let targets = (0..clip.frame_count()).map(|f| {
            let trajectory = || Trajectory::of(clip, f, loss.trajectory, &views, dtype);
            let trajectory = (loss.trajectory > 0.0).then(trajectory).transpose()?;
            let target = Target::of_views(clip, f, &config.weights, &views, dtype)?;
            Ok(Target { robust: robust.clone(), trajectory, ..target })
        });
        Ok(Self {
            rays: Arc::new(Rays::of_cameras(&clip.cameras)),
            views: clip.cameras.iter().map(|camera| camera.width * camera.height).collect(),
            targets: targets.collect::<Result<_>>()?,
            frame_dt: clip.frame_dt(),
            imagined: clip.imagined.clone(),
            sight: Sight::of(clip)?,
            rows: Rows::of(clip),
        })
    }
}

/// What is known: the object at rest, the world, the material's law, and what was filmed.
#[derive(Clone)]
pub struct Problem<'a> {
    /// The object in the first frame.
    pub particles: &'a Particles,
    /// What was filmed.
    pub observed: &'a Observed,
    /// Grid, gravity, ground.
    pub world: World,
    /// Height of the ground \[m\].
    pub ground: f64,
    /// The material.
    pub law: Law,
    /// How occupancy becomes opacity.
    pub surface: Surface,
    /// Density of the filled material \[kg/m³\].
    pub density: f64,
    /// Share of a cell that waves may cross in a substep.
    pub cfl: f64,
    /// Waves and particles are taken to be at least so fast \[m/s\].
    pub least_speed: f64,
    /// How the camera exposes its pictures.
    pub shutter: Shutter,
    /// What implausible parameters cost, if they do.
    pub ranges: Option<RangePenalty>,
    /// Whether the body keeps its shape and meets nothing: free flight, which needs no simulation.
    pub flying: bool,
    /// Memory for states.
    pub remat: Remat,
    /// Precision of everything on the tape.
    pub dtype: DType,
}

impl<'a> Problem<'a> {
    /// The problem of a configuration for an object whose particles are half a grid cell apart.
    pub fn new(particles: &'a Particles, observed: &'a Observed, law: Law, config: &Config, dtype: DType) -> Self {
        let world = World {
            gravity: config.world.gravity,
            colliders: vec![config.world.ground_contact.collider(config.world.ground)],
            particle_volume: particles.spacing.powi(3),
            ..World::new(2.0 * particles.spacing)
        };
        Self {
            particles,
            observed,
            world,
            ground: config.world.ground,
            surface: config.surface_of(&law).clone(),
            law: law.placed(&particles.places()),
            density: config.world.density,
            cfl: config.world.cfl,
            least_speed: config.world.least_speed,
            shutter: config.clip.film.shutter(),
            ranges: config.loss.range_penalty(&observed.imagined),
            flying: false,
            remat: Remat::Auto { bytes: config.world.memory_mib << 20 },
            dtype,
        }
    }

    /// The same with the fewest substeps that are stable, however much less they damp the motion: enough to tell good from bad.
    #[must_use]
    pub(in crate::identify) fn fewest_substeps(self) -> Self {
        Self { least_speed: 0.0, ..self }
    }

    /// The same in free flight.
    #[must_use]
    pub fn flying(&self) -> Self {
        // flight says nothing of the material
        Self { ranges: None, flying: true, ..self.clone() }
    }

    /// Whether the ground has Coulomb friction, whose coefficient is an unknown.
    pub(in crate::identify) fn has_friction(&self) -> bool {
        self.world.colliders.iter().any(|collider| matches!(collider.contact, Contact::Friction(_)))
    }

    /// A schedule for `frames` frames that is stable for these unknowns: for the sound in the material, and for the speed that
    /// the highest particle can reach before the ground stops it.
    pub fn schedule(&self, unknowns: &Unknowns, frames: usize) -> Schedule {
        let time = self.observed.frame_dt * frames.saturating_sub(1) as f64;
        let (start, gravity) = (norm(unknowns.velocity), norm(self.world.gravity));
        let highest = self.particles.positions.iter().fold(f64::NEG_INFINITY, |high, x| high.max(x[1]));
        let drop = (highest - self.ground).max(0.0);
        let speed = (start + gravity * time).min((start * start + 2.0 * gravity * drop).sqrt());
        let sound =
            self.law.wave_speed_on(&unknowns.parameters, self.density, self.world.dx).max(self.least_speed - speed);
        Schedule::stable(&self.world, frames, self.observed.frame_dt, sound, speed, self.cfl)
    }

    /// Positions of the particles at every frame, `[frames, particles, 3]` \[m\], on the tape.
    ///
    /// A particle stands for a cube that is filled to the share that its opacity says: its density and its stress are in
    /// proportion to it. A stress is in proportion when every modulus, yield stress and viscosity is; strains and angles at
    /// which a material yields stay as they are. The velocity of the rollout is that of half a substep earlier (a leapfrog start), so that free flight
    /// is exact whatever the substep: `x₀ + v t + g t²/2`. Frames of which nothing else happens are not simulated.
    ///
    /// # Errors
    /// What the rollout returns.
    pub fn motion(&self, tape: &Tape, bound: &Bound, schedule: Schedule) -> Result<Var> {
        self.motion_of(&tape.constant(self.particles.opacity(self.dtype)?), bound, schedule)
    }

    /// The same of particles of another opacity `[particles, 1]`, on whose tape it is.
    ///
    /// # Errors
    /// What the rollout returns.
    pub fn motion_of(&self, opacity: &Var, bound: &Bound, schedule: Schedule) -> Result<Var> {
        self.seen(&self.motion_in_world(opacity, bound, schedule)?, bound.depth)
    }

    /// Positions in the world as the camera that was taken to look in another direction sees them.
    fn seen(&self, motion: &Var, depth: [f64; 4]) -> Result<Var> {
        let Some(sight) = self.observed.sight.filter(|_| depth[3] != 0.0) else { return Ok(motion.clone()) };
        let (by, from) = sight.pitch(depth, self.ground).seen();
        // positions are rows
        let by = Tensor::from_vec(transposed(by).as_flattened().to_vec(), [3, 3]).cast(self.dtype)?;
        let shape: Vec<usize> = motion.dims().to_vec();
        let rows = motion.reshape([shape.iter().product::<usize>() / 3, 3]);
        let seen = &rows.matmul(&motion.tape().constant(by)) + &self.constant(motion.tape(), from)?;
        Ok(seen.reshape(shape))
    }

    fn motion_in_world(&self, opacity: &Var, bound: &Bound, schedule: Schedule) -> Result<Var> {
        let tape = opacity.tape();
        if self.flying {
            return self.flight(tape, bound, schedule);
        }
        // a voxel that a fit has emptied still has a mass
        let opacity = opacity.reshape([self.particles.len()]).clamp(EMPTY, f64::INFINITY);
        let parameters = self.law.parameters();
        let fall = self.free_fall_of(bound, schedule)?;
        let falling = match fall {
            0 => None,
            _ => Some(self.flight(tape, bound, Schedule { frames: fall + 1, ..schedule })?),
        };
        let lower = self.constant(tape, [0.0, bound.contact * self.world.dx, 0.0])?;
        let positions = match &falling {
            None => tape.constant(self.placed(bound.contact, bound.depth)?),
            Some(falling) => &falling.select(0, fall) - &lower,
        };
        // the speed of the fall, half a substep before the simulation begins
        let early = fall as f64 * schedule.frame_dt - 0.5 * schedule.dt();
        let velocity = &bound.velocity + &self.constant(tape, self.world.gravity.map(|g| early * g))?;
        let velocity = match &bound.spin {
            Some(spin) => {
                let turning = spin.reshape([1, 3]).matmul(&tape.constant(self.spin_field(bound.depth)?));
                &velocity + &turning.reshape([self.particles.len(), 3])
            }
            None => velocity,
        };
        let parameters = parameters
            .iter()
            .zip(&bound.parameters)
            .map(|(p, value)| if is_stress(p) { value * &opacity } else { value.clone() })
            .collect();
        let scene = Scene {
            positions,
            velocity,
            density: &opacity * self.density,
            gravity: None,
            friction: self.has_friction().then(|| bound.friction.clone()),
            materials: vec![Substance { law: self.law.clone(), parameters }],
            material_of: None,
        };
        let schedule = Schedule { frames: schedule.frames - fall, ..schedule };
        let motion = simulate(&self.world, &scene, schedule, self.remat)?;
        // back up by as much as the simulation has the body lower
        let motion = if bound.contact == 0.0 { motion } else { &motion + &lower };
        Ok(falling.map_or(motion.clone(), |falling| falling.slice(0, 0..fall).concat(&[&motion], 0)))
    }

    /// `c + R(t) (x₀ − c) + v t + g t²/2` at every frame; not differentiated in the spin.
    fn flight(&self, tape: &Tape, bound: &Bound, schedule: Schedule) -> Result<Var> {
        let spin = bound.fixed_spin()?;
        let frame = |(frame, turned): (usize, Vec<[f64; 3]>)| {
            let t = frame as f64 * schedule.frame_dt;
            let fallen = self.constant(tape, displacement([0.0; 3], self.world.gravity, t))?;
            let turned = Tensor::from_vec(turned.into_flattened(), [self.particles.len(), 3]).cast(self.dtype)?;
            Ok(&tape.constant(turned) + &(&bound.velocity * t) + fallen)
        };
        let frames =
            self.turned(spin, bound.depth, schedule).into_iter().enumerate().map(frame).collect::<Result<Vec<_>>>()?;
        let others: Vec<&Var> = frames.iter().skip(1).collect();
        Ok(frames[0].stack(&others, 0))
    }

    /// The body with these depth modes.
    pub(in crate::identify) fn sheared(&self, depth: [f64; 4]) -> Cow<'_, Particles> {
        match &self.observed.sight {
            Some(sight) => sight.sheared(self.particles, depth, self.ground),
            None => Cow::Borrowed(self.particles),
        }
    }

    /// The particles as the simulation has them: a ground that is felt `contact` grid spacings higher than it is, is felt
    /// there by a body that is as much lower.
    ///
    /// # Errors
    /// Never for `f32` and `f64`.
    pub(crate) fn placed(&self, contact: f64, depth: [f64; 4]) -> Result<Tensor> {
        let (shift, body) = (contact * self.world.dx, self.sheared(depth));
        let lower = body.positions.iter().flat_map(|x| [x[0], x[1] - shift, x[2]]);
        Tensor::from_vec(lower.collect(), [self.particles.len(), 3]).cast(self.dtype)
    }

    /// Positions of the particles at every filmed frame, `[frames, particles, 3]` \[m\], without a tape to differentiate; with
    /// smaller steps where the simulation breaks down otherwise ([`Problem::with_step`]).
    ///
    /// # Errors
    /// What the rollout returns.
    pub fn positions(&self, unknowns: &Unknowns) -> Result<Tensor> {
        self.positions_of_first(unknowns, self.observed.targets.len())
    }

    /// The same of the first frames.
    pub(in crate::identify) fn positions_of_first(&self, unknowns: &Unknowns, frames: usize) -> Result<Tensor> {
        self.with_step(unknowns, frames, &mut Substeps::default(), &mut |schedule| {
            self.positions_at(unknowns, schedule)
        })
    }

    /// The same with this schedule.
    pub(in crate::identify) fn positions_at(&self, unknowns: &Unknowns, schedule: Schedule) -> Result<Tensor> {
        let tape = Tape::new();
        let frozen = unknowns.constants(&tape, self.dtype)?;
        Ok(self.motion(&tape, &frozen, schedule)?.value()?.clone())
    }

    /// A vector, `[3]`.
    fn constant(&self, tape: &Tape, vector: [f64; 3]) -> Result<Var> {
        Ok(tape.constant(Tensor::from_vec(vector.to_vec(), [3]).cast(self.dtype)?))
    }

    /// The loss of the first `frames` frames, averaged over them, on the tape.
    ///
    /// # Errors
    /// What rollout and renderer return.
    pub fn loss(&self, motion: &Var, frames: usize) -> Result<Var> {
        let tape = motion.tape();
        let opacity = tape.constant(self.particles.opacity(self.dtype)?);
        let colour = tape.constant(self.particles.colour(self.dtype)?);
        self.loss_of(motion, [&opacity, &colour], &|_| self.observed, &vec![1.0; frames])
    }

    /// The same of particles of another opacity and colour, and of what `observed` says was seen of a frame; each frame counts as much
    /// as its weight says.
    ///
    /// Each frame is differentiated at once, on a tape of its own, so that the pictures of one frame are in memory at a time. What is
    /// returned has the value of the loss and its gradient, and no second derivatives.
    pub(in crate::identify) fn loss_of<'o>(
        &self,
        motion: &Var,
        [opacity, colour]: [&Var; 2],
        observed: &dyn Fn(usize) -> &'o Observed,
        weights: &[f64],
    ) -> Result<Var> {
        let tape = motion.tape();
        let (mut value, mut slopes) = (0.0, Vec::new());
        for (frame, weight) in weights.iter().enumerate() {
            let places = self.around(frame, motion.dims()[0], &|frame| motion.select(0, frame));
            let inputs: Vec<&Var> = [opacity, colour].into_iter().chain(&places).collect();
            let seen = observed(frame);
            let own = Tape::new();
            let here = |input: &&Var| {
                let value = input.value()?.clone();
                Ok(if input.is_differentiable() { own.leaf(value) } else { own.constant(value) })
            };
            let own: Vec<Var> = inputs.iter().map(here).collect::<Result<_>>()?;
            let pixels = self.picture(&own[2..], [&own[0], &own[1]], &seen.rays)?;
            let loss = &seen.targets[frame].loss(&pixels) * (*weight / weights.len() as f64);
            value += loss.item()?;
            if !loss.is_differentiable() {
                continue;
            }
            let gradients = loss.backward()?;
            for (input, own) in inputs.iter().zip(&own).filter(|(_, own)| own.is_differentiable()) {
                // nothing arrives where nothing of the frame depends on it
                if let Ok(rate) = gradients.wrt(own) {
                    slopes.push((&(*input - &input.detach()) * &tape.constant(rate.clone())).sum_all());
                }
            }
        }
        let value = tape.constant(Tensor::scalar(value, self.dtype));
        Ok(slopes.iter().fold(value, |sum, slope| &sum + slope))
    }

    /// Positions that make a picture: those of its frame, and before and after it those of the frames beside it if the shutter is open.
    pub(in crate::identify) fn around(&self, frame: usize, frames: usize, at: &dyn Fn(usize) -> Var) -> Vec<Var> {
        let now = at(frame);
        if !self.shutter.is_open() {
            return vec![now];
        }
        let [before, after] = beside(frame, frames).map(|beside| match beside {
            Beside::At(frame) => at(frame),
            Beside::Beyond(frame) => &now * 2.0 - &at(frame),
        });
        vec![before, now, after]
    }

    /// The shutter at work.
    pub(in crate::identify) fn instants(&self) -> Instants<'_> {
        Instants::of(self.shutter, self.observed.rows.as_ref(), self.observed.frame_dt)
    }

    /// A picture as the shutter takes it, of the positions that [`Problem::around`] names.
    pub(in crate::identify) fn picture(
        &self,
        places: &[Var],
        [opacity, colour]: [&Var; 2],
        rays: &Arc<Rays>,
    ) -> Result<Var> {
        let [before, now, after] = places else { return self.render(&places[0], opacity, colour, rays) };
        let instants = self.instants().on_tape([before, now, after])?;
        let pictures = instants.iter().map(|positions| self.render(positions, opacity, colour, rays));
        let pictures = pictures.collect::<Result<Vec<_>>>()?;
        let sum = pictures[1..].iter().fold(pictures[0].clone(), |sum, picture| &sum + picture);
        Ok(sum * (1.0 / pictures.len() as f64))
    }

    /// The pixels of particles at these positions along some rays.
    ///
    /// # Errors
    /// What the renderer returns.
    pub fn render(&self, positions: &Var, opacity: &Var, colour: &Var, rays: &Arc<Rays>) -> Result<Var> {
        let splat = Splat::of(self.particles, &self.surface);
        render(positions, opacity, colour, rays, &splat, &self.surface)
    }

    /// Loss and gradient in the coordinates of the free unknowns, on the tape; with what implausible parameters cost.
    ///
    /// `substeps` as in [`Problem::with_step`].
    ///
    /// # Errors
    /// As [`Problem::with_step`]; what the renderer returns.
    pub fn evaluate(
        &self,
        unknowns: &Unknowns,
        free: Free,
        frames: usize,
        substeps: &mut Substeps,
    ) -> Result<(f64, Vec<f64>)> {
        self.with_step(unknowns, frames, substeps, &mut |schedule| {
            let tape = Tape::new();
            let bound = unknowns.bind(&tape, &self.law, free, self.dtype)?;
            let mut loss = self.loss(&self.motion(&tape, &bound, schedule)?, frames)?;
            if let Some(penalty) = self.ranges.as_ref().and_then(|r| r.on_tape(&self.law, &bound.parameters)) {
                loss = &loss + &penalty;
            }
            Ok((loss.item()?, bound.gradient(&loss)?))
        })
    }

    /// Does something with a schedule that is stable for these unknowns.
    ///
    /// `substeps` is raised when the unknowns need more, never lowered. When the rollout breaks down, it is retried with up to eight times
    /// as many, which is noted there.
    ///
    /// # Errors
    /// [`ErrorKind::Physics`] when it still breaks down then; what `attempt` returns.
    pub fn with_step<R>(
        &self,
        unknowns: &Unknowns,
        frames: usize,
        substeps: &mut Substeps,
        attempt: &mut dyn FnMut(Schedule) -> Result<R>,
    ) -> Result<R> {
        let mut schedule = self.schedule(unknowns, frames);
        if schedule.substeps as f64 > SLACK * substeps.count as f64 {
            substeps.count = schedule.substeps;
        }
        schedule.substeps = substeps.count;
        for retry in 0.. {
            match attempt(schedule) {
                Err(error) if error.kind() == ErrorKind::Physics && retry < 3 => {
                    schedule.substeps *= 2;
                    substeps.count = schedule.substeps;
                    let note = format!("retrying with {} substeps a frame: {error}", schedule.substeps);
                    substeps.notes.push(note);
                }
                done => return done,
            }
        }
        unreachable!("the loop returns")
    }
}

/// Whether a parameter scales the stress: a modulus, a yield stress, a viscosity.
pub(crate) fn is_stress(parameter: &Parameter) -> bool {
    parameter.unit == "Pa" || parameter.unit == "Pa s"
}
