//! `slice`: a range along one axis.

use std::ops::Range;
use std::rc::Rc;

use crate::backend::cpu::strided::gather;
use crate::backend::gpu::{Gpu, Strides};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "slice",
    gpu: true,
    cases: || {
        let case = |axis, range| Case::new(Slice { axis, range }, [uniform(1, [2, 5, 3], -1.0..1.0)]);
        vec![case(1, 1..4), case(0, 1..2), case(2, 0..3), case(1, 2..2)]
    },
};

#[derive(Debug)]
struct Slice {
    axis: usize,
    range: Range<usize>,
}

impl Slice {
    /// Where it begins, and the axes of the result as they lie in `x`.
    fn walk(&self, x: &Shape) -> (usize, Strides) {
        let strides = x.strides();
        let size = |axis| if axis == self.axis { self.range.len() } else { x.dims()[axis] };
        let axes = Strides::new((0..x.rank()).map(|axis| (size(axis), strides[axis])));
        (self.range.start * strides[self.axis], axes)
    }
}

impl Op for Slice {
    fn name(&self) -> &'static str {
        "slice"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        let mut dims = x.shape.dims().to_vec();
        let fits =
            dims.get(self.axis).is_some_and(|&size| self.range.start <= self.range.end && self.range.end <= size);
        if !fits {
            return Err(Error::new(ErrorKind::Shape, "slice: the range is outside the axis")
                .found(format!("{:?} along axis {} of {:?}", self.range, self.axis, x)));
        }
        dims[self.axis] = self.range.len();
        Ok(Spec::new(dims, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let spec = self.infer(&[inputs[0].spec()])?;
        let (start, axes) = self.walk(inputs[0].shape());
        for_real!(spec.dtype, T => {
            Ok(Tensor::from_vec(gather::<T>(inputs[0].slice(), start, &axes), spec.shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let result = self.infer(&[x.spec()])?;
        let (start, axes) = self.walk(x.shape());
        Ok(axes.gather(gpu, self.name(), x, start, result)?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let after = cx.input(0).dims()[self.axis] - self.range.end;
        Ok(vec![Some(cx.gradient().pad(self.axis, self.range.start, after))])
    }
}

impl Var {
    /// The elements of `range` along `axis`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [4]));
    /// assert_eq!(x.slice(0, 1..3).value()?.slice::<f64>(), [2.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist or the range is outside of it.
    #[track_caller]
    #[must_use]
    pub fn slice(&self, axis: usize, range: Range<usize>) -> Self {
        Self::run(Rc::new(Slice { axis, range }), &[self])
    }

    /// The elements at `index` along `axis`, which is dropped.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [2, 2]));
    /// assert_eq!(x.select(0, 1).value()?.slice::<f64>(), [3.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis or the index does not exist.
    #[track_caller]
    #[must_use]
    pub fn select(&self, axis: usize, index: usize) -> Self {
        let part = self.slice(axis, index..index + 1);
        let mut dims = part.dims().to_vec();
        dims.remove(axis);
        part.reshape(dims)
    }
}
