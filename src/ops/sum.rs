//! `sum` over some axes, which are dropped from the shape. The order of the additions depends on nothing but the shape:
//! on the CPU they are in `f64`, on a GPU in `f32` along a tree.

use std::rc::Rc;

use crate::backend::cpu::reduce::Fold;
use crate::backend::gpu::Gpu;
use crate::ops::reduction::{Axes, Join};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Result, Shape, Spec};

pub(super) const ENTRY: Entry = Entry {
    name: "sum",
    gpu: true,
    cases: || {
        let case = |axes: &[usize]| Case::new(Sum { axes: Axes::new(axes) }, [uniform(1, [2, 3, 4], -1.0..1.0)]);
        vec![case(&[0, 1, 2]), case(&[1]), case(&[0, 2]), case(&[])]
    },
};

#[derive(Debug)]
struct Sum {
    axes: Axes,
}

struct InDouble;

impl<T: Real> Fold<T> for InDouble {
    type State = f64;
    const START: f64 = 0.0;

    #[inline(always)]
    fn add(state: f64, x: T) -> f64 {
        state + x.to_f64()
    }

    #[inline(always)]
    fn join(a: f64, b: f64) -> f64 {
        a + b
    }

    #[inline(always)]
    fn finish(state: f64) -> T {
        T::from_f64(state)
    }
}

impl Op for Sum {
    fn name(&self) -> &'static str {
        "sum"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        self.axes.infer(self.name(), x)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        for_real!(inputs[0].dtype(), T => Ok(self.axes.on_cpu::<T, InDouble>(&inputs[0]).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        Ok(self.axes.on_gpu(gpu, self.name(), &inputs[0], Join::Sum)?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().stretch_back(&self.axes, cx.input(0).shape()))])
    }
}

impl Var {
    /// The sum over some axes, which are dropped.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [2, 2]));
    /// assert_eq!(x.sum(&[1]).value()?.slice::<f64>(), [3.0, 7.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When an axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn sum(&self, axes: &[usize]) -> Self {
        Self::run(Rc::new(Sum { axes: Axes::new(axes) }), &[self])
    }

    /// The sum of all elements, a number without axes.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// assert_eq!(x.sum_all().item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn sum_all(&self) -> Self {
        self.sum(&(0..self.shape().rank()).collect::<Vec<_>>())
    }

    /// Sums up what broadcasting from this shape stretched: the adjoint of [`Var::broadcast_to`].
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [2, 2]));
    /// assert_eq!(x.sum_to([2, 1]).value()?.slice::<f64>(), [3.0, 7.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shape does not stretch to that of `self`.
    #[track_caller]
    #[must_use]
    pub fn sum_to(&self, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        if *self.shape() == shape {
            return self.clone();
        }
        let stretches = shape.broadcast(self.shape()).is_ok_and(|whole| whole == *self.shape());
        assert!(stretches, "sum_to: {shape} does not stretch to {}", self.shape());
        let added = self.shape().rank() - shape.rank();
        let axes: Vec<usize> = (0..self.shape().rank())
            .filter(|&axis| axis < added || (shape.dims()[axis - added] == 1 && self.dims()[axis] != 1))
            .collect();
        let sum = if axes.is_empty() { self.clone() } else { self.sum(&axes) };
        sum.reshape(shape)
    }

    /// The mean over some axes, which are dropped; NaN when they are empty.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [2, 2]));
    /// assert_eq!(x.mean(&[0]).value()?.slice::<f64>(), [2.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When an axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn mean(&self, axes: &[usize]) -> Self {
        let sum = self.sum(axes);
        &sum / self.count_behind(axes)
    }

    /// The mean of all elements, a number without axes; NaN for an empty tensor.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// assert_eq!(x.mean_all().item()?, 2.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn mean_all(&self) -> Self {
        &self.sum_all() / self.len() as f64
    }

    /// The variance over some axes, which are dropped: `Σ (x − mean)² / (n − correction)`; a correction of 1 makes the
    /// estimate from a sample unbiased, 0 gives the variance of the numbers themselves.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// assert_eq!(x.variance(&[0], 1).item()?, 1.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When an axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn variance(&self, axes: &[usize], correction: usize) -> Self {
        let mean = self.mean(axes).reshape(Axes::new(axes).with_ones(self.shape()));
        let squares = (self - &mean).square().sum(axes);
        &squares / (self.count_behind(axes) - correction as f64)
    }

    /// How many elements each result of a reduction has behind it.
    fn count_behind(&self, axes: &[usize]) -> f64 {
        Axes::new(axes).walk(self.shape(), true).len() as f64
    }
}
