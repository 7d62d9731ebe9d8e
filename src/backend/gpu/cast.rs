//! Numbers in `f16` on a GPU: storage of two to a word, cast before and after computing.

use crate::backend::gpu::{Gpu, Kernel, Work, words};
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
        self.launch(&WIDEN, &[x], &words([x.len()]), Spec::new(x.shape(), DType::F32), Work::Invocations(x.len()))
    }

    /// An `f32` tensor as `f16`.
    pub(crate) fn narrow(&self, x: &Tensor) -> Result<Tensor> {
        let pairs = Work::Invocations(x.len().div_ceil(2));
        self.launch(&NARROW, &[x], &words([x.len()]), Spec::new(x.shape(), DType::F16), pairs)
    }
}
