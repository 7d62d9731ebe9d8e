//! `flip`: the elements along an axis in reverse order.

use std::rc::Rc;

use crate::backend::cpu::strided::gather;
use crate::backend::gpu::{Gpu, Strides};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "flip",
    gpu: true,
    cases: || {
        let case = |axis, shape: &[usize]| Case::new(Flip { axis }, [uniform(1, shape, -1.0..1.0)]);
        vec![case(0, &[4]), case(1, &[2, 3, 4]), case(2, &[2, 3, 5]), case(0, &[1, 3])]
    },
};

#[derive(Debug)]
struct Flip {
    axis: usize,
}

impl Flip {
    /// Where the walk through `x` begins, and its axes: this one backwards.
    fn walk(&self, x: &Shape) -> (usize, Strides) {
        let strides = x.strides();
        let step = |axis: usize| if axis == self.axis { strides[axis].wrapping_neg() } else { strides[axis] };
        let axes = Strides::new((0..x.rank()).map(|axis| (x.dims()[axis], step(axis))));
        (x.dims()[self.axis].saturating_sub(1) * strides[self.axis], axes)
    }
}

impl Op for Flip {
    fn name(&self) -> &'static str {
        "flip"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        if self.axis >= x.shape.rank() {
            return Err(Error::new(ErrorKind::Shape, "flip: no such axis")
                .found(format!("axis {} of {:?}", self.axis, x))
                .wanted(format!("an axis below {}", x.shape.rank())));
        }
        Ok(x.clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let (start, axes) = self.walk(x.shape());
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(gather::<T>(x.slice(), start, &axes), x.shape()).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let (start, axes) = self.walk(x.shape());
        Ok(axes.gather(gpu, self.name(), x, start, x.spec())?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().flip(self.axis))])
    }
}

impl Var {
    /// The elements along `axis` in reverse order.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// assert_eq!(x.flip(0).value()?.slice::<f64>(), [3.0, 2.0, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn flip(&self, axis: usize) -> Self {
        Self::run(Rc::new(Flip { axis }), &[self])
    }
}
