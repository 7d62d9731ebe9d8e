//! `sum` over some axes, which are dropped from the shape. Accumulates in `f64`, in an order fixed by the shape.

use std::rc::Rc;

use rayon::prelude::*;

use crate::backend::cpu::{CHUNK, filled};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Var};
use crate::tensor::for_real;
use crate::{Element, Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "sum",
    gpu: false,
    cases: || {
        let case = |axes: &[usize]| Case::new(Sum { axes: axes.to_vec() }, [uniform(1, [2, 3, 4], -1.0..1.0)]);
        vec![case(&[0, 1, 2]), case(&[1]), case(&[0, 2]), case(&[])]
    },
};

#[derive(Debug)]
struct Sum {
    /// Strictly increasing.
    axes: Vec<usize>,
}

impl Sum {
    fn kept(&self, shape: &Shape) -> Shape {
        let kept = shape.dims().iter().enumerate().filter(|(axis, _)| !self.axes.contains(axis));
        Shape::from(kept.map(|(_, size)| *size).collect::<Vec<_>>())
    }

    fn run<T: Element>(&self, x: &Tensor) -> Vec<T> {
        let values = x.slice::<T>();
        if self.axes.len() == x.shape().rank() {
            let add = |part: &[T]| part.iter().map(|v| v.to_f64()).sum::<f64>();
            let parts: Vec<f64> = values.par_chunks(CHUNK).map(add).collect();
            return vec![T::from_f64(parts.iter().sum())];
        }
        let strides = x.shape().strides();
        let pick = |summed: bool| -> Vec<(usize, usize)> {
            let axes = (0..x.shape().rank()).filter(|axis| self.axes.contains(axis) == summed);
            axes.map(|axis| (x.dims()[axis], strides[axis])).collect()
        };
        let offsets = |axes: &[(usize, usize)], flat: usize| {
            let mut rest = flat;
            axes.iter().rev().fold(0, |offset, &(size, stride)| {
                let index = rest % size;
                rest /= size;
                offset + index * stride
            })
        };
        let (kept, summed) = (pick(false), pick(true));
        let count: usize = summed.iter().map(|(size, _)| size).product();
        let inner: Vec<usize> = (0..count).map(|i| offsets(&summed, i)).collect();
        filled(self.kept(x.shape()).len(), (CHUNK / count.max(1)).max(1), |start, part: &mut [T]| {
            for (i, out) in part.iter_mut().enumerate() {
                let base = offsets(&kept, start + i);
                *out = T::from_f64(inner.iter().map(|offset| values[base + offset].to_f64()).sum());
            }
        })
    }
}

impl Op for Sum {
    fn name(&self) -> &'static str {
        "sum"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let rank = inputs[0].shape.rank();
        if self.axes.iter().any(|&axis| axis >= rank) {
            return Err(Error::new(ErrorKind::Shape, "sum: no such axis")
                .found(format!("axes {:?} of {:?}", self.axes, inputs[0]))
                .wanted(format!("axes below {rank}")));
        }
        Ok(Spec::new(self.kept(&inputs[0].shape), inputs[0].dtype))
    }

    fn forward_cpu(&self, inputs: &[Tensor]) -> Result<Forward> {
        let x = &inputs[0];
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(self.run::<T>(x), self.kept(x.shape())).into()))
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let x = cx.input(0);
        let mut with_ones = x.dims().to_vec();
        self.axes.iter().for_each(|&axis| with_ones[axis] = 1);
        Ok(vec![Some(cx.gradient().reshape(with_ones).broadcast_to(x.shape()))])
    }
}

impl Var {
    /// The sum over some axes, which are dropped.
    ///
    /// # Panics
    /// When an axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn sum(&self, axes: &[usize]) -> Self {
        let mut axes = axes.to_vec();
        axes.sort_unstable();
        axes.dedup();
        Self::run(Rc::new(Sum { axes }), &[self])
    }

    /// The sum of all elements, a number without axes.
    #[track_caller]
    #[must_use]
    pub fn sum_all(&self) -> Self {
        self.sum(&(0..self.shape().rank()).collect::<Vec<_>>())
    }

    /// The mean over some axes, which are dropped; NaN when they are empty.
    ///
    /// # Panics
    /// When an axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn mean(&self, axes: &[usize]) -> Self {
        let sum = self.sum(axes);
        let count = self.len() as f64 / sum.len() as f64;
        &sum / count
    }

    /// The mean of all elements, a number without axes; NaN for an empty tensor.
    #[track_caller]
    #[must_use]
    pub fn mean_all(&self) -> Self {
        &self.sum_all() / self.len() as f64
    }
}
