//! How much a GPU takes at once.

/// Limits of an opened GPU. Where a tensor is larger than one binding, pointwise ops, copies, reductions and extrema run
/// part by part; other ops refuse it with an error.
///
/// ```
/// use gradreel::backend::gpu::GpuLimits;
/// let limits = GpuLimits { binding_bytes: 128 << 20, ..GpuLimits::NONE };
/// # let _ = limits;
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GpuLimits {
    /// Bytes of the largest tensor.
    pub buffer_bytes: u64,
    /// Bytes of a tensor that a kernel can bind at once.
    pub binding_bytes: u64,
    /// Workgroups along one axis of a dispatch; larger dispatches use more axes.
    pub groups_per_axis: u32,
}

impl GpuLimits {
    /// No limits but those of the device.
    ///
    /// ```
    /// use gradreel::backend::gpu::GpuLimits;
    /// let small = GpuLimits { buffer_bytes: 1 << 20, ..GpuLimits::NONE };
    /// assert!(small.buffer_bytes < small.binding_bytes);
    /// ```
    pub const NONE: Self = Self { buffer_bytes: u64::MAX, binding_bytes: u64::MAX, groups_per_axis: u32::MAX };

    /// What a device grants, within these limits.
    pub(super) fn within(self, granted: &wgpu::Limits) -> Self {
        // elements are numbered by u32
        let numbered = 4 * u64::from(u32::MAX);
        Self {
            buffer_bytes: self.buffer_bytes.min(granted.max_buffer_size).min(numbered),
            binding_bytes: self.binding_bytes.min(granted.max_storage_buffer_binding_size),
            groups_per_axis: self.groups_per_axis.min(granted.max_compute_workgroups_per_dimension),
        }
    }
}
