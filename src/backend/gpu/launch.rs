//! Running kernels on tensors.

use std::sync::Arc;

use crate::backend::gpu::{Gpu, GpuBuffer, Kernel};
use crate::{DType, Error, ErrorKind, Result, Spec, Tensor};

/// How much there is to do for a kernel.
///
/// ```
/// use gradreel::backend::gpu::Work;
/// let each_element = Work::Invocations(1000);
/// # let _ = each_element;
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// At least this many invocations, numbered from 0.
    Invocations(usize),
    /// At least this many workgroups, numbered from 0.
    Groups(usize),
}

/// A compiled kernel.
pub(super) struct Pipeline {
    raw: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

/// Workgroups along three axes, of at most `most` each, that number at least `groups`.
fn spread(groups: usize, most: u32) -> Option<[u32; 3]> {
    let across = groups.min(most as usize).max(1);
    let rows = groups.div_ceil(across);
    let down = rows.min(most as usize).max(1);
    let deep = u32::try_from(rows.div_ceil(down)).ok().filter(|deep| *deep <= most)?;
    Some([across as u32, down as u32, deep.max(1)])
}

impl Gpu {
    /// Runs a kernel that writes one new tensor (its first buffer) from others (those after it).
    ///
    /// `parameters` are the words of its uniform struct; the padding at its end may be left out. Nothing is launched
    /// where there is no work. A dispatch of more workgroups than an axis may have is spread over three axes: kernels
    /// number their workgroups as `(id.z * num.y + id.y) * num.x + id.x` (with `workgroup_id` and `num_workgroups`) and
    /// skip numbers beyond the work.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// use gradreel::backend::gpu::{Gpu, Work};
    /// use gradreel::{DType, Device, Spec, Tensor};
    /// if let Ok(gpu) = Gpu::open() {
    ///     let x = Tensor::from_vec(vec![1.0f32, 2.0], [2]).to_device(&Device::Gpu(gpu.clone()))?;
    ///     let y = gpu.launch(&DOUBLE, &[&x], &[], Spec::new([2], DType::F32), Work::Invocations(2))?;
    ///     assert_eq!(y.to_vec()?, [2.0, 4.0]);
    /// }
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Gpu::dispatch`]; [`ErrorKind::Device`] when the result does not fit.
    pub fn launch(
        &self,
        kernel: &Kernel,
        operands: &[&Tensor],
        parameters: &[u32],
        result: Spec,
        work: Work,
    ) -> Result<Tensor> {
        let y = self.empty(result)?;
        let buffers: Vec<_> = std::iter::once(&y).chain(operands.iter().copied()).collect();
        self.dispatch(kernel, &buffers, parameters, work)?;
        Ok(y)
    }

    /// As [`Gpu::launch`], for a kernel that makes each element of its result by itself: part by part, where the result
    /// is larger than one binding. Operands with as many elements as the result are taken by the same parts; others are
    /// bound whole. `parameters` are those for the elements from a first one on, so many.
    ///
    /// # Errors
    /// As [`Gpu::launch`].
    #[track_caller]
    pub(crate) fn launch_each(
        &self,
        kernel: &Kernel,
        operands: &[&Tensor],
        parameters: impl Fn(usize, usize) -> Vec<u32>,
        result: Spec,
    ) -> Result<Tensor> {
        let y = self.empty(result)?;
        let (len, most) = (y.len(), self.part_len());
        for start in (0..len).step_by(most) {
            let count = most.min(len - start);
            if count == len {
                let buffers: Vec<_> = std::iter::once(&y).chain(operands.iter().copied()).collect();
                self.dispatch(kernel, &buffers, &parameters(0, len), Work::Invocations(len))?;
                continue;
            }
            let part = |x: &Tensor| if x.len() == len { x.gpu_part(start, [count]) } else { x.clone() };
            let parts: Vec<Tensor> = std::iter::once(part(&y)).chain(operands.iter().map(|x| part(x))).collect();
            let parts: Vec<&Tensor> = parts.iter().collect();
            self.dispatch(kernel, &parts, &parameters(start, count), Work::Invocations(count))?;
        }
        Ok(y)
    }

    /// Elements of the largest part that begins and ends where parts may, of any type.
    pub(crate) fn part_len(&self) -> usize {
        let words = usize::try_from(self.limits().binding_bytes / 4).unwrap_or(usize::MAX);
        (words - words % GpuBuffer::ALIGNMENT).max(GpuBuffer::ALIGNMENT)
    }

    /// A tensor of undefined contents, for a kernel to write all of.
    ///
    /// ```
    /// use gradreel::{DType, Spec, backend::gpu::Gpu};
    /// if let Ok(gpu) = Gpu::open() {
    ///     assert_eq!(gpu.empty(Spec::new([2], DType::F32))?.dims(), [2]);
    /// }
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when it does not fit; [`ErrorKind::Unsupported`] for a dtype the device does not hold.
    pub fn empty(&self, spec: Spec) -> Result<Tensor> {
        if spec.dtype == DType::F64 {
            return Err(Error::new(ErrorKind::Unsupported, "the GPU backend holds f32, f16 and u32 tensors")
                .found(spec.dtype)
                .fix("cast to f32"));
        }
        let bytes = (spec.shape.len() * spec.dtype.size()).next_multiple_of(4);
        Ok(Tensor::from_gpu(self.allocate(bytes)?, spec))
    }

