//! `to_dtype`: the same numbers in another dtype.
//!
//! `f16` is for storage: weights in half the memory, cast to `f32` before an op. Their gradients are `f32`: most of them
//! would be too small for `f16`, whose smallest number is 6e-8.

use std::rc::Rc;

use crate::backend::gpu::Gpu;
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::{DType, Error, ErrorKind, Result, Spec};

pub(super) const ENTRY: Entry = Entry {
    name: "cast",
    // there is no f64 on a GPU, and f16 is not within the tolerance of the shared tests; tests/cast.rs compares
    gpu: false,
    cases: || vec![Case::new(Cast { dtype: DType::F64 }, [uniform(1, [2, 6], -1.0..1.0)])],
};

#[derive(Debug)]
struct Cast {
    dtype: DType,
}

impl Op for Cast {
    fn name(&self) -> &'static str {
        "cast"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x] = Spec::exactly(self.name(), inputs)?;
        if x.dtype == DType::U32 || self.dtype == DType::U32 {
            return Err(Error::new(ErrorKind::Shape, "cast: only floats have derivatives")
                .found(format!("{:?} to {}", x, self.dtype))
                .fix("cast the tensor itself with Tensor::cast, and make it a constant"));
        }
        Ok(Spec::new(&x.shape, self.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        Ok(inputs[0].cast(self.dtype)?.into())
    }

    fn forward_gpu(&self, _gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        self.forward_cpu(inputs)
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().to_dtype(cx.input(0).dtype().of_cotangent()))])
    }
}

impl Var {
    /// The same numbers in another float type, each the nearest there is.
    ///
    /// With weights stored in `f16`, cast them where they are used; the gradient arrives at the `f16` leaf in `f32`:
    ///
    /// ```
    /// use gradreel::{DType, Tape, Tensor};
    ///
    /// let stored = Tensor::from_vec(vec![0.5f32, 2.0], [2, 1]).cast(DType::F16)?;
    /// let tape = Tape::new();
    /// let (x, weight) = (tape.constant(Tensor::from_vec(vec![3.0f32, 1e-9], [1, 2])), tape.leaf(stored));
    /// let y = x.matmul(&weight.to_dtype(DType::F32));
    /// let gradients = y.sum_all().into_gradients()?;
    /// assert_eq!(gradients.wrt(&weight)?.slice::<f32>(), &[3.0, 1e-9]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// From or to `u32`, which has no derivative: use [`Tensor::cast`](crate::Tensor::cast).
    #[track_caller]
    #[must_use]
    pub fn to_dtype(&self, dtype: DType) -> Self {
        if self.dtype() == dtype { self.clone() } else { Self::run(Rc::new(Cast { dtype }), &[self]) }
    }
}
