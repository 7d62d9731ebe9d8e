//! `broadcast_to`: stretches axes of size 1, and adds axes in front.

use std::rc::Rc;

use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::{Gpu, Strides};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Reads, Var};
use crate::tensor::for_real;
use crate::{Element, Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "broadcast_to",
    gpu: true,
    cases: || {
        vec![
            Case::new(BroadcastTo { shape: [4, 2, 3].into() }, [uniform(1, [2, 1], -1.0..1.0)]),
            Case::new(BroadcastTo { shape: [2, 3].into() }, [uniform(1, [], -1.0..1.0)]),
        ]
    },
};

#[derive(Debug)]
struct BroadcastTo {
    shape: Shape,
}

impl BroadcastTo {
    /// For each axis of the result, the distance between neighbours in `x`: 0 along a stretched one.
    fn steps(&self, x: &Shape) -> Vec<usize> {
        let (pad, strides) = (self.shape.rank() - x.rank(), x.strides());
        let step = |axis: usize| axis.checked_sub(pad).filter(|&a| x.dims()[a] > 1).map_or(0, |a| strides[a]);
        (0..self.shape.rank()).map(step).collect()
    }

    fn run<T: Element>(&self, x: &Tensor) -> Vec<T> {
        let values = x.slice::<T>();
        let steps = self.steps(x.shape());
        let inner = self.shape.dims().last().copied().unwrap_or(1).max(1);
        let inner_step = steps.last().copied().unwrap_or(0);
        let outer = Shape::from(&self.shape.dims()[..self.shape.rank().saturating_sub(1)]);
        filled(self.shape.len(), CHUNK.next_multiple_of(inner), |start, part: &mut [T]| {
            for (row, out) in part.chunks_mut(inner).enumerate() {
                let index = outer.index(start / inner + row);
                let base: usize = index.iter().zip(&steps).map(|(i, step)| i * step).sum();
                match inner_step {
                    0 => out.fill(values[base]),
                    _ => out.copy_from_slice(&values[base..base + inner]),
                }
            }
        })
    }
}

impl Op for BroadcastTo {
    fn name(&self) -> &'static str {
        "broadcast_to"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        if inputs[0].shape.broadcast(&self.shape)? != self.shape {
            return Err(Error::new(ErrorKind::Shape, "broadcast_to: the operand does not stretch to this shape")
                .found(format!("{:?}", inputs[0]))
                .wanted(&self.shape));
        }
        Ok(Spec::new(&self.shape, inputs[0].dtype))
    }

    fn forward_cpu(&self, inputs: &[Tensor]) -> Result<Forward> {
        for_real!(inputs[0].dtype(), T => Ok(Tensor::from_vec(self.run::<T>(&inputs[0]), &self.shape).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: &[Tensor]) -> Result<Forward> {
        let x = &inputs[0];
        let strides = Strides::new(self.shape.dims().iter().copied().zip(self.steps(x.shape())));
        Ok(strides.gather(gpu, self.name(), x, 0, Spec::new(&self.shape, x.dtype()))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let x = cx.input(0);
        let pad = self.shape.rank() - x.shape().rank();
        let axes: Vec<usize> = (0..self.shape.rank()).filter(|&a| a < pad || x.dims()[a - pad] == 1).collect();
        Ok(vec![Some(cx.gradient().sum(&axes).reshape(x.shape()))])
    }
}

impl Var {
    /// Stretches axes of size 1 to this shape, adding axes in front where needed.
    ///
    /// # Panics
    /// When the shape does not stretch so.
    #[track_caller]
    #[must_use]
    pub fn broadcast_to(&self, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        if *self.shape() == shape { self.clone() } else { Self::run(Rc::new(BroadcastTo { shape }), &[self]) }
    }
}
