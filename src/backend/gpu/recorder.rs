//! Work that was recorded and not yet submitted.

use std::collections::HashMap;

/// Dispatches per submission: enough to hide its cost, few enough that the device starts early.
const BATCH: usize = 64;

/// Parameter blocks kept at most; a step of an iteration meets those of the step before.
const PARAMETERS: usize = 4096;

/// The open pass of one adapter. Recording needs the lock that the adapter keeps it behind, so that dispatches of
/// several threads come one after the other.
#[derive(Default)]
pub(super) struct Recorder {
    open: Option<Open>,
    parameters: HashMap<Vec<u32>, wgpu::Buffer>,
}

struct Open {
    encoder: wgpu::CommandEncoder,
    pass: wgpu::ComputePass<'static>,
    dispatches: usize,
}

impl Recorder {
    /// Records one dispatch, and submits when a batch is complete.
    pub(super) fn dispatch(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        pipeline: &wgpu::ComputePipeline,
        bindings: &wgpu::BindGroup,
        groups: [u32; 3],
    ) {
        let open = self.open.get_or_insert_with(|| {
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()).forget_lifetime();
            Open { encoder, pass, dispatches: 0 }
        });
        open.pass.set_pipeline(pipeline);
        open.pass.set_bind_group(0, bindings, &[]);
        open.pass.dispatch_workgroups(groups[0], groups[1], groups[2]);
        open.dispatches += 1;
        if open.dispatches >= BATCH {
            self.submit(queue);
        }
    }

    /// Submits what is recorded.
    pub(super) fn submit(&mut self, queue: &wgpu::Queue) {
        if let Some(Open { encoder, pass, .. }) = self.open.take() {
            drop(pass);
            queue.submit([encoder.finish()]);
        }
    }

    /// A uniform buffer with these words, the same one as long as it is remembered.
    pub(super) fn parameters(&mut self, device: &wgpu::Device, words: &[u32]) -> wgpu::Buffer {
        if let Some(known) = self.parameters.get(words) {
            return known.clone();
        }
        let buffer = wgpu::util::DeviceExt::create_buffer_init(
            device,
            &wgpu::util::BufferInitDescriptor {
                label: Some("parameters"),
                contents: bytemuck::cast_slice(words),
                usage: wgpu::BufferUsages::UNIFORM,
            },
        );
        if self.parameters.len() == PARAMETERS {
            self.parameters.clear();
        }
        self.parameters.insert(words.to_vec(), buffer.clone());
        buffer
    }
}
