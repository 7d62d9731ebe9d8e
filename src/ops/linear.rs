//! `linear`: `y = x · wᵀ + b`, a layer's weights as PyTorch keeps them.

use std::rc::Rc;

use crate::backend::gpu::Gpu;
use crate::ops::matmul::{Product, product};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "linear",
    gpu: true,
    cases: || {
        let case = |rows: usize, width: usize, out: usize| {
            let (x, w) = (uniform(1, [rows, width], -1.0..1.0), uniform(2, [out, width], -1.0..1.0));
            Case::new(Linear, [x, w, uniform(3, [out], -1.0..1.0)])
        };
        vec![case(4, 3, 5), case(1, 1, 1), case(17, 5, 2), case(3, 66, 67), case(0, 3, 2)]
    },
};

/// Operands `[rows, in]`, `[out, in]`, `[out]`.
#[derive(Debug)]
struct Linear;

impl Linear {
    fn product(x: &Tensor, w: &Tensor) -> Product {
        Product::new([false, true], x.shape(), w.shape()).expect("checked by infer")
    }
}

impl Op for Linear {
    fn name(&self) -> &'static str {
        "linear"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x, w, bias] = Spec::exactly(self.name(), inputs)?;
        let same = x.dtype.is_real() && x.dtype == w.dtype && x.dtype == bias.dtype;
        match (x.shape.dims(), w.shape.dims(), bias.shape.dims()) {
            (&[rows, width], &[out, depth], &[biases]) if same && width == depth && out == biases => {
                Ok(Spec::new([rows, out], x.dtype))
            }
            _ => Err(Error::new(ErrorKind::Shape, "linear: the operands do not fit")
                .found(format!("x {x:?}, weight {w:?}, bias {bias:?}"))
                .wanted("x [..,in], weight [out,in], bias [out], all f32 or all f64")
                .fix("a weight kept as [in,out] goes through Var::matmul; to_dtype casts")),
        }
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [x, w, bias] = inputs.array();
        let product = Self::product(x, w);
        let shape = [product.m, product.n];
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(product.run::<T>(x, w, Some(bias)), shape).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [x, w, bias] = inputs.array();
        let product = Self::product(x, w);
        let result = Spec::new([product.m, product.n], x.dtype());
        Ok(product.launch(gpu, &[x, w, bias], result)?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        Reads::nothing().input_if(0, wanted[1]).input_if(1, wanted[0])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (x, w, g) = (cx.input(0), cx.input(1), cx.gradient());
        Ok(vec![
            cx.wants(0).then(|| product(g, w, [false, false])),
            cx.wants(1).then(|| product(g, x, [true, false])),
            cx.wants(2).then(|| g.sum(&[0])),
        ])
    }
}

impl Var {
    /// A linear layer, `y = x · wᵀ + b`: of `[.., in]`, a weight `[out, in]` and a bias `[out]` it makes `[.., out]`.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0f32, 2.0], [1, 2]));
    /// let weight = tape.leaf(Tensor::from_vec(vec![3.0f32, 4.0, 5.0, 6.0, 7.0, 8.0], [3, 2]));
    /// let bias = tape.leaf(Tensor::from_vec(vec![0.5f32, 0.0, -0.5], [3]));
    /// assert_eq!(x.linear(&weight, Some(&bias)).value()?.slice::<f32>(), &[11.5, 17.0, 22.5]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes or dtypes do not fit.
    #[track_caller]
    #[must_use]
    pub fn linear(&self, weight: &Self, bias: Option<&Self>) -> Self {
        let Some(bias) = bias else { return self.matmul_transposed(weight) };
        let run = |x: &Self| Self::run(Rc::new(Linear), &[x, weight, bias]);
        let Some((&width, batch)) = self.dims().split_last() else { return run(self) };
        if batch.len() == 1 {
            return run(self);
        }
        let rows = run(&self.reshape([batch.iter().product(), width]));
        let mut shape = batch.to_vec();
        shape.push(rows.dims()[1]);
        rows.reshape(shape)
    }
}
