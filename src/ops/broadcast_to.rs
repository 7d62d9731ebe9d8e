//! `broadcast_to`: stretches axes of size 1, and adds axes in front.

use std::rc::Rc;

use crate::backend::cpu::strided::gather;
use crate::backend::gpu::{Gpu, Strides};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "broadcast_to",
    gpu: true,
    cases: || {
        vec![
            Case::new(BroadcastTo { shape: [4, 2, 3].into() }, [uniform(1, [2, 1], -1.0..1.0)]),
            Case::new(BroadcastTo { shape: [2, 3].into() }, [uniform(1, [], -1.0..1.0)]),
        ]
    },
};

#[derive(Debug)]
struct BroadcastTo {
    shape: Shape,
}

/// For each axis of a result, the distance between neighbours in what stretches to it: 0 along a stretched axis.
pub(super) fn steps(x: &Shape, result: &Shape) -> Vec<usize> {
    let (pad, strides) = (result.rank() - x.rank(), x.strides());
    let step = |axis: usize| axis.checked_sub(pad).filter(|&a| x.dims()[a] > 1).map_or(0, |a| strides[a]);
    (0..result.rank()).map(step).collect()
}

impl BroadcastTo {
    fn axes(&self, x: &Shape) -> Strides {
        Strides::new(self.shape.dims().iter().copied().zip(steps(x, &self.shape)))
    }
}

impl Op for BroadcastTo {
    fn name(&self) -> &'static str {
        "broadcast_to"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        if x.shape.broadcast(&self.shape)? != self.shape {
            return Err(Error::new(ErrorKind::Shape, "broadcast_to: the operand does not stretch to this shape")
                .found(format!("{:?}", x))
                .wanted(&self.shape));
        }
        Ok(Spec::new(&self.shape, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let axes = self.axes(x.shape());
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(gather::<T>(x.slice(), 0, &axes), &self.shape).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        Ok(self.axes(x.shape()).gather(gpu, self.name(), x, 0, Spec::new(&self.shape, x.dtype()))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().sum_to(cx.input(0).shape()))])
    }
}

impl Var {
    /// Stretches axes of size 1 to this shape, adding axes in front where needed.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2, 1]));
    /// assert_eq!(x.broadcast_to([2, 2]).value()?.slice::<f64>(), [1.0, 1.0, 2.0, 2.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shape does not stretch so.
    #[track_caller]
    #[must_use]
    pub fn broadcast_to(&self, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        if *self.shape() == shape { self.clone() } else { Self::run(Rc::new(BroadcastTo { shape }), &[self]) }
    }
}
