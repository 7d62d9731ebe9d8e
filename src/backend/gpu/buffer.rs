//! A storage buffer on a GPU.

use std::sync::mpsc;

use crate::backend::gpu::Gpu;
use crate::{Error, ErrorKind, Result};

/// Bytes on a GPU, usable as a storage buffer of any kernel.
#[derive(Debug)]
pub struct GpuBuffer {
    gpu: Gpu,
    raw: wgpu::Buffer,
    bytes: usize,
}

impl GpuBuffer {
    /// What tensors are used for: bound to kernels, filled, copied, read back.
    pub(super) const USAGE: wgpu::BufferUsages =
        wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_SRC).union(wgpu::BufferUsages::COPY_DST);

    pub(super) fn new(gpu: Gpu, raw: wgpu::Buffer, bytes: usize) -> Self {
        Self { gpu, raw, bytes }
    }

    /// The GPU it lives on.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The wgpu buffer, for kernels of your own.
    pub fn raw(&self) -> &wgpu::Buffer {
        &self.raw
    }

    /// Waits for the work that writes this buffer and copies it back.
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when the device was lost or the buffer cannot be mapped.
    pub fn read<T: bytemuck::Pod>(&self) -> Result<Vec<T>> {
        self.gpu.check()?;
        if self.bytes == 0 {
            return Ok(Vec::new());
        }
        let device = self.gpu.device();
        let staging = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read-back"),
            size: self.raw.size(),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&self.raw, 0, &staging, 0, self.raw.size());
        self.gpu.queue().submit([encoder.finish()]);
        let (send, receive) = mpsc::channel();
        staging.slice(..).map_async(wgpu::MapMode::Read, move |outcome| {
            let _ = send.send(outcome);
        });
        let failed = |found: String| {
            Error::new(ErrorKind::Device, "a result could not be read back from the GPU")
                .at(self.gpu.name())
                .found(found)
        };
        device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| failed(e.to_string()))?;
        receive.recv().map_err(|e| failed(e.to_string()))?.map_err(|e| failed(e.to_string()))?;
        let mapped = staging.slice(..).get_mapped_range().map_err(|e| failed(e.to_string()))?;
        Ok(bytemuck::pod_collect_to_vec(&mapped[..self.bytes]))
    }
}