    /// Runs a kernel on tensors given in the order of its buffers, the written one first.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// use gradreel::backend::gpu::{Gpu, Work};
    /// use gradreel::{DType, Device, Spec, Tensor};
    /// if let Ok(gpu) = Gpu::open() {
    ///     let x = Tensor::from_vec(vec![1.0f32, 2.0], [2]).to_device(&Device::Gpu(gpu.clone()))?;
    ///     let y = gpu.empty(Spec::new([2], DType::F32))?;
    ///     gpu.dispatch(&DOUBLE, &[&y, &x], &[], Work::Invocations(2))?;
    ///     assert_eq!(y.to_vec()?, [2.0, 4.0]);
    /// }
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a kernel that is not valid WGSL; [`ErrorKind::Unsupported`] when it binds more storage
    /// buffers than the device allows, or does not compute in a tensor's dtype; [`ErrorKind::Device`] when the device
    /// was lost or refuses the kernel.
    ///
    /// # Panics
    /// When the number of tensors or of parameters is not what the kernel binds, or a tensor lives elsewhere.
    #[track_caller]
    pub fn dispatch(&self, kernel: &Kernel, tensors: &[&Tensor], parameters: &[u32], work: Work) -> Result<()> {
        self.check()?;
        let module = kernel.reflect()?;
        let buffers = module.buffers();
        assert_eq!(tensors.len(), buffers.len(), "{} binds {buffers:?}", kernel.name());
        let limits = self.device().limits();
        if buffers.len() > limits.max_storage_buffers_per_shader_stage as usize {
            return Err(Error::new(
                ErrorKind::Unsupported,
                format!("{} binds too many storage buffers", kernel.name()),
            )
            .at(self.name())
            .found(buffers.len())
            .wanted(format!("at most {}", limits.max_storage_buffers_per_shader_stage))
            .fix("compose it of functions of fewer operands, or move them to the CPU with to_device(&Device::Cpu)"));
        }
        let most = self.limits().binding_bytes;
        for (tensor, binding) in tensors.iter().zip(buffers) {
            if tensor.gpu_buffer().bytes() as u64 > most {
                return Err(Error::new(
                    ErrorKind::Device,
                    format!("{} needs a tensor whole that does not fit one binding of this GPU", kernel.name()),
                )
                .at(format!("{}, {:?}", binding.name, tensor.spec()))
                .found(format!("{} bytes", tensor.gpu_buffer().bytes()))
                .wanted(format!("at most {most} bytes on {}", self.name()))
                .fix("split the tensor, or move it to the CPU with to_device(&Device::Cpu)"));
            }
            assert!(tensor.gpu_buffer().gpu().same(self), "{}: {tensor:?} is not on {self:?}", kernel.name());
            let fits = match tensor.dtype() {
                DType::F32 => true,
                DType::F16 => binding.holds_halves(),
                _ => binding.element == DType::U32,
            };
            if !fits {
                return Err(Error::new(ErrorKind::Unsupported, format!("{} computes in f32", kernel.name()))
                    .at(&binding.name)
                    .found(format!("{tensor:?}"))
                    .fix("cast it to f32"));
            }
        }
        let groups = match work {
            Work::Invocations(count) => count.div_ceil(module.invocations()),
            Work::Groups(count) => count,
        };
        if groups == 0 {
            return Ok(());
        }
        let spread = spread(groups, self.limits().groups_per_axis).ok_or_else(|| {
            Error::new(ErrorKind::Device, format!("{} has too much work for one dispatch", kernel.name()))
                .found(format!("{groups} workgroups"))
                .fix("split the tensor")
        })?;
        let pipeline = self.pipeline(kernel)?;
        let mut recorder = self.recorder();
        let uniform = module.parameters().map(|(slot, bytes)| {
            let mut words = parameters.to_vec();
            assert!(words.len() <= bytes / 4, "{}: its parameters are {bytes} bytes, not {words:?}", kernel.name());
            words.resize(bytes / 4, 0);
            (slot, recorder.parameters(self.device(), &words))
        });
        let parameters = uniform
            .iter()
            .map(|(slot, buffer)| wgpu::BindGroupEntry { binding: *slot, resource: buffer.as_entire_binding() });
        let storage = tensors.iter().zip(buffers).map(|(tensor, binding)| wgpu::BindGroupEntry {
            binding: binding.slot,
            resource: wgpu::BindingResource::Buffer(tensor.gpu_buffer().binding()),
        });
        let bindings = self.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel.name()),
            layout: &pipeline.layout,
            entries: &storage.chain(parameters).collect::<Vec<_>>(),
        });
        recorder.dispatch(self.device(), self.queue(), &pipeline.raw, &bindings, spread);
        Ok(())
    }

    /// The compiled kernel; compiled once per adapter and text.
    fn pipeline(&self, kernel: &Kernel) -> Result<Arc<Pipeline>> {
        let module = kernel.reflect()?;
        let mut known = self.pipelines();
        if let Some(pipeline) = known.get(kernel.entry()).and_then(|by_text| by_text.get(module.text())) {
            return Ok(pipeline.clone());
        }
        let scope = self.device().push_error_scope(wgpu::ErrorFilter::Validation);
        let shader = self.device().create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(kernel.name()),
            source: wgpu::ShaderSource::Wgsl(module.text().into()),
        });
        let raw = self.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(kernel.name()),
            layout: None,
            module: &shader,
            entry_point: Some(kernel.entry()),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let layout = raw.get_bind_group_layout(0);
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(Error::new(ErrorKind::Device, format!("the GPU refused the kernel {}", kernel.name()))
                .at(self.name())
                .found(error)
                .fix("update the driver, or run the op on the CPU"));
        }
        let pipeline = Arc::new(Pipeline { raw, layout });
        known.entry(kernel.entry()).or_default().insert(module.text().to_owned(), pipeline.clone());
        Ok(pipeline)
    }
}

#[cfg(test)]
mod tests {
    use super::spread;

    #[test]
    fn groups_are_spread_over_three_axes() {
        assert_eq!(spread(1, 65535), Some([1, 1, 1]));
        assert_eq!(spread(65535, 65535), Some([65535, 1, 1]));
        assert_eq!(spread(65536, 65535), Some([65535, 2, 1]));
        assert_eq!(spread(7, 3), Some([3, 3, 1]));
        assert_eq!(spread(10, 3), Some([3, 3, 2]));
        assert_eq!(spread(28, 3), None);
    }
}
