//! One substep on a device, forward and backward, and runs of many substeps on plain states.

use gradreel::backend::gpu::{Gpu, Kernel, Work};
use gradreel::{DType, Error, ErrorKind, Result, Spec, Tensor};

use super::buffers::{Buffers, download, upload};
use super::kernels::{ADD, ADVANCE, ARRIVE, COUNT, GRID, GRID_VJP, LIFT, PULL, SCAN, SETTLE, SHOW, SURVEY};
use super::portion::OnDevice;
use super::trajectory::Course;
use super::words::Words;
use crate::physics::remat::Remat;
use crate::physics::state::{COMPONENTS, HISTORY, State};
use crate::physics::substep::Simulation;
use crate::physics::values::{ValueGradients, Values};

/// Values in the cotangent of a record: affine matrix, mass.
const ON_RECORD: usize = 10;

/// A [`Simulation`] that runs on a GPU, in `f32`.
///
/// ```
/// use gradreel::Device;
/// use gradreel_models::physics::{GpuSimulation, Simulation, Values, World, materials};
///
/// let (world, law) = (World::new(0.02), materials::find("neo_hookean").unwrap());
/// let parameters = vec![Values::Same(1e5), Values::Same(0.3)];
/// let fall = Simulation::new(&world, &law, 1e-4, 1, &Values::Same(1000.0), parameters)?;
/// let start = fall.at_rest(&[[0.1, 0.2, 0.3]], &[[0.0; 3]])?;
/// // without a driver there is nothing to show
/// if let Ok(Device::Gpu(gpu)) = Device::gpu() {
///     let end = GpuSimulation::new(&gpu, fall)?.run(&start, 100)?;
///     assert!((end.velocities()[0][1] + 9.8 * 1e-2).abs() < 1e-6);
/// }
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug)]
pub struct GpuSimulation<'a> {
    pub(super) gpu: Gpu,
    pub(super) plan: Simulation<'a, f32>,
    portions: Vec<OnDevice<'a>>,
    labels: Tensor,
    /// Whether the cotangents of gravity and friction are computed.
    tracked: bool,
}

/// The cotangents that backward substeps accumulate.
#[derive(Debug)]
pub(super) struct Adjoint {
    /// Of the records, for one substep.
    on_record: Tensor,
    /// Of mass and parameters, by portion.
    on_values: Vec<Tensor>,
    /// Of gravity and friction, by workgroup of nodes.
    on_world: Tensor,
}

impl<'a> GpuSimulation<'a> {
    /// Moves a simulation to a device.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Unsupported`] for a world with FLIP, [`ErrorKind::Device`] when the values do not fit.
    pub fn new(gpu: &Gpu, simulation: Simulation<'a, f32>) -> Result<Self> {
        let plan = simulation;
        if plan.world.flip != 0.0 {
            return Err(Error::new(ErrorKind::Unsupported, "the blend with FLIP does not run on a GPU")
                .found(format!("World::flip of {}", plan.world.flip))
                .wanted("0 (APIC)")
                .fix("set World::flip to 0, or move the inputs to the CPU with to_device(&Device::Cpu)"));
        }
        let portions = plan.portions.iter().map(|portion| OnDevice::new(gpu, &plan, portion));
        let portions = portions.collect::<Result<Vec<_>>>()?;
        let mut labels = plan.labels.clone();
        if labels.is_empty() {
            labels.extend((0..plan.particles.max(1)).map(|p| p as u32));
        }
        Ok(Self { gpu: gpu.clone(), portions, labels: upload(gpu, labels)?, plan, tracked: true })
    }

    /// Selects whether the cotangents of gravity and friction are computed.
    #[must_use]
    pub(crate) fn tracking(self, tracked: bool) -> Self {
        Self { tracked, ..self }
    }

    /// The state after this number of substeps from `start`.
    ///
    /// # Errors
    ///
    /// As [`Simulation::substep`], and [`ErrorKind::Device`] when the device fails or runs out of memory.
    ///
    /// # Panics
    ///
    /// If the state has another number of particles.
    #[track_caller]
    pub fn run(&self, start: &State<f32>, steps: usize) -> Result<State<f32>> {
        self.plan.check(&[start]);
        let kept = self.forward(start, steps, None, &mut |_, _| Ok(()))?;
        self.state(&kept.last)
    }

