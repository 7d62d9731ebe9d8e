//! `sum` over some axes, which are dropped from the shape. The order of the additions depends on nothing but the shape:
//! on the CPU they are in `f64`, on a GPU in `f32` along a tree.

use std::rc::Rc;

use rayon::prelude::*;

use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::{Gpu, Kernel, Strides, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Reads, Var};
use crate::tensor::for_real;
use crate::{Element, Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "sum",
    gpu: true,
    cases: || {
        let case = |axes: &[usize]| Case::new(Sum { axes: axes.to_vec() }, [uniform(1, [2, 3, 4], -1.0..1.0)]);
        vec![case(&[0, 1, 2]), case(&[1]), case(&[0, 2]), case(&[])]
    },
};

const TEXT: &str = include_str!("../../kernels/sum.wgsl");
/// One invocation for each span.
pub(super) static ROWS: Kernel = Kernel::new("sum", "rows", TEXT, &["y", "x"]);
/// One workgroup for each span.
pub(super) static TREE: Kernel = Kernel::new("sum", "tree", TEXT, &["y", "x"]);

/// Sums from which on an invocation for each keeps a GPU busy.
const MANY: usize = 1 << 14;

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

    /// Sizes and strides of the axes that are summed, or of those that are kept.
    fn axes(&self, shape: &Shape, summed: bool) -> Vec<(usize, usize)> {
        let axes = shape.dims().iter().copied().zip(shape.strides()).enumerate();
        axes.filter(|(axis, _)| self.axes.contains(axis) == summed).map(|(_, extent)| extent).collect()
    }

    fn run<T: Element>(&self, x: &Tensor) -> Vec<T> {
        let values = x.slice::<T>();
        if self.axes.len() == x.shape().rank() {
            let add = |part: &[T]| part.iter().map(|v| v.to_f64()).sum::<f64>();
            let parts: Vec<f64> = values.par_chunks(CHUNK).map(add).collect();
            return vec![T::from_f64(parts.iter().sum())];
        }
        let offsets = |axes: &[(usize, usize)], flat: usize| {
            let mut rest = flat;
            axes.iter().rev().fold(0, |offset, &(size, stride)| {
                let index = rest % size;
                rest /= size;
                offset + index * stride
            })
        };
        let (kept, summed) = (self.axes(x.shape(), false), self.axes(x.shape(), true));
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

    fn forward_gpu(&self, gpu: &Gpu, inputs: &[Tensor]) -> Result<Forward> {
        let mut kept = Strides::new(self.axes(inputs[0].shape(), false));
        let mut summed = Strides::new(self.axes(inputs[0].shape(), true));
        let mut partial = inputs[0].clone();
        loop {
            let (sums, count) = (kept.len(), summed.len());
            let rows = sums >= MANY || count <= ROWS.reflect()?.constant("ROWS_SPAN");
            let (kernel, span) = if rows { (&ROWS, "ROWS_SPAN") } else { (&TREE, "TREE_SPAN") };
            let spans = count.div_ceil(kernel.reflect()?.constant(span)).max(1);
            let work = if rows { Work::Invocations(sums * spans) } else { Work::Groups(sums * spans) };
            let mut sizes = words([sums, count, spans, kept.rank(), summed.rank(), 0, 0, 0]).to_vec();
            sizes.extend(kept.words(self.name())?);
            sizes.extend(summed.words(self.name())?);
            partial = gpu.launch(kernel, &[&partial], &sizes, Spec::new([spans, sums], partial.dtype()), work)?;
            if spans == 1 {
                return Ok(partial.reshape(self.kept(inputs[0].shape())).into());
            }
            (kept, summed) = (Strides::new([(sums, 1)]), Strides::new([(spans, sums)]));
        }
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
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
