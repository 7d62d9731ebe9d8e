//! `take`: from each row the element at the place that an index names. Its derivative is [`put`](super::put).

use std::rc::Rc;

use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::index_select::check_rows;
use crate::ops::put::Put;
use crate::ops::reduction::Axes;
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{DType, Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "take",
    gpu: true,
    cases: || {
        let case = |shape: &[usize], axes: &[usize], index: &[u32]| {
            let x = uniform(1, shape, -1.0..1.0);
            let axes = Axes::new(axes);
            let index = Tensor::from_vec(index.to_vec(), axes.kept(x.shape()));
            Case::new(Take::new(axes), [x, index])
        };
        vec![
            case(&[3, 4], &[1], &[0, 3, 2]),
            case(&[2, 3, 4], &[0, 2], &[7, 0, 5]),
            case(&[5], &[0], &[4]),
            case(&[2, 3, 2], &[1], &[0, 1, 2, 1]),
        ]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("take", "main", include_str!("../../kernels/take.wgsl"), &["y", "x", "index"]);

#[derive(Debug)]
pub(super) struct Take {
    axes: Axes,
}

impl Take {
    /// An index counts the places of `axes` in row-major order.
    pub(super) fn new(axes: Axes) -> Self {
        Self { axes }
    }

    fn run<T: Real>(&self, x: &Tensor, index: &[u32]) -> Vec<T> {
        let (kept, dropped) = (self.axes.walk(x.shape(), false), self.axes.walk(x.shape(), true));
        let values = x.slice::<T>();
        filled(kept.len(), CHUNK, |start, out: &mut [T]| {
            for (number, (out, &i)) in (start..).zip(out.iter_mut().zip(&index[start..])) {
                *out = values[kept.place(number) + dropped.place(i as usize)];
            }
        })
    }
}

impl Op for Take {
    fn name(&self) -> &'static str {
        "take"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x, index] = Spec::exactly(self.name(), inputs)?;
        let result = self.axes.infer(self.name(), x.real(self.name())?)?;
        self.axes.check_numbers(self.name(), &x.shape)?;
        if index.shape != result.shape || index.dtype != DType::U32 {
            return Err(Error::new(ErrorKind::Shape, "take: the operands do not fit")
                .found(format!("{x:?} at {index:?}"))
                .wanted(format!("u32{} as the index", result.shape)));
        }
        Ok(result)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [x, index] = inputs.array();
        check_rows(self.name(), index.slice(), self.axes.walk(x.shape(), true).len())?;
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(self.run::<T>(x, index.slice()), index.shape()).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [x, index] = inputs.array();
        let (kept, dropped) = (self.axes.walk(x.shape(), false), self.axes.walk(x.shape(), true));
        let axes = [kept.words(self.name())?, dropped.words(self.name())?].concat();
        let y = gpu.empty(Spec::new(index.shape(), x.dtype()))?;
        for ((first, part), (_, index)) in gpu.windows(&y, 0..y.len()).into_iter().zip(gpu.windows(index, 0..y.len())) {
            for (begin, window) in gpu.windows(x, kept.bounds_with(&dropped, first, part.len())) {
                let mut sizes = words([part.len(), kept.rank(), dropped.rank(), first, begin, 0, 0, 0]).to_vec();
                sizes.extend_from_slice(&axes);
                gpu.dispatch(&KERNEL, &[&part, &window, &index], &sizes, Work::Invocations(part.len()))?;
            }
        }
        Ok(y.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing().input(1)
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let put = Put::new(cx.input(0).shape(), self.axes.clone());
        Ok(vec![Some(Var::run(Rc::new(put), &[cx.gradient(), cx.input(1)])), None])
    }
}
