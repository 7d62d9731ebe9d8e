//! `mlp`: a multilayer perceptron as one op.
//!
//! `h₀ = x`, `hᵢ = f(hᵢ₋₁ · wᵢᵀ + bᵢ)`, with one function `f` between the layers and none, or another, after the last.
//!
//! On the CPU blocks of a few hundred rows go through all layers while they are in the cache; what is between the layers
//! reaches memory only where the derivative would take longer to compute it again. On a GPU, and where the derivative is to be
//! differentiated again, the same is made of [`linear`](Var::linear) and the function's own op.

use std::rc::Rc;

use crate::backend::cpu::mlp;
use crate::backend::gpu::Gpu;
use crate::ops::{Activation, Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Tape, Var};
use crate::tensor::for_real;
use crate::{Device, Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "mlp",
    gpu: true,
    cases: || {
        let case = |rows: usize, widths: &[usize], hidden: Activation, last: Activation| {
            let mut inputs = vec![uniform(1, [rows, widths[0]], -1.0..1.0)];
            for (seed, pair) in (2..).step_by(2).zip(widths.windows(2)) {
                inputs.push(uniform(seed, [pair[1], pair[0]], -1.0..1.0));
                inputs.push(uniform(seed + 1, [pair[1]], -1.0..1.0));
            }
            Case::new(Mlp { hidden, last, keep: rows % 2 == 1 }, inputs)
        };
        vec![
            case(4, &[3, 5, 2], Activation::Relu, Activation::Identity),
            case(3, &[2, 4], Activation::Relu, Activation::Logistic),
            case(1, &[1, 1, 1, 1], Activation::Softplus, Activation::Identity),
            case(17, &[2, 3, 3, 1], Activation::Tanh, Activation::Softplus),
            case(5, &[3, 4, 2], Activation::Silu, Activation::Silu),
            case(5, &[3, 4, 2], Activation::Identity, Activation::Tanh),
            case(0, &[3, 4, 2], Activation::Relu, Activation::Identity),
            case(3, &[2, 64, 5, 3], Activation::Tanh, Activation::Identity),
            case(3, &[64, 4, 2], Activation::Silu, Activation::Identity),
        ]
    },
};

/// Operands: `x`, then weight and bias of each layer.
#[derive(Debug)]
struct Mlp {
    hidden: Activation,
    last: Activation,
    /// Whether a gradient will be wanted: what is between the layers may be kept for it.
    keep: bool,
}

impl Mlp {
    fn activation(&self, layer: usize, layers: usize) -> Activation {
        if layer + 1 == layers { self.last } else { self.hidden }
    }

    fn layers<'a, T: Real>(&self, inputs: &'a [Tensor]) -> Vec<mlp::Layer<'a, T>> {
        let count = inputs.len() / 2;
        let layer = |(i, pair): (usize, &'a [Tensor])| mlp::Layer {
            weight: pair[0].slice(),
            bias: pair[1].slice(),
            activation: self.activation(i, count),
            width_in: pair[0].dims()[1],
            width_out: pair[0].dims()[0],
        };
        inputs[1..].chunks(2).enumerate().map(layer).collect()
    }

    /// The op made of others, and what came before and after each function.
    fn compose(&self, inputs: &[&Var]) -> Vec<[Var; 2]> {
        let count = inputs.len() / 2;
        let mut made: Vec<[Var; 2]> = Vec::with_capacity(count);
        for (i, layer) in inputs[1..].chunks(2).enumerate() {
            let before = made.last().map_or(inputs[0], |[_, after]| after).linear(layer[0], Some(layer[1]));
            let after = self.activation(i, count).apply(&before);
            made.push([before, after]);
        }
        made
    }

    /// The derivative in one pass over the rows.
    fn fused<T: Real>(&self, cx: &Backward<'_>) -> Vec<Option<Var>> {
        let inputs: Vec<Tensor> = cx.inputs().iter().map(|x| x.tensor().clone()).collect();
        let (x, g) = (&inputs[0], cx.gradient());
        let wanted = [cx.wants(0), (1..inputs.len()).any(|i| cx.wants(i))];
        let layers = self.layers::<T>(&inputs);
        let (kept, g_values) = (cx.residual::<mlp::Kept<T>>(), g.tensor().slice::<T>());
        let found = mlp::gradients(x.slice::<T>(), &layers, kept, g_values, x.dims()[0], wanted);
        let constant = |values: Vec<T>, i: usize| Some(g.tape().constant(Tensor::from_vec(values, inputs[i].shape())));
        let mut cotangents = vec![found.x.and_then(|values| constant(values, 0))];
        for (weight, bias) in found.layers {
            cotangents.push(constant(weight, cotangents.len()));
            cotangents.push(constant(bias, cotangents.len()));
        }
        cotangents.resize_with(inputs.len(), || None);
        cotangents
    }

    /// The derivative written in ops.
    fn composed(&self, cx: &Backward<'_>) -> Vec<Option<Var>> {
        let inputs: Vec<&Var> = cx.inputs().iter().collect();
        let made = self.compose(&inputs);
        let mut cotangents = vec![None; inputs.len()];
        let mut g = cx.gradient().clone();
        for (i, [before, after]) in made.iter().enumerate().rev() {
            g = self.activation(i, made.len()).pull_back(&g, before, after);
            let input = if i == 0 { inputs[0] } else { &made[i - 1][1] };
            cotangents[2 * i + 1] = cx.wants(2 * i + 1).then(|| g.transposed_matmul(input));
            cotangents[2 * i + 2] = cx.wants(2 * i + 2).then(|| g.sum(&[0]));
            if i > 0 || cx.wants(0) {
                g = g.matmul(inputs[2 * i + 1]);
            }
        }
        cotangents[0] = cx.wants(0).then_some(g);
        cotangents
    }
}

