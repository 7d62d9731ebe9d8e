//! `concat`: tensors one after the other along an axis.

use std::rc::Rc;

use crate::backend::cpu::rows::{Part, joined};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Element, Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "concat",
    gpu: true,
    cases: || {
        let part = |seed, size| uniform(seed, [2, size, 3], -1.0..1.0);
        vec![
            Case::new(Concat { axis: 1 }, [part(1, 2), part(2, 1), part(3, 4)]),
            Case::new(Concat { axis: 0 }, [part(1, 2), part(2, 2)]),
            Case::new(Concat { axis: 2 }, [part(1, 2)]),
        ]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("concat", "main", include_str!("../../kernels/concat.wgsl"), &["y", "x"]);

#[derive(Debug)]
struct Concat {
    axis: usize,
}

impl Concat {
    fn run<T: Element>(&self, inputs: &[Tensor]) -> Vec<T> {
        let outer: usize = inputs[0].dims()[..self.axis].iter().product();
        let row = |x: &Tensor| x.dims()[self.axis..].iter().product();
        let parts: Vec<_> = inputs.iter().map(|x| Part { values: Some(x.slice::<T>()), len: row(x) }).collect();
        joined(outer, &parts)
    }
}

/// Tensors on a GPU, one after the other along an axis. Their shapes fit.
pub(super) fn join(gpu: &Gpu, inputs: &[Tensor], axis: usize) -> Result<Tensor> {
    let mut dims = inputs[0].dims().to_vec();
    dims[axis] = inputs.iter().map(|x| x.dims()[axis]).sum();
    let to: usize = dims[axis..].iter().product();
    let y = gpu.empty(Spec::new(dims, inputs[0].dtype()))?;
    let mut start = 0;
    for x in inputs {
        let from: usize = x.dims()[axis..].iter().product();
        let place = |i: usize| i / from * to + start + i % from;
        for (first, part) in gpu.windows(x, 0..x.len()).into_iter().filter(|(_, part)| !part.is_empty()) {
            let written = place(first)..place(first + part.len() - 1) + 1;
            for (begin, window) in gpu.windows(&y, written) {
                let sizes = words([part.len(), from, to, start, first, begin]);
                gpu.dispatch(&KERNEL, &[&window, &part], &sizes, Work::Invocations(part.len()))?;
            }
        }
        start += from;
    }
    Ok(y)
}

impl Op for Concat {
    fn name(&self) -> &'static str {
        "concat"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let without_axis = |x: &Spec| {
            let mut dims = x.shape.dims().to_vec();
            (self.axis < dims.len()).then(|| dims.remove(self.axis))?;
            Some((dims, x.dtype))
        };
        let first = without_axis(Spec::between(self.name(), inputs, 1..=usize::MAX)?[0].real(self.name())?);
        if first.is_none() || inputs.iter().any(|x| without_axis(x) != first) {
            return Err(Error::new(ErrorKind::Shape, "concat: operands must agree in all axes but one")
                .found(format!("{inputs:?} along axis {}", self.axis)));
        }
        let mut dims = inputs[0].shape.dims().to_vec();
        dims[self.axis] = inputs.iter().map(|x| x.shape.dims()[self.axis]).sum();
        Ok(Spec::new(dims, inputs[0].dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let specs: Vec<_> = inputs.iter().map(Tensor::spec).collect();
        let spec = self.infer(&specs)?;
        for_real!(spec.dtype, T => Ok(Tensor::from_vec(self.run::<T>(&inputs), spec.shape).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        Ok(join(gpu, &inputs, self.axis)?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let mut start = 0;
        Ok(cx
            .inputs()
            .iter()
            .map(|x| {
                let range = start..start + x.dims()[self.axis];
                start = range.end;
                Some(cx.gradient().slice(self.axis, range))
            })
            .collect())
    }
}

impl Var {
    /// This tensor and others, one after the other along `axis`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0], [1]));
    /// let y = tape.leaf(Tensor::from_vec(vec![2.0, 3.0], [2]));
    /// assert_eq!(x.concat(&[&y], 0).value()?.slice::<f64>(), [1.0, 2.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When they differ in another axis or in dtype.
    #[track_caller]
    #[must_use]
    pub fn concat(&self, others: &[&Self], axis: usize) -> Self {
        let inputs: Vec<_> = std::iter::once(self).chain(others.iter().copied()).collect();
        Self::run(Rc::new(Concat { axis }), &inputs)
    }
}
