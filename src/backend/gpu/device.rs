//! Opening an adapter, and what every kernel needs of it.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use wgpu::util::DeviceExt;

use crate::backend::gpu::launch::Pipeline;
use crate::backend::gpu::pool::{self, Pool};
use crate::backend::gpu::recorder::Recorder;
use crate::backend::gpu::{GpuBuffer, GpuLimits};
use crate::{Error, ErrorKind, Result};

/// Compiled kernels by entry point and text.
type Pipelines = HashMap<&'static str, HashMap<String, Arc<Pipeline>>>;

/// A handle to one adapter: its device, its queue, its compiled kernels. Cloning it copies a pointer; threads may share
/// it.
///
/// ```
/// use gradreel::{DType, Device, Tensor};
/// if let Ok(Device::Gpu(gpu)) = Device::gpu() {
///     println!("{}", gpu.name());
/// }
/// ```
#[derive(Clone)]
pub struct Gpu(Arc<Inner>);

struct Inner {
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    limits: GpuLimits,
    fault: Arc<OnceLock<Fault>>,
    recorder: Mutex<Recorder>,
    pipelines: Mutex<Pipelines>,
    pool: Mutex<Pool>,
}

/// Why an adapter computes no more.
enum Fault {
    /// The driver gave the device up.
    Lost(String),
    /// The device refused recorded work; results after it are undefined.
    Refused(String),
}

impl Gpu {
    /// Opens the adapter that wgpu prefers; `WGPU_ADAPTER_NAME` is honoured.
    ///
    /// ```
    /// use gradreel::backend::gpu::Gpu;
    /// match Gpu::open() {
    ///     Ok(gpu) => println!("{}", gpu.name()),
    ///     Err(error) => println!("{error}"), // no adapter
    /// }
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when there is no adapter or it refuses WebGPU's guaranteed limits.
    pub fn open() -> Result<Self> {
        Self::open_within(GpuLimits::NONE)
    }