    /// Propagates the cotangent of the state after this number of substeps from `start` back to `start`; returns the
    /// cotangents of density, parameters, gravity and friction as well.
    ///
    /// # Errors
    ///
    /// As [`GpuSimulation::run`]; [`ErrorKind::Unsupported`] for more than 32 obstacles.
    ///
    /// # Panics
    ///
    /// If a state has another number of particles.
    #[track_caller]
    pub fn run_vjp(
        &self,
        start: &State<f32>,
        steps: usize,
        remat: Remat,
        cotangent: &State<f32>,
    ) -> Result<(State<f32>, ValueGradients<f32>)> {
        self.plan.check(&[start, cotangent]);
        let kept = self.forward(start, steps, Some(remat), &mut |_, _| Ok(()))?;
        let cotangent = self.load(cotangent)?;
        let values = self.backward(&kept, &cotangent, &mut |_, _| Ok(()))?;
        Ok((self.state(&cotangent)?, values))
    }

    /// Copies a state to the device.
    pub(crate) fn load(&self, state: &State<f32>) -> Result<Tensor> {
        let mut all: Vec<f32> = (0..COMPONENTS + self.plan.history).flat_map(|k| state.component(k)).collect();
        all.resize(all.len().max(1), 0.0);
        upload(&self.gpu, all)
    }

    /// Copies a state, or a cotangent, from the device.
    pub(crate) fn state(&self, tensor: &Tensor) -> Result<State<f32>> {
        let mut all: Vec<f32> = download(tensor)?;
        // unused history variables of a material are never written
        for portion in &self.portions {
            for k in HISTORY + portion.law.history().len()..COMPONENTS + self.plan.history {
                all[k * self.plan.particles + portion.first..][..portion.count].fill(0.0);
            }
        }
        Ok(State::of_components(self.plan.particles, self.plan.history, &all))
    }

    /// A state, or a cotangent, with undefined contents.
    pub(super) fn blank(&self) -> Result<Tensor> {
        let len = self.plan.particles.max(1) * (COMPONENTS + self.plan.history);
        self.gpu.empty(Spec::new([len], DType::F32))
    }

    /// Zero accumulators for backward substeps.
    pub(super) fn adjoint(&self, capacity: usize) -> Result<Adjoint> {
        let module = GRID_VJP.reflect()?;
        let (obstacles, most) = (self.plan.world.colliders.len(), module.constant("MOST_OBSTACLES"));
        if self.tracked && obstacles > most {
            return Err(Error::new(ErrorKind::Unsupported, "too many obstacles for gradients of friction on a GPU")
                .found(obstacles)
                .wanted(format!("at most {most}"))
                .fix("use fewer obstacles, or move the inputs to the CPU with to_device(&Device::Cpu)"));
        }
        let groups = if self.tracked { capacity.div_ceil(module.invocations()) } else { 1 };
        Ok(Adjoint {
            on_record: self.gpu.empty(Spec::new([ON_RECORD * self.plan.particles.max(1)], DType::F32))?,
            on_values: self.portions.iter().map(|portion| portion.cotangents(&self.gpu)).collect::<Result<_>>()?,
            on_world: upload(&self.gpu, vec![0.0_f32; groups * (3 + obstacles)])?,
        })
    }

    fn each(&self, kernel: &Kernel, tensors: &[&Tensor], words: &Words) -> Result<()> {
        self.gpu.dispatch(kernel, tensors, words.as_slice(), Work::Invocations(self.plan.particles))
    }

    /// Marks the box of the first substep.
    pub(super) fn survey(&self, course: &Course, start: &Tensor) -> Result<()> {
        self.each(&SURVEY, &[&course.marks, start], &course.words(self, 0))
    }

    /// Copies the positions of a state to a frame of `[frames, n, 3]`.
    pub(crate) fn show(&self, state: &Tensor, frame: usize, frames: &Tensor) -> Result<()> {
        self.each(&SHOW, &[frames, &self.labels, state], &self.plain_words().frame(frame))
    }

    /// Adds the cotangents of a frame of `[frames, n, 3]` to that of a state.
    pub(crate) fn add(&self, cotangent: &Tensor, frame: usize, frames: &Tensor) -> Result<()> {
        self.each(&ADD, &[cotangent, &self.labels, frames], &self.plain_words().frame(frame))
    }

    fn plain_words(&self) -> Words {
        self.words(0)
    }

    pub(super) fn words(&self, capacity: usize) -> Words {
        Words::of(self.plan.world, self.plan.dt, self.plan.particles, capacity, self.tracked)
    }

