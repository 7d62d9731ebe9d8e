//! `permute`: reorders axes; copies.

use std::rc::Rc;

use crate::backend::cpu::strided::gather;
use crate::backend::gpu::{Gpu, Strides};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "permute",
    gpu: true,
    cases: || {
        let case = |order: &[usize]| Case::new(Permute { order: order.to_vec() }, [uniform(1, [2, 3, 4], -1.0..1.0)]);
        vec![case(&[2, 0, 1]), case(&[1, 0, 2]), case(&[0, 1, 2]), case(&[2, 1, 0])]
    },
};

#[derive(Debug)]
struct Permute {
    order: Vec<usize>,
}

impl Permute {
    fn shape(&self, x: &Shape) -> Shape {
        Shape::from(self.order.iter().map(|&axis| x.dims()[axis]).collect::<Vec<_>>())
    }

    fn axes(&self, x: &Shape) -> Strides {
        let strides = x.strides();
        Strides::new(self.order.iter().map(|&axis| (x.dims()[axis], strides[axis])))
    }
}

impl Op for Permute {
    fn name(&self) -> &'static str {
        "permute"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        let mut sorted = self.order.clone();
        sorted.sort_unstable();
        if !sorted.iter().copied().eq(0..x.shape.rank()) {
            return Err(Error::new(ErrorKind::Shape, "permute: the order must name every axis once")
                .found(format!("{:?} for {:?}", self.order, x)));
        }
        Ok(Spec::new(self.shape(&x.shape), x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let axes = self.axes(x.shape());
        for_real!(x.dtype(), T => {
            Ok(Tensor::from_vec(gather::<T>(x.slice(), 0, &axes), self.shape(x.shape())).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        Ok(self.axes(x.shape()).gather(gpu, self.name(), x, 0, Spec::new(self.shape(x.shape()), x.dtype()))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let mut back = vec![0; self.order.len()];
        self.order.iter().enumerate().for_each(|(to, &from)| back[from] = to);
        Ok(vec![Some(cx.gradient().permute(&back))])
    }
}

impl Var {
    /// Reorders the axes: axis `i` of the result is axis `order[i]` of `self`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [2, 2]));
    /// assert_eq!(x.permute(&[1, 0]).value()?.slice::<f64>(), [1.0, 3.0, 2.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When `order` does not name every axis once.
    #[track_caller]
    #[must_use]
    pub fn permute(&self, order: &[usize]) -> Self {
        Self::run(Rc::new(Permute { order: order.to_vec() }), &[self])
    }
}
