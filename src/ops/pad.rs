//! `pad`: zeros before and after along one axis.

use std::rc::Rc;

use crate::backend::cpu::rows::{Part, joined};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Element, Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "pad",
    gpu: true,
    cases: || {
        let case = |axis, before, after| Case::new(Pad { axis, before, after }, [uniform(1, [2, 3, 2], -1.0..1.0)]);
        vec![case(1, 1, 2), case(0, 0, 3), case(2, 2, 0), case(1, 0, 0)]
    },
};

pub(super) static KERNEL: Kernel = Kernel::new("pad", "main", include_str!("../../kernels/pad.wgsl"), &["y", "x"]);

#[derive(Debug)]
struct Pad {
    axis: usize,
    before: usize,
    after: usize,
}

impl Pad {
    /// Elements of `x` for each index of the axes before this one, and of one index of this one.
    fn rows(&self, x: &Tensor) -> (usize, usize) {
        let inner: usize = x.dims()[self.axis + 1..].iter().product();
        (x.dims()[self.axis] * inner, inner)
    }

    fn run<T: Element>(&self, x: &Tensor) -> Vec<T> {
        let (row, inner) = self.rows(x);
        let zeros = |count: usize| Part { values: None, len: count * inner };
        let outer: usize = x.dims()[..self.axis].iter().product();
        joined(outer, &[zeros(self.before), Part { values: Some(x.slice()), len: row }, zeros(self.after)])
    }
}

impl Op for Pad {
    fn name(&self) -> &'static str {
        "pad"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        let mut dims = x.shape.dims().to_vec();
        let Some(size) = dims.get_mut(self.axis) else {
            return Err(
                Error::new(ErrorKind::Shape, "pad: no such axis").found(format!("axis {} of {:?}", self.axis, x))
            );
        };
        *size += self.before + self.after;
        Ok(Spec::new(dims, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let spec = self.infer(&[inputs[0].spec()])?;
        for_real!(spec.dtype, T => Ok(Tensor::from_vec(self.run::<T>(&inputs[0]), spec.shape).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let result = self.infer(&[x.spec()])?;
        let (from, inner) = self.rows(x);
        let to = result.shape.dims()[self.axis] * inner;
        let before = self.before * inner;
        // elements of x in front of a place of the result
        let ahead = |i: usize| i / to * from + (i % to).saturating_sub(before).min(from);
        let y = gpu.empty(result)?;
        for (first, part) in gpu.windows(&y, 0..y.len()).into_iter().filter(|(_, part)| !part.is_empty()) {
            for (begin, window) in gpu.windows(x, ahead(first)..ahead(first + part.len())) {
                let sizes = words([part.len(), from, to, before, first, begin]);
                gpu.dispatch(&KERNEL, &[&part, &window], &sizes, Work::Invocations(part.len()))?;
            }
        }
        Ok(y.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let size = cx.input(0).dims()[self.axis];
        Ok(vec![Some(cx.gradient().slice(self.axis, self.before..self.before + size))])
    }
}

impl Var {
    /// Zeros before and after along one axis.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
    /// assert_eq!(x.pad(0, 1, 2).value()?.slice::<f64>(), [0.0, 1.0, 2.0, 0.0, 0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn pad(&self, axis: usize, before: usize, after: usize) -> Self {
        Self::run(Rc::new(Pad { axis, before, after }), &[self])
    }
}
