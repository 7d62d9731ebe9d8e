//! `max`: the largest element over some axes, which are dropped from the shape; NaN if any element is.

use std::rc::Rc;

use crate::backend::cpu::reduce::Fold;
use crate::backend::gpu::Gpu;
use crate::ops::reduction::{Axes, Join};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "max",
    gpu: true,
    cases: || {
        let case = |axes: &[usize], x: Tensor| Case::new(Max { axes: Axes::new(axes) }, [x]);
        let some = || uniform(1, [2, 3, 4], -1.0..1.0);
        vec![
            case(&[0, 1, 2], some()),
            case(&[1], some()),
            case(&[0, 2], some()),
            case(&[], some()),
            case(&[1], uniform(2, [3, 1], -1.0..1.0)),
            case(&[0], uniform(3, [70, 2], -1.0..1.0)),
        ]
    },
};

#[derive(Debug)]
struct Max {
    axes: Axes,
}

pub(super) struct Largest;

impl<T: Real> Fold<T> for Largest {
    type State = T;
    const START: T = T::NEG_INFINITY;

    #[inline(always)]
    fn add(state: T, x: T) -> T {
        if x > state || x.is_nan() { x } else { state }
    }

    #[inline(always)]
    fn join(a: T, b: T) -> T {
        Self::add(a, b)
    }

    #[inline(always)]
    fn finish(state: T) -> T {
        state
    }
}

impl Op for Max {
    fn name(&self) -> &'static str {
        "max"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        self.axes.infer_some(self.name(), x)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        for_real!(inputs[0].dtype(), T => Ok(self.axes.on_cpu::<T, Largest>(&inputs[0]).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        Ok(self.axes.on_gpu(gpu, self.name(), &inputs[0], Join::Max)?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().to_extremum(cx.input(0), &self.axes, true))])
    }
}

impl Var {
    /// The largest element over some axes, which are dropped; NaN if any element is. The derivative goes to the first
    /// largest element in row-major order.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 4.0, 3.0, 2.0], [2, 2]));
    /// assert_eq!(x.max(&[1]).value()?.slice::<f64>(), [4.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When an axis does not exist or is empty.
    #[track_caller]
    #[must_use]
    pub fn max(&self, axes: &[usize]) -> Self {
        Self::run(Rc::new(Max { axes: Axes::new(axes) }), &[self])
    }
}