    /// As [`Gpu::open`], but takes no more at once than these limits: to leave memory to others, or to meet on a small
    /// tensor what otherwise happens to a large one.
    ///
    /// ```
    /// use gradreel::backend::gpu::{Gpu, GpuLimits};
    /// let small = GpuLimits { binding_bytes: 1 << 20, ..GpuLimits::NONE };
    /// if let Ok(gpu) = Gpu::open_within(small) {
    ///     assert!(gpu.limits().binding_bytes <= 1 << 20);
    /// }
    /// ```
    ///
    /// # Errors
    /// As [`Gpu::open`].
    pub fn open_within(limits: GpuLimits) -> Result<Self> {
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
        let offered = adapter.limits();
        let required_limits = wgpu::Limits {
            max_buffer_size: offered.max_buffer_size,
            max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
            max_compute_workgroups_per_dimension: offered.max_compute_workgroups_per_dimension,
            ..wgpu::Limits::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("gradreel"),
            required_limits,
            ..Default::default()
        }))
        .map_err(|e| {
            Error::new(ErrorKind::Device, "the GPU refused to open").at(&info.name).found(e).fix("update its driver")
        })?;
        let fault = Arc::new(OnceLock::new());
        let note = fault.clone();
        device.set_device_lost_callback(move |_, reason| {
            note.get_or_init(|| Fault::Lost(reason));
        });
        let note = fault.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            note.get_or_init(|| Fault::Refused(error.to_string()));
        }));
        let name = format!("{}, {:?}", info.name, info.backend);
        let limits = limits.within(&device.limits());
        let (recorder, pipelines, pool) = Default::default();
        Ok(Self(Arc::new(Inner { device, queue, name, limits, fault, recorder, pipelines, pool })))
    }

    /// The adapter's name and the API it is reached through.
    ///
    /// ```
    /// if let Ok(gpu) = gradreel::backend::gpu::Gpu::open() {
    ///     println!("{}", gpu.name());
    /// }
    /// ```
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// How much it takes at once: what the device granted, within what it was opened with.
    ///
    /// ```
    /// if let Ok(gpu) = gradreel::backend::gpu::Gpu::open() {
    ///     println!("{:?}", gpu.limits());
    /// }
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn limits(&self) -> GpuLimits {
        self.0.limits
    }

    /// Whether two handles belong to the same opened device.
    ///
    /// ```
    /// if let Ok(gpu) = gradreel::backend::gpu::Gpu::open() {
    ///     assert!(gpu.same(&gpu.clone()));
    /// }
    /// ```
    pub fn same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    pub(crate) fn device(&self) -> &wgpu::Device {
        &self.0.device
    }

    pub(crate) fn queue(&self) -> &wgpu::Queue {
        &self.0.queue
    }

    pub(super) fn recorder(&self) -> MutexGuard<'_, Recorder> {
        self.0.recorder.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn pipelines(&self) -> MutexGuard<'_, Pipelines> {
        self.0.pipelines.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn pool(&self) -> MutexGuard<'_, Pool> {
        self.0.pool.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Fails once the driver has given the device up, or the device has refused work.
    pub(crate) fn check(&self) -> Result<()> {
        let (what, found) = match self.0.fault.get() {
            None => return Ok(()),
            Some(Fault::Lost(reason)) => ("the GPU was lost", reason),
            Some(Fault::Refused(reason)) => ("the GPU refused work", reason),
        };
        Err(Error::new(ErrorKind::Device, what)
            .at(self.name())
            .found(found)
            .fix("open it again with Device::gpu; results computed on it are gone"))
    }

    /// Submits the work recorded so far without waiting for it.
    pub(super) fn submit(&self) {
        self.recorder().submit(self.queue());
    }

    /// Copies bytes into a new buffer.
    pub(crate) fn upload(&self, bytes: &[u8]) -> Result<GpuBuffer> {
        self.check_size(bytes.len())?;
        let contents = if bytes.is_empty() { &[0; 4] } else { bytes };
        let words = bytes.len().next_multiple_of(4);
        let raw = self.created(|| {
            let usage = GpuBuffer::USAGE;
            self.device().create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
        })?;
        Ok(GpuBuffer::new(self.clone(), raw, words, false))
    }

    /// A buffer of `bytes` bytes of undefined contents, from the pool if it has one.
    ///
    /// One from the pool may still be read or written by recorded work; work recorded later waits for that. The CPU
    /// must not write into it.
    pub(crate) fn allocate(&self, bytes: usize) -> Result<GpuBuffer> {
        self.check_size(bytes)?;
        let class = pool::class(bytes);
        let size = if class <= self.limits().buffer_bytes { class } else { bytes as u64 };
        let pooled = self.pool().take(size);
        let raw = match pooled {
            Some(raw) => raw,
            None => self.created(|| {
                let usage = GpuBuffer::USAGE;
                self.device().create_buffer(&wgpu::BufferDescriptor {
                    label: None,
                    size,
                    usage,
                    mapped_at_creation: false,
                })
            })?,
        };
        Ok(GpuBuffer::new(self.clone(), raw, bytes, true))
    }

    /// Keeps the buffer of a result that nobody uses any more.
    pub(super) fn recycle(&self, raw: wgpu::Buffer) {
        self.pool().give(raw);
    }

    /// Fails when the device has no memory left for what `create` makes.
    fn created(&self, create: impl FnOnce() -> wgpu::Buffer) -> Result<wgpu::Buffer> {
        let scope = self.device().push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let raw = create();
        match pollster::block_on(scope.pop()) {
            None => Ok(raw),
            Some(error) => Err(Error::new(ErrorKind::Device, "the GPU has no memory left")
                .at(self.name())
                .found(format!("{error} for {} bytes", raw.size()))
                .fix("use fewer or smaller tensors, or remat")),
        }
    }

    fn check_size(&self, bytes: usize) -> Result<()> {
        self.check()?;
        let most = self.limits().buffer_bytes;
        if bytes as u64 <= most {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Device, "the tensor does not fit one buffer of this GPU")
            .at(self.name())
            .found(format!("{bytes} bytes"))
            .wanted(format!("at most {most} bytes"))
            .fix("split the tensor, or run it on the CPU"))
    }
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let GpuLimits { buffer_bytes, binding_bytes, groups_per_axis } = self.limits();
        write!(
            f,
            "Gpu({}; at most {buffer_bytes} bytes a buffer, {binding_bytes} a binding, {groups_per_axis} groups an axis)",
            self.name()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::Gpu;
    use crate::{Device, ErrorKind, Tape, Tensor};

    #[test]
    fn a_lost_device_is_an_error() {
        let gpu = match Gpu::open() {
            Ok(gpu) => gpu,
            Err(error) if std::env::var("CI").is_ok_and(|ci| ci == "true") => {
                panic!("this test must run here: {error}")
            }
            Err(error) => return eprintln!("skipped, because there is no GPU: {error}"),
        };
        let x = Tensor::from_vec(vec![1.0f32, 2.0], [2]).to_device(&Device::Gpu(gpu.clone())).unwrap();
        let tape = Tape::new();
        let x = tape.constant(x);
        let y = x.square();
        gpu.device().destroy();
        let _ = gpu.device().poll(wgpu::PollType::wait_indefinitely());
        for error in
            [y.sum_all().item().unwrap_err(), x.tensor().to_vec().unwrap_err(), gpu.upload(&[0; 4]).unwrap_err()]
        {
            assert_eq!(error.kind(), ErrorKind::Device, "{error}");
        }
        let z = x.exp();
        assert_eq!(z.value().unwrap_err().kind(), ErrorKind::Device);
    }
}