impl Op for Mlp {
    fn name(&self) -> &'static str {
        "mlp"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let (x, layers) = (&Spec::between(self.name(), inputs, 1..=usize::MAX)?[0], &inputs[1..]);
        let mut shape = x.shape.dims().to_vec();
        let mut fits = shape.len() == 2 && !layers.is_empty() && layers.len() % 2 == 0 && x.dtype.is_real();
        for layer in layers.chunks_exact(2) {
            let weight = layer[0].shape.dims();
            fits = fits && layer.iter().all(|operand| operand.dtype == x.dtype);
            fits = fits && weight.len() == 2 && weight[1] == shape[1] && layer[1].shape.dims() == [weight[0]];
            if !fits {
                break;
            }
            shape[1] = weight[0];
        }
        if fits {
            return Ok(Spec::new(shape, x.dtype));
        }
        Err(Error::new(ErrorKind::Shape, "mlp: the operands do not fit")
            .found(format!("x {x:?}, weights and biases {layers:?}"))
            .wanted(
                "x [..,in], weights [out,in] and biases [out], each in the width of the layer before, of one dtype",
            ))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let (x, rows) = (&inputs[0], inputs[0].dims()[0]);
        let width = inputs[inputs.len() - 1].len();
        for_real!(x.dtype(), T => {
            let (result, kept) = mlp::forward(x.slice::<T>(), &self.layers(&inputs), rows, self.keep);
            let bytes = kept.bytes();
            Ok(Forward::with_residual(Tensor::from_vec(result, [rows, width]), kept).holding(bytes))
        })
    }

    fn forward_gpu(&self, _gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let tape = Tape::new();
        let inputs: Vec<Var> = inputs.iter().map(|x| tape.constant(x.clone())).collect();
        let made = self.compose(&inputs.iter().collect::<Vec<_>>());
        Ok(made[made.len() - 1][1].value()?.clone().into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let x = cx.input(0);
        if cx.is_recorded() || x.device() != Device::Cpu {
            return Ok(self.composed(cx));
        }
        for_real!(x.dtype(), T => Ok(self.fused::<T>(cx)))
    }
}

impl Activation {
    /// The function as ops.
    fn apply(self, x: &Var) -> Var {
        match self {
            Self::Identity => x.clone(),
            Self::Relu => x.relu(),
            Self::Tanh => x.tanh(),
            Self::Logistic => x.logistic(),
            Self::Softplus => x.softplus(),
            Self::Silu => x.silu(),
        }
    }

    /// `g · f'`, of what came before and after the function.
    fn pull_back(self, g: &Var, before: &Var, after: &Var) -> Var {
        let one_less = |x: &Var| 1.0 - x;
        match self {
            Self::Identity => g.clone(),
            Self::Relu => g * &before.gt(&(before * 0.0)),
            Self::Tanh => g * &one_less(&after.square()),
            Self::Logistic => g * &(after * &one_less(after)),
            Self::Softplus => g * &before.logistic(),
            Self::Silu => {
                let s = before.logistic();
                g * &(&s + &(after * &one_less(&s)))
            }
        }
    }
}

impl Var {
    /// A multilayer perceptron: of `[.., in]` and for each layer a weight `[out, in]` and a bias `[out]` it makes
    /// `[.., out]`, with a function between the layers and none after the last.
    ///
    /// ```
    /// use gradreel::ops::Activation;
    /// use gradreel::{DType, Key, Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let points = tape.constant(Tensor::full(0.1, [1000, 3], DType::F32));
    /// let [w1, w2] = [[64, 3], [1, 64]].map(|shape| tape.leaf(Tensor::full(0.1, shape, DType::F32)));
    /// let [b1, b2] = [[64], [1]].map(|shape| tape.leaf(Tensor::zeros(shape, DType::F32)));
    /// let density = points.mlp(&[(&w1, &b1), (&w2, &b2)], Activation::Relu);
    /// assert_eq!(density.dims(), [1000, 1]);
    /// assert!((density.value()?.to_vec()?[0] - 64.0 * 0.1 * 0.03).abs() < 1e-6);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes or dtypes do not fit, or there is no layer.
    #[track_caller]
    #[must_use]
    pub fn mlp(&self, layers: &[(&Self, &Self)], hidden: Activation) -> Self {
        let batch = self.dims().split_last().map_or(&[][..], |(_, batch)| batch);
        let flat = if batch.len() == 1 {
            self.clone()
        } else {
            self.reshape([batch.iter().product(), self.dims().last().copied().unwrap_or(1)])
        };
        let mut inputs = vec![&flat];
        inputs.extend(layers.iter().flat_map(|(weight, bias)| [*weight, *bias]));
        let keep = inputs.iter().any(|x| x.is_differentiable());
        let rows = Self::run(Rc::new(Mlp { hidden, last: Activation::Identity, keep }), &inputs);
        let mut shape = batch.to_vec();
        shape.push(rows.dims()[1]);
        rows.reshape(shape)
    }
}
