//! Where a tensor lives.

use std::fmt;

use crate::Result;
use crate::backend::gpu::Gpu;

/// The CPU, or one adapter reached through wgpu (Vulkan, Metal or Direct3D 12).
///
/// ```
/// # use gradreel::Device;
/// // the GPU where there is one
/// let device = Device::gpu().unwrap_or(Device::Cpu);
/// println!("{device}");
/// ```
#[derive(Clone)]
pub enum Device {
    /// The reference backend: `f32` and `f64`, all cores.
    Cpu,
    /// A WGSL backend: `f32`.
    Gpu(Gpu),
}

impl Device {
    /// The first GPU of this machine.
    ///
    /// ```
    /// use gradreel::{Device, ErrorKind, Tape, Tensor};
    ///
    /// match Device::gpu() {
    ///     Ok(gpu) => {
    ///         let tape = Tape::new();
    ///         let x = tape.leaf(Tensor::from_vec(vec![1.0f32, 2.0, 3.0], [3]).to_device(&gpu)?);
    ///         let gradients = x.square().sum_all().backward()?;
    ///         assert_eq!(gradients.wrt(&x)?.to_vec()?, [2.0, 4.0, 6.0]);
    ///     }
    ///     // without a driver: says what to install
    ///     Err(error) => assert_eq!(error.kind(), ErrorKind::Device),
    /// }
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::ErrorKind::Device`] when there is no driver or no adapter, with what to install.
    pub fn gpu() -> Result<Self> {
        Gpu::open().map(Self::Gpu)
    }
}

impl PartialEq for Device {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Cpu, Self::Cpu) => true,
            (Self::Gpu(a), Self::Gpu(b)) => a.same(b),
            _ => false,
        }
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Gpu(gpu) => write!(f, "gpu ({})", gpu.name()),
        }
    }
}

impl fmt::Debug for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}
