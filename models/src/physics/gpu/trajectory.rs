//! Many substeps on a device: grid capacity, kept states, cotangents back to the start, and failures.

use gradreel::{Error, ErrorKind, Result, Tensor};

use super::buffers::{Buffers, download, upload};
use super::kernels::SCAN;
use super::marks::{Marks, Outcome};
use super::obstacles::Table;
use super::simulation::GpuSimulation;
use super::words::Words;
use crate::physics::failure::{Moment, failure};
use crate::physics::node_grid::NodeGrid;
use crate::physics::remat::Remat;
use crate::physics::state::State;
use crate::physics::values::ValueGradients;

/// Initial margin of the grid around the particles, in cells.
const MARGIN: usize = 4;

/// The constants of a run.
#[derive(Debug)]
pub(crate) struct Course {
    steps: usize,
    /// Grid capacity in nodes.
    pub(super) capacity: usize,
    pub(super) marks: Tensor,
    pub(super) obstacles: Tensor,
    table: Table,
}

/// State kept by the forward pass for the backward pass, all of it on the device.
#[derive(Debug)]
pub(crate) struct Kept {
    course: Course,
    segment: usize,
    snapshots: Vec<Tensor>,
    /// The final state.
    pub(super) last: Tensor,
}

impl Kept {
    /// Size of the states \[bytes\].
    pub fn bytes(&self) -> usize {
        self.snapshots.iter().map(Tensor::bytes).sum::<usize>() + self.last.bytes()
    }
}

impl Course {
    pub(super) fn words(&self, simulation: &GpuSimulation<'_>, step: usize) -> Words {
        simulation.words(self.capacity).at(step, self.table.first(step))
    }
}

/// Called with the number of substeps so far, and the state or cotangent after them.
pub(crate) type Visit<'v> = &'v mut dyn FnMut(usize, &Tensor) -> Result<()>;

