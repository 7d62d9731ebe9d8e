//! A storage buffer on a GPU.

use std::num::NonZeroU64;
use std::sync::{Arc, OnceLock, mpsc};

use crate::backend::gpu::Gpu;
use crate::{Error, ErrorKind, Result};

/// Bytes on a GPU, usable as a storage buffer of any kernel.
#[derive(Debug)]
pub struct GpuBuffer {
    gpu: Gpu,
    raw: wgpu::Buffer,
    offset: usize,
    bytes: usize,
    /// For a part: the buffer whose bytes these are, so that it does not go back to the pool before.
    _whole: Option<Arc<GpuBuffer>>,
    /// Whether it goes back to the pool. Uploaded ones do not: the CPU writes them, and few results have their size.
    pooled: bool,
    indices: OnceLock<Vec<u32>>,
}

impl GpuBuffer {
    /// What tensors are used for: bound to kernels, filled, copied, read back.
    pub(super) const USAGE: wgpu::BufferUsages =
        wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_SRC).union(wgpu::BufferUsages::COPY_DST);

    pub(super) fn new(gpu: Gpu, raw: wgpu::Buffer, bytes: usize, pooled: bool) -> Self {
        Self { gpu, raw, offset: 0, bytes, _whole: None, pooled, indices: OnceLock::new() }
    }

    /// Some of the bytes of a buffer; `offset` is a multiple of [`GpuBuffer::ALIGNMENT`].
    pub(crate) fn part(whole: &Arc<Self>, offset: usize, bytes: usize) -> Self {
        assert!(offset.is_multiple_of(Self::ALIGNMENT) && offset + bytes <= whole.bytes, "{offset} + {bytes}");
        Self {
            gpu: whole.gpu.clone(),
            raw: whole.raw.clone(),
            offset: whole.offset + offset,
            bytes,
            _whole: Some(whole.clone()),
            pooled: false,
            indices: OnceLock::new(),
        }
    }

    /// Parts begin at multiples of so many bytes on every device.
    pub(crate) const ALIGNMENT: usize = 256;

    /// Number of bytes.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// The GPU it lives on.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The part of the wgpu buffer that holds the bytes.
    pub(super) fn binding(&self) -> wgpu::BufferBinding<'_> {
        wgpu::BufferBinding {
            buffer: &self.raw,
            offset: self.offset as u64,
            size: NonZeroU64::new(self.bytes.max(4) as u64),
        }
    }

    /// The same numbers as a list on the CPU: indices have to be checked against what they point into. Read back at the
    /// first call, and remembered.
    pub(crate) fn indices(&self) -> Result<&[u32]> {
        if let Some(known) = self.indices.get() {
            return Ok(known);
        }
        let read = self.read()?;
        Ok(self.indices.get_or_init(|| read))
    }

    /// Says which indices were uploaded, so that nobody has to read them back.
    pub(crate) fn remember(self, indices: &[u32]) -> Self {
        self.indices.get_or_init(|| indices.to_vec());
        self
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
            size: self.bytes as u64,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.gpu.submit();
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&self.raw, self.offset as u64, &staging, 0, self.bytes as u64);
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
        self.gpu.check()?;
        let mapped = staging.slice(..).get_mapped_range().map_err(|e| failed(e.to_string()))?;
        Ok(bytemuck::pod_collect_to_vec(&mapped[..self.bytes]))
    }
}

impl Drop for GpuBuffer {
    fn drop(&mut self) {
        if self.pooled {
            self.gpu.recycle(self.raw.clone());
        }
    }
}
