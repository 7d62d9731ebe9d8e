//! Device buffers of a substep besides states.

use gradreel::backend::gpu::Gpu;
use gradreel::{DType, Device, Result, Spec, Tensor};

use super::kernels::SCAN;

/// Values of a particle's record.
const RECORD: usize = 16;

/// Scratch buffers that every substep overwrites.
#[derive(Debug)]
pub(super) struct Buffers {
    /// Cell of each particle, and its arrival number in the cell.
    pub cells: Tensor,
    /// Number of particles in each cell; zero between substeps.
    pub counts: Tensor,
    /// Number of particles before each cell, from the start of its span.
    pub starts: Tensor,
    /// Number of particles in each span, and before it.
    pub totals: Tensor,
    pub bases: Tensor,
    /// Total over all spans.
    pub total: Tensor,
    /// Particles sorted by cell, in the order of arrival.
    pub arrivals: Tensor,
    /// The index of each particle in the sorted list.
    pub slots: Tensor,
    /// Records of particles, sorted; in the backward pass also those of the adjoint gather.
    pub records: Tensor,
    /// Node values; in the backward pass also their cotangents.
    pub grid: Tensor,
    /// Number of cells in a span.
    pub span: usize,
}

impl Buffers {
    /// Buffers for this number of particles and nodes, once per direction.
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

/// Copies a list to the device.
pub(super) fn upload<T: gradreel::Element>(gpu: &Gpu, values: Vec<T>) -> Result<Tensor> {
    let len = values.len();
    Tensor::from_vec(values, [len]).to_device(&Device::Gpu(gpu.clone()))
}

/// Copies a list back from the device, after all preceding work.
pub(super) fn download<T: gradreel::Element>(tensor: &Tensor) -> Result<Vec<T>> {
    Ok(tensor.to_device(&Device::Cpu)?.slice::<T>().to_vec())
}
