//! Running kernels on tensors.

use std::sync::Arc;

use crate::backend::gpu::{Gpu, Kernel};
use crate::{DType, Error, ErrorKind, Result, Spec, Tensor};

/// How much there is to do for a kernel.
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

/// Workgroups along two axes, of at most `most` each, that number at least `groups`.
fn spread(groups: usize, most: u32) -> Option<[u32; 2]> {
    let across = groups.min(most as usize).max(1);
    let down = u32::try_from(groups.div_ceil(across)).ok().filter(|down| *down <= most)?;
    Some([across as u32, down])
}

impl Gpu {
    /// Runs a kernel that writes one new tensor (its first buffer) from others (those after it).
    ///
    /// `parameters` are the words of its uniform struct; the padding at its end may be left out. Nothing is launched
    /// where there is no work. A dispatch of more workgroups than an axis may have is spread over two axes: kernels
    /// number their workgroups as `workgroup_id.y * num_workgroups.x + workgroup_id.x` and skip numbers beyond the
    /// work.
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

    /// A tensor of undefined contents, for a kernel to write all of.
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
        for (tensor, binding) in tensors.iter().zip(buffers) {
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
        let spread = spread(groups, limits.max_compute_workgroups_per_dimension).ok_or_else(|| {
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
    fn groups_are_spread_over_two_axes() {
        assert_eq!(spread(1, 65535), Some([1, 1]));
        assert_eq!(spread(65535, 65535), Some([65535, 1]));
        assert_eq!(spread(65536, 65535), Some([65535, 2]));
        assert_eq!(spread(7, 3), Some([3, 3]));
        assert_eq!(spread(10, 3), None);
    }
}
