//! What a substep needs on the device besides states.

use gradreel::backend::gpu::Gpu;
use gradreel::{DType, Device, Result, Spec, Tensor};

use super::kernels::SCAN;

/// Numbers of the record of a particle.
const RECORD: usize = 16;

/// Buffers that every substep uses anew.
#[derive(Debug)]
pub(super) struct Buffers {
    /// Cell and number of arrival of each particle.
    pub cells: Tensor,
    /// Particles of each cell; zero between substeps.
    pub counts: Tensor,
    /// Particles before each cell, from the start of its span.
    pub starts: Tensor,
    /// Particles of each span, and before it.
    pub totals: Tensor,
    pub bases: Tensor,
    /// The total of totals.
    pub total: Tensor,
    /// Particles by cell, in the order of arrival.
    pub arrivals: Tensor,
    /// The place of each particle in the sorted list.
    pub slots: Tensor,
    /// What particles scatter, sorted; backwards also what the adjoint of their gather scatters.
    pub records: Tensor,
    /// Nodes; backwards also their cotangents.
    pub grid: Tensor,
    /// Cells of a span.
    pub span: usize,
}

impl Buffers {
    /// Buffers for so many particles and nodes, once for each direction.
    pub fn new(gpu: &Gpu, particles: usize, capacity: usize, directions: usize) -> Result<Self> {
        let span = SCAN.reflect()?.constant("SPAN");
        let spans = capacity.div_ceil(span);
        let n = particles.max(1);
        let words = |len: usize| gpu.empty(Spec::new([len], DType::U32));
        let numbers = |len: usize| gpu.empty(Spec::new([len], DType::F32));
        Ok(Self {
            cells: words(2 * n)?,
            counts: upload(gpu, vec![0_u32; capacity])?,
            starts: words(capacity)?,
            totals: words(spans)?,
            bases: words(spans)?,
            total: words(1)?,
            arrivals: words(n)?,
            slots: words(n)?,
            records: numbers(directions * RECORD * n)?,
            grid: numbers(directions * 4 * capacity)?,
            span,
        })
    }
}

/// A list on the device.
pub(super) fn upload<T: gradreel::Element>(gpu: &Gpu, values: Vec<T>) -> Result<Tensor> {
    let len = values.len();
    Tensor::from_vec(values, [len]).to_device(&Device::Gpu(gpu.clone()))
}

/// A list back from the device, when all work before is done.
pub(super) fn download<T: gradreel::Element>(tensor: &Tensor) -> Result<Vec<T>> {
    Ok(tensor.to_device(&Device::Cpu)?.slice::<T>().to_vec())
}