    /// Sorts the particles and runs their materials: fills the records, and `F` and history of `next`.
    fn scatter(&self, course: &Course, buffers: &Buffers, step: usize, now: &Tensor, next: &Tensor) -> Result<Words> {
        let words = course.words(self, step);
        let Buffers { cells, counts, starts, totals, bases, total, arrivals, slots, records, .. } = buffers;
        self.each(&COUNT, &[cells, counts, &course.marks, now], &words)?;
        let scan = |tensors: &[&Tensor], len: usize| {
            self.gpu.dispatch(&SCAN, tensors, words.scan(len).as_slice(), Work::Groups(len.div_ceil(buffers.span)))
        };
        scan(&[starts, totals, counts], course.capacity)?;
        scan(&[bases, total, totals], course.capacity.div_ceil(buffers.span))?;
        self.each(&ARRIVE, &[arrivals, cells, starts, bases], &words)?;
        self.each(&SETTLE, &[slots, cells, starts, bases, arrivals], &words)?;
        for portion in &self.portions {
            let tensors = [next, records, &course.marks, now, slots, &portion.values];
            let words = words.portion(portion);
            let work = Work::Invocations(portion.count);
            self.gpu.dispatch(&portion.law.kernels().forward, &tensors, words.as_slice(), work)?;
        }
        Ok(words)
    }

    /// Advances `now` by one substep into `next`.
    pub(super) fn substep(
        &self,
        course: &Course,
        buffers: &Buffers,
        step: usize,
        now: &Tensor,
        next: &Tensor,
    ) -> Result<()> {
        let words = self.scatter(course, buffers, step, now, next)?;
        let Buffers { counts, starts, bases, records, grid, .. } = buffers;
        let tensors = [grid, counts, &course.marks, starts, bases, records, &course.obstacles];
        self.gpu.dispatch(&GRID, &tensors, words.as_slice(), Work::Invocations(course.capacity))?;
        self.each(&ADVANCE, &[next, &course.marks, now, grid], &words)
    }

    /// Propagates the cotangent of the state after a substep to that of `now`.
    #[allow(clippy::too_many_arguments)] // what a substep is made of
    pub(super) fn substep_vjp(
        &self,
        course: &Course,
        buffers: &Buffers,
        adjoint: &Adjoint,
        step: usize,
        now: &Tensor,
        scratch: &Tensor,
        cotangent: &Tensor,
    ) -> Result<()> {
        let words = self.scatter(course, buffers, step, now, scratch)?;
        let Buffers { counts, starts, bases, slots, records, grid, .. } = buffers;
        let Adjoint { on_record, on_values, on_world } = adjoint;
        self.each(&LIFT, &[records, cotangent, slots], &words)?;
        let tensors = [grid, counts, on_world, &course.marks, starts, bases, records, &course.obstacles];
        self.gpu.dispatch(&GRID_VJP, &tensors, words.as_slice(), Work::Invocations(course.capacity))?;
        self.each(&PULL, &[cotangent, on_record, &course.marks, now, slots, records, grid], &words)?;
        for (portion, on_values) in self.portions.iter().zip(on_values) {
            let tensors = [cotangent, on_values, now, &portion.values, on_record];
            let words = words.portion(portion);
            let work = Work::Invocations(portion.count);
            self.gpu.dispatch(&portion.law.kernels().reverse, &tensors, words.as_slice(), work)?;
        }
        Ok(())
    }

    /// Sums over particles and nodes, in `f64` and in a fixed order.
    pub(super) fn value_gradients(&self, adjoint: &Adjoint) -> Result<ValueGradients<f32>> {
        let Simulation { mass, portions, particles, world, .. } = &self.plan;
        let blank = |values: &Values<f32>| match values {
            Values::Same(_) => vec![0.0; 1],
            Values::Each(_) => vec![0.0; *particles],
        };
        let mut on_mass = blank(mass);
        let mut parameters: Vec<Vec<f64>> = portions.iter().flat_map(|p| &p.parameters).map(blank).collect();
        let mut rest = &mut parameters[..];
        for ((portion, given), on_values) in self.portions.iter().zip(portions).zip(&adjoint.on_values) {
            let (own, others) = rest.split_at_mut(given.parameters.len());
            rest = others;
            let mut found: Vec<&mut Vec<f64>> = std::iter::once(&mut on_mass).chain(own).collect();
            let values: Vec<&Values<f32>> = std::iter::once(mass).chain(&given.parameters).collect();
            portion.collect(on_values, &mut found, &values)?;
        }
        let on_world: Vec<f32> = download(&adjoint.on_world)?;
        let width = 3 + world.colliders.len();
        let sum = |k: usize| on_world.iter().skip(k).step_by(width).map(|&g| f64::from(g)).sum::<f64>();
        let narrow = |values: Vec<f64>| values.into_iter().map(|g| g as f32).collect::<Vec<_>>();
        Ok(ValueGradients {
            density: narrow(self.plan.on_density(on_mass)),
            parameters: parameters.into_iter().map(narrow).collect(),
            gravity: std::array::from_fn(sum),
            friction: (3..width).map(sum).collect(),
        })
    }
}
