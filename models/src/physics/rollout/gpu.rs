//! A rollout whose substeps run on a GPU.

use gradreel::backend::gpu::Gpu;
use gradreel::{Backward, DType, Device, Forward, Result, Spec, Tensor, Var};

use super::{Rollout, start};
use crate::physics::gpu::{GpuSimulation, Kept};
use crate::physics::state::V;

/// State kept by the forward pass for the backward pass.
#[derive(Debug)]
struct OnDevice {
    kept: Kept,
    /// The caller's index of each particle in grid order.
    order: Vec<u32>,
}

impl Rollout {
    pub(super) fn forward_on(&self, gpu: &Gpu, inputs: &[Tensor]) -> Result<Forward> {
        let inputs = here(inputs.iter())?;
        let (n, frames, substeps) = (inputs[0].dims()[0], self.schedule.frames, self.schedule.substeps);
        let world = self.world_of::<f32>(&inputs)?;
        let (order, values) = self.prepare::<f32>(&inputs, &world)?;
        let simulation = self.simulation(&world, &values, &order)?;
        let start = start::<f32>(&simulation, &inputs, &order)?;
        let simulation = GpuSimulation::new(gpu, simulation)?;
        let output = gpu.empty(Spec::new([frames, n, 3], DType::F32))?;
        let steps = if n == 0 { 0 } else { self.schedule.steps() };
        let kept = simulation.forward(&start, steps, self.remat, &mut |step, state| match step % substeps {
            0 => simulation.show(state, step / substeps, &output),
            _ => Ok(()),
        })?;
        let bytes = kept.bytes();
        Ok(Forward::with_residual(output, OnDevice { kept, order }).holding(bytes))
    }

    pub(super) fn backward_on(&self, gpu: &Gpu, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let OnDevice { kept, order } = cx.residual();
        let inputs = cx.inputs().iter().map(|var| var.value()).collect::<Result<Vec<_>>>()?;
        let inputs = here(inputs.into_iter())?;
        let world = self.world_of::<f32>(&inputs)?;
        let simulation = self.simulation(&world, &self.values::<f32>(&inputs, order.len())?, order)?;
        let zero = start::<f32>(&simulation, &inputs, order)?.zeros_like();
        let simulation = GpuSimulation::new(gpu, simulation)?.tracking(self.gravity || self.friction);
        let (cotangent, substeps) = (simulation.load(&zero)?, self.schedule.substeps);
        let gradient = cx.gradient().value()?;
        let values = simulation.backward(kept, &cotangent, &mut |step, cotangent| match step % substeps {
            0 => simulation.add(cotangent, step / substeps, gradient),
            _ => Ok(()),
        })?;
        let found = simulation.state(&cotangent)?;
        let start = [0, V].map(|component| (0..order.len()).map(|p| found.read(p, component)).collect());
        self.hand_back(cx, &inputs, order, start, values)
    }
}

/// Copies tensors to the CPU.
fn here<'a>(tensors: impl Iterator<Item = &'a Tensor>) -> Result<Vec<Tensor>> {
    tensors.map(|tensor| tensor.to_device(&Device::Cpu)).collect()
}
