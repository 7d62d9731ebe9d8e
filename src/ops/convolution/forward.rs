//! `convolution`: the result of image and weight, plus a bias.

use std::rc::Rc;

use super::transposed::TransposedConvolution;
use super::weights::ConvolutionWeights;
use super::{FORWARD, Geometry, Links};
use crate::backend::cpu::convolution;
use crate::backend::gpu::{Gpu, Work};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Result, Spec, Tensor};

pub(in crate::ops) const ENTRY: Entry = Entry {
    name: "convolution",
    gpu: true,
    cases: || {
        super::cases(|links, [x, weight, y], bias| {
            let mut inputs = vec![uniform(1, x, -1.0..1.0), uniform(2, weight, -1.0..1.0)];
            inputs.extend(bias.then(|| uniform(3, [y[1]], -1.0..1.0)));
            Case::new(Convolution { links, size: y[2..].to_vec() }, inputs)
        })
    },
};

/// Operands: image `[batch, groups · inputs, …]`, weight `[groups · outputs, inputs, …]` and perhaps a bias of
/// `groups · outputs`.
#[derive(Debug)]
pub(crate) struct Convolution {
    pub(crate) links: Links,
    /// Places of the result along each axis: at most as many as fit.
    pub(crate) size: Vec<usize>,
}

impl Convolution {
    fn geometry(&self, inputs: &[Spec]) -> Result<(Geometry, Spec)> {
        let inputs = Spec::between(self.name(), inputs, 2..=3)?;
        let (x, weight) = (&inputs[0], &inputs[1]);
        let batch = x.shape.dims().first().copied().unwrap_or(0);
        let outputs = weight.shape.dims().first().copied().unwrap_or(0);
        let dims = [&[batch, outputs], self.size.as_slice()].concat();
        let y = Spec::new(dims, x.dtype);
        let geometry = self.links.fit(self.name(), x, weight, &y)?;
        super::check_bias(self.name(), inputs.get(2), &y)?;
        Ok((geometry, y))
    }
}

impl Op for Convolution {
    fn name(&self) -> &'static str {
        "convolution"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        Ok(self.geometry(inputs)?.1)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let specs: Vec<_> = inputs.iter().map(Tensor::spec).collect();
        let (geometry, y) = self.geometry(&specs)?;
        for_real!(y.dtype, T => {
            let bias = inputs.get(2).map(Tensor::slice::<T>);
            let values = convolution::forward::<T>(&geometry, inputs[0].slice(), inputs[1].slice(), bias);
            Ok(Tensor::from_vec(values, y.shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let specs: Vec<_> = inputs.iter().map(Tensor::spec).collect();
        let (geometry, y) = self.geometry(&specs)?;
        let bias = inputs.get(2);
        let tile = FORWARD.reflect()?.constant("TILE");
        let columns = geometry.batch * geometry.volumes()[1];
        let tiles = Work::Groups(geometry.groups * geometry.outputs.div_ceil(tile) * columns.div_ceil(tile));
        let operands = [&inputs[0], &inputs[1], bias.unwrap_or(&inputs[1])];
        Ok(gpu.launch(&FORWARD, &operands, &geometry.words(bias.is_some()), y, tiles)?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        Reads::nothing().input_if(0, wanted[1]).input_if(1, wanted[0])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (x, weight, g) = (cx.input(0), cx.input(1), cx.gradient());
        let mut slopes = vec![
            cx.wants(0).then(|| {
                Var::run(
                    Rc::new(TransposedConvolution { links: self.links, size: x.dims()[2..].to_vec() }),
                    &[g, weight],
                )
            }),
            cx.wants(1).then(|| {
                Var::run(Rc::new(ConvolutionWeights { links: self.links, size: weight.dims()[2..].to_vec() }), &[x, g])
            }),
        ];
        if cx.inputs().len() > 2 {
            slopes.push(cx.wants(2).then(|| super::channel_sums(g)));
        }
        Ok(slopes)
    }
}
