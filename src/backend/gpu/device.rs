//! Opening an adapter, and what every kernel needs of it.

use std::fmt;
use std::sync::{Arc, OnceLock};

use wgpu::util::DeviceExt;

use crate::backend::gpu::GpuBuffer;
use crate::{Error, ErrorKind, Result};

/// A handle to one adapter: its device, its queue, its name. Cloning it copies a pointer.
#[derive(Clone)]
pub struct Gpu(Arc<Inner>);

struct Inner {
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    lost: Arc<OnceLock<String>>,
}

impl Gpu {
    /// Opens the adapter that wgpu prefers; `WGPU_ADAPTER_NAME` is honoured.
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when there is no adapter or it refuses WebGPU's guaranteed limits.
    pub fn open() -> Result<Self> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        }))
        .map_err(|e| {
            Error::new(ErrorKind::Device, "no GPU adapter")
                .found(e)
                .wanted("a Vulkan, Metal or Direct3D 12 driver")
                .fix("install a driver; on Debian `apt-get install mesa-vulkan-drivers` brings a software one")
        })?;
        let info = adapter.get_info();
        let limits = wgpu::Limits {
            max_buffer_size: adapter.limits().max_buffer_size,
            max_storage_buffer_binding_size: adapter.limits().max_storage_buffer_binding_size,
            ..wgpu::Limits::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("gradreel"),
            required_limits: limits,
            ..Default::default()
        }))
        .map_err(|e| {
            Error::new(ErrorKind::Device, "the GPU refused to open").at(&info.name).found(e).fix("update its driver")
        })?;
        let lost = Arc::new(OnceLock::new());
        let note = lost.clone();
        device.set_device_lost_callback(move |_, reason| {
            note.get_or_init(|| reason);
        });
        let name = format!("{}, {:?}", info.name, info.backend);
        Ok(Self(Arc::new(Inner { device, queue, name, lost })))
    }

    /// The adapter's name and the API it is reached through.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Whether two handles belong to the same opened device.
    pub fn same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    pub(crate) fn device(&self) -> &wgpu::Device {
        &self.0.device
    }

    pub(crate) fn queue(&self) -> &wgpu::Queue {
        &self.0.queue
    }

    /// Fails once the driver has given the device up.
    pub(crate) fn check(&self) -> Result<()> {
        match self.0.lost.get() {
            None => Ok(()),
            Some(reason) => Err(Error::new(ErrorKind::Device, "the GPU was lost")
                .at(self.name())
                .found(reason)
                .fix("open it again with Device::gpu; results computed on it are gone")),
        }
    }

    /// Copies bytes into a new buffer.
    pub(crate) fn upload(&self, bytes: &[u8]) -> Result<GpuBuffer> {
        self.check_size(bytes.len())?;
        let padded;
        let contents = if bytes.is_empty() {
            padded = [0u8; 4];
            &padded[..]
        } else {
            bytes
        };
        let raw = self.device().create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents,
            usage: GpuBuffer::USAGE,
        });
        Ok(GpuBuffer::new(self.clone(), raw, bytes.len()))
    }

    /// A new buffer of `bytes` bytes, zeroed.
    pub(crate) fn allocate(&self, bytes: usize) -> Result<GpuBuffer> {
        self.check_size(bytes)?;
        let raw = self.device().create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes.max(4) as u64,
            usage: GpuBuffer::USAGE,
            mapped_at_creation: false,
        });
        Ok(GpuBuffer::new(self.clone(), raw, bytes))
    }

    fn check_size(&self, bytes: usize) -> Result<()> {
        self.check()?;
        let most = self.device().limits().max_storage_buffer_binding_size;
        if bytes as u64 <= most {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Device, "the tensor does not fit one binding of this GPU")
            .at(self.name())
            .found(format!("{bytes} bytes"))
            .wanted(format!("at most {most} bytes"))
            .fix("split the tensor, or run it on the CPU"))
    }
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Gpu({})", self.name())
    }
}
