//! `arg_extremum`: where the largest or smallest element over some axes is, as its number in row-major order of those
//! axes. The first one on a tie; the first NaN if there is one. It has no derivative.

use std::rc::Rc;

use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::one_hot::OneHot;
use crate::ops::reduction::Axes;
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Reads, Var};
use crate::tensor::for_real;
use crate::{DType, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "arg_extremum",
    gpu: true,
    cases: || {
        let case = |axes: &[usize], largest, x: Tensor| {
            Case::new(ArgExtremum { axes: Axes::new(axes), largest }, [x]).condition()
        };
        let ties =
            Tensor::from_vec(vec![1.0f64, 3.0, 3.0, 1.0, 2.0, 2.0, 2.0, 2.0, f64::NAN, 5.0, f64::NAN, 5.0], [3, 4]);
        vec![
            case(&[1], true, ties.clone()),
            case(&[1], false, ties.clone()),
            case(&[0, 1], true, ties),
            case(&[0, 2], false, uniform(1, [2, 3, 4], -1.0..1.0)),
            case(&[0], true, uniform(2, [300, 2], -1.0..1.0)),
        ]
    },
};

const TEXT: &str = include_str!("../../kernels/arg_extremum.wgsl");
/// One invocation for each result.
pub(super) static ROWS: Kernel = Kernel::new("arg_extremum", "rows", TEXT, &["y", "x"]);
/// One workgroup for each result.
pub(super) static TREE: Kernel = Kernel::new("arg_extremum", "tree", TEXT, &["y", "x"]);

/// Elements behind a result from which on a workgroup works on it.
const LONG: usize = 256;

#[derive(Debug)]
struct ArgExtremum {
    axes: Axes,
    largest: bool,
}

impl ArgExtremum {
    fn run<T: Real>(&self, x: &Tensor) -> Vec<u32> {
        let (kept, dropped) = (self.axes.walk(x.shape(), false), self.axes.walk(x.shape(), true));
        let values = x.slice::<T>();
        filled(kept.len(), (CHUNK / dropped.len().max(1)).max(1), |start, out: &mut [u32]| {
            for (i, out) in out.iter_mut().enumerate() {
                let base = kept.place(start + i);
                let (mut best, mut at, mut number) = (values[base], 0, 0);
                let (run, step) = dropped.axes().last().copied().unwrap_or((1, 0));
                while number < dropped.len() && !best.is_nan() {
                    let row = base + dropped.place(number);
                    for place in 0..run {
                        let x = values[row + place * step];
                        if (if self.largest { x > best } else { x < best }) || (x.is_nan() && !best.is_nan()) {
                            (best, at) = (x, number + place);
                        }
                    }
                    number += run;
                }
                *out = u32::try_from(at).expect("infer has checked the number of elements");
            }
        })
    }
}

impl Op for ArgExtremum {
    fn name(&self) -> &'static str {
        "arg_extremum"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let shape = self.axes.infer_some(self.name(), &inputs[0])?.shape;
        self.axes.check_numbers(self.name(), &inputs[0].shape)?;
        Ok(Spec::new(shape, DType::U32))
    }

    fn forward_cpu(&self, inputs: &[Tensor]) -> Result<Forward> {
        let x = &inputs[0];
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(self.run::<T>(x), self.axes.kept(x.shape())).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: &[Tensor]) -> Result<Forward> {
        let x = &inputs[0];
        let (kept, dropped) = (self.axes.walk(x.shape(), false), self.axes.walk(x.shape(), true));
        let (results, count) = (kept.len(), dropped.len());
        let largest = usize::from(self.largest);
        let mut sizes = words([results, count, kept.rank(), dropped.rank(), largest, 0, 0, 0]).to_vec();
        sizes.extend(kept.words(self.name())?);
        sizes.extend(dropped.words(self.name())?);
        let long = count >= LONG;
        let (kernel, work) = if long { (&TREE, Work::Groups(results)) } else { (&ROWS, Work::Invocations(results)) };
        Ok(gpu.launch(kernel, &[x], &sizes, self.infer(&[x.spec()])?, work)?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, _cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![None])
    }
}

impl Var {
    /// The number of the largest element along an axis, which is dropped, as `u32`: the first one on a tie, the first NaN
    /// if there is one. A constant: it has no derivative.
    ///
    /// # Panics
    /// When the axis does not exist or is empty.
    #[track_caller]
    #[must_use]
    pub fn argmax(&self, axis: usize) -> Self {
        Self::run(Rc::new(ArgExtremum { axes: Axes::new(&[axis]), largest: true }), &[&self.detach()])
    }

    /// The number of the smallest element along an axis; as [`Var::argmax`].
    ///
    /// # Panics
    /// When the axis does not exist or is empty.
    #[track_caller]
    #[must_use]
    pub fn argmin(&self, axis: usize) -> Self {
        Self::run(Rc::new(ArgExtremum { axes: Axes::new(&[axis]), largest: false }), &[&self.detach()])
    }

    /// This cotangent of an extremum, put where the extremum of `x` is, among zeros.
    pub(super) fn to_extremum(&self, x: &Self, axes: &Axes, largest: bool) -> Self {
        let place = Self::run(Rc::new(ArgExtremum { axes: axes.clone(), largest }), &[&x.detach()]);
        let hot = OneHot::new(x.shape(), axes.clone(), x.dtype()).of(&place);
        hot.choose(&self.reshape(axes.with_ones(x.shape())), &self.number(0.0))
    }
}