impl GpuSimulation<'_> {
    /// Simulates from `start`. Without `remat` only the final state is kept.
    pub(crate) fn forward(
        &self,
        start: &State<f32>,
        steps: usize,
        remat: Option<Remat>,
        visit: Visit<'_>,
    ) -> Result<Kept> {
        let most = self.most_nodes(remat.is_some())?;
        let mut capacity = self.first_capacity(start)?.min(most);
        loop {
            let kept = self.attempt(start, steps, remat, capacity, visit)?;
            match Marks(download(&kept.course.marks)?).outcome() {
                Outcome::Finished => return Ok(kept),
                // Too many nodes, or coordinates beyond single precision.
                Outcome::TooLarge { step, nodes } if nodes > most as f64 || nodes <= capacity as f64 => {
                    return Err(self.too_large(start, step, capacity, nodes, most));
                }
                // Retry with at least twice the capacity.
                Outcome::TooLarge { nodes, .. } => capacity = (2 * nodes as usize).max(2 * capacity).min(most),
                Outcome::Broken { step, particle, culprit } => {
                    return Err(self.broken(start, step, capacity, particle, culprit));
                }
            }
        }
    }

    /// Propagates a cotangent of the final state back to the start, in place; `visit` may add to it on the way.
    pub(crate) fn backward(&self, kept: &Kept, cotangent: &Tensor, visit: Visit<'_>) -> Result<ValueGradients<f32>> {
        let Kept { course, segment, snapshots, .. } = kept;
        let adjoint = self.adjoint(course.capacity)?;
        let buffers = Buffers::new(&self.gpu, self.plan.particles, course.capacity, 2)?;
        let scratch = self.blank()?;
        let between = (*segment).min(course.steps).saturating_sub(1);
        let again = (0..between).map(|_| self.blank()).collect::<Result<Vec<Tensor>>>()?;
        for (index, snapshot) in snapshots.iter().enumerate().rev() {
            let first = index * segment;
            let last = (first + segment).min(course.steps);
            let state = |step: usize| if step == first { snapshot } else { &again[step - first - 1] };
            for step in first..last - 1 {
                self.substep(course, &buffers, step, state(step), state(step + 1))?;
            }
            for step in (first..last).rev() {
                visit(step + 1, cotangent)?;
                self.substep_vjp(course, &buffers, &adjoint, step, state(step), &scratch, cotangent)?;
            }
        }
        visit(0, cotangent)?;
        self.value_gradients(&adjoint)
    }

    /// Records all substeps, in a grid of this capacity.
    fn attempt(
        &self,
        start: &State<f32>,
        steps: usize,
        remat: Option<Remat>,
        capacity: usize,
        visit: Visit<'_>,
    ) -> Result<Kept> {
        let course = self.course(steps, capacity)?;
        let buffers = Buffers::new(&self.gpu, self.plan.particles, capacity, 1)?;
        let segment = remat.map_or(steps, |remat| remat.segment(steps, start.bytes())).max(1);
        let mut snapshots = Vec::new();
        let mut now = self.load(start)?;
        let mut next = self.blank()?;
        self.survey(&course, &now)?;
        visit(0, &now)?;
        for step in 0..steps {
            self.substep(&course, &buffers, step, &now, &next)?;
            if remat.is_some() && step % segment == 0 {
                snapshots.push(std::mem::replace(&mut now, self.blank()?));
            }
            std::mem::swap(&mut now, &mut next);
            visit(step + 1, &now)?;
        }
        Ok(Kept { course, segment, snapshots, last: now })
    }

    fn course(&self, steps: usize, capacity: usize) -> Result<Course> {
        let table = Table::of(self.plan.world, self.plan.dt, steps);
        let obstacles = upload(&self.gpu, table.rows.clone())?;
        Ok(Course { steps, capacity, marks: upload(&self.gpu, Marks::blank(steps).0)?, obstacles, table })
    }

    /// The largest number of nodes that the world, the device and the sort allow.
    fn most_nodes(&self, backwards: bool) -> Result<usize> {
        let span = SCAN.reflect()?.constant("SPAN");
        let bytes = usize::try_from(self.gpu.limits().binding_bytes).unwrap_or(usize::MAX);
        let directions = if backwards { 2 } else { 1 };
        Ok((span * span).min(bytes / (16 * directions)).min(self.plan.world.node_limit.max(1)))
    }

    /// The initial grid capacity: the initial box with a margin.
    fn first_capacity(&self, start: &State<f32>) -> Result<usize> {
        if start.is_empty() {
            return Ok(1);
        }
        let node_grid = NodeGrid::covering(start.extent, self.plan.world.dx, self.plan.world.node_limit)?;
        Ok(node_grid.shape.iter().map(|nodes| nodes + 2 * MARGIN).product())
    }

    /// The states before and after a substep, resimulated in a grid of this capacity, in which no earlier substep
    /// fails.
    fn replay(&self, start: &State<f32>, step: usize, capacity: usize) -> Result<[State<f32>; 2]> {
        let mut before = None;
        let kept = self.attempt(start, step + 1, None, capacity, &mut |at, state| {
            if at == step {
                before = Some(self.state(state)?);
            }
            Ok(())
        })?;
        let last = self.state(&kept.last)?;
        Ok([before.unwrap_or_else(|| last.clone()), last])
    }

    /// The error of a grid without sufficient capacity.
    fn too_large(&self, start: &State<f32>, step: usize, capacity: usize, nodes: f64, most: usize) -> Error {
        let limit = self.plan.world.node_limit;
        let world = self
            .replay(start, step, capacity)
            .and_then(|[now, _]| NodeGrid::covering(now.extent, self.plan.world.dx, limit).map(|_| ()));
        world.err().unwrap_or_else(|| {
            Error::new(ErrorKind::Device, "the grid around the particles does not fit this GPU")
                .at(format!("{}, substep {step}", self.gpu.name()))
                .found(format!("a box of {nodes} nodes"))
                .wanted(format!("at most {most}"))
                .fix("remove stray particles, use a coarser grid, or run it on the CPU")
        })
    }

    /// The error of a particle that broke a limit; resimulates up to the failing substep.
    fn broken(
        &self,
        start: &State<f32>,
        step: usize,
        capacity: usize,
        particle: usize,
        culprit: Option<usize>,
    ) -> Error {
        match self.replay(start, step, capacity) {
            Err(error) => error,
            Ok([now, next]) => {
                let moment = Moment { substep: step, dt: self.plan.dt, labels: &self.plan.labels };
                failure(self.plan.world, moment, particle, &now, &next, || culprit)
            }
        }
    }
}
