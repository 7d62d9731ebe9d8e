//! `reshape`: the same numbers under another shape. Free on every device.

use std::rc::Rc;

use crate::backend::gpu::Gpu;
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::{Error, ErrorKind, Result, Shape, Spec};

pub(super) const ENTRY: Entry = Entry {
    name: "reshape",
    gpu: true,
    cases: || vec![Case::new(Reshape { shape: [3, 4].into() }, [uniform(1, [2, 6], -1.0..1.0)])],
};

#[derive(Debug)]
struct Reshape {
    shape: Shape,
}

impl Op for Reshape {
    fn name(&self) -> &'static str {
        "reshape"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x] = Spec::exactly(self.name(), inputs)?;
        if x.shape.len() != self.shape.len() {
            return Err(Error::new(ErrorKind::Shape, "reshape: the number of elements differs")
                .found(format!("{:?}", x))
                .wanted(&self.shape));
        }
        Ok(Spec::new(&self.shape, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        Ok(inputs[0].reshape(&self.shape).into())
    }

    fn forward_gpu(&self, _gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        self.forward_cpu(inputs)
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().reshape(cx.input(0).shape()))])
    }
}

impl Var {
    /// The same numbers under another shape.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [4]));
    /// assert_eq!(x.reshape([2, 2]).dims(), [2, 2]);
    /// ```
    ///
    /// # Panics
    /// When the number of elements differs.
    #[track_caller]
    #[must_use]
    pub fn reshape(&self, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        if *self.shape() == shape { self.clone() } else { Self::run(Rc::new(Reshape { shape }), &[self]) }
    }
}
