//! `prod`: the product over some axes, which are dropped from the shape. Its derivative is right where factors are 0.

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
    name: "prod",
    gpu: true,
    cases: || {
        let case = |axes: &[usize], x: Tensor| Case::new(Prod { axes: Axes::new(axes) }, [x]);
        let zeros = Tensor::from_vec(vec![2.0f64, 0.0, -1.5, 0.0, 3.0, 0.0, 1.0, 2.0, 0.5], [3, 3]);
        let some = || uniform(1, [2, 3, 4], -1.5..1.5);
        vec![
            case(&[0, 1, 2], some()),
            case(&[1], some()),
            case(&[0, 2], some()),
            case(&[1], zeros.clone()),
            case(&[0], zeros),
            case(&[1], uniform(2, [3, 1], -1.0..1.0)),
            case(&[], uniform(2, [3], -1.0..1.0)),
        ]
    },
};

#[derive(Debug)]
struct Prod {
    axes: Axes,
}

struct InDouble;

impl<T: Real> Fold<T> for InDouble {
    type State = f64;
    const START: f64 = 1.0;

    #[inline(always)]
    fn add(state: f64, x: T) -> f64 {
        state * x.to_f64()
    }

    #[inline(always)]
    fn join(a: f64, b: f64) -> f64 {
        a * b
    }

    #[inline(always)]
    fn finish(state: f64) -> T {
        T::from_f64(state)
    }
}

impl Op for Prod {
    fn name(&self) -> &'static str {
        "prod"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        self.axes.infer(self.name(), x)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        for_real!(inputs[0].dtype(), T => Ok(self.axes.on_cpu::<T, InDouble>(&inputs[0]).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        Ok(self.axes.on_gpu(gpu, self.name(), &inputs[0], Join::Product)?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    /// Each factor's cotangent is that of the product times all *other* factors: those before it times those after it.
    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (x, g) = (cx.input(0), cx.gradient());
        let rank = x.shape().rank();
        let mut order: Vec<usize> = (0..rank).filter(|axis| !self.axes.contains(*axis)).collect();
        order.extend((0..rank).filter(|axis| self.axes.contains(*axis)));
        let moved = x.permute(&order);
        let (rows, count) = (g.len(), x.len() / g.len().max(1));
        if x.is_empty() {
            return Ok(vec![Some(x * 0.0)]);
        }
        let factors = moved.reshape([rows, count]);
        let ones = g.number(1.0).broadcast_to([rows, 1]);
        let before = ones.concat(&[&factors.slice(1, 0..count - 1).cumprod(1)], 1);
        let after = factors.slice(1, 1..count).cumprod_from_end(1).concat(&[&ones], 1);
        let others = (before * after) * g.reshape([rows, 1]);
        let mut back = vec![0; rank];
        order.iter().enumerate().for_each(|(to, &from)| back[from] = to);
        Ok(vec![Some(others.reshape(moved.shape()).permute(&back))])
    }
}

impl Var {
    /// The product over some axes, which are dropped; 1 over no elements.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![2.0, 3.0, 4.0], [3]));
    /// assert_eq!(x.prod(&[0]).item()?, 24.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When an axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn prod(&self, axes: &[usize]) -> Self {
        Self::run(Rc::new(Prod { axes: Axes::new(axes) }), &[self])
    }
}
