//! Numbers in `f16` on a GPU: storage of two to a word, cast before and after computing.

use crate::backend::gpu::{Gpu, Kernel, words};
use crate::{DType, Result, Spec, Tensor};

/// From `f16` to `f32`; exact.
pub(crate) static WIDEN: Kernel =
    Kernel::new("cast", "widen", include_str!("../../../kernels/cast.wgsl"), &["wide", "narrow_f16"]);

/// From `f32` to the nearest `f16`.
pub(crate) static NARROW: Kernel =
    Kernel::new("cast", "narrow", include_str!("../../../kernels/cast.wgsl"), &["result_f16", "x"]);

impl Gpu {
    /// An `f16` tensor as `f32`.
    pub(crate) fn widen(&self, x: &Tensor) -> Result<Tensor> {
        self.launch_each(&WIDEN, &[x], |_, len| words([len]).to_vec(), Spec::new(x.shape(), DType::F32))
    }

    /// An `f32` tensor as `f16`.
    pub(crate) fn narrow(&self, x: &Tensor) -> Result<Tensor> {
        self.launch_each(&NARROW, &[x], |_, len| words([len]).to_vec(), Spec::new(x.shape(), DType::F16))
    }
}
