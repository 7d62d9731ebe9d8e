//! `transposed_convolution`: the image of result and weight, plus a bias. The gradient of a convolution in its image.

use std::rc::Rc;

use super::forward::Convolution;
use super::weights::ConvolutionWeights;
use super::{Geometry, Links, TRANSPOSED};
use crate::backend::cpu::convolution;
use crate::backend::gpu::{Gpu, Work};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Result, Spec, Tensor};

pub(in crate::ops) const ENTRY: Entry = Entry {
    name: "transposed_convolution",
    gpu: true,
    cases: || {
        super::cases(|links, [x, weight, y], bias| {
            let mut inputs = vec![uniform(1, y, -1.0..1.0), uniform(2, weight, -1.0..1.0)];
            inputs.extend(bias.then(|| uniform(3, [x[1]], -1.0..1.0)));
            Case::new(TransposedConvolution { links, size: x[2..].to_vec() }, inputs)
        })
    },
};

/// Operands: what a convolution made, `[batch, groups · outputs, …]`, its weight `[groups · outputs, inputs, …]` and perhaps a
/// bias of `groups · inputs`.
#[derive(Debug)]
pub(crate) struct TransposedConvolution {
    pub(crate) links: Links,
    /// Places of the image along each axis.
    pub(crate) size: Vec<usize>,
}

impl TransposedConvolution {
    fn geometry(&self, inputs: &[Spec]) -> Result<(Geometry, Spec)> {
        let inputs = Spec::between(self.name(), inputs, 2..=3)?;
        let (y, weight) = (&inputs[0], &inputs[1]);
        let batch = y.shape.dims().first().copied().unwrap_or(0);
        let channels = weight.shape.dims().get(1).map_or(0, |inputs| inputs * self.links.groups);
        let dims = [&[batch, channels], self.size.as_slice()].concat();
        let x = Spec::new(dims, y.dtype);
        let geometry = self.links.fit(self.name(), &x, weight, y)?;
        super::check_bias(self.name(), inputs.get(2), &x)?;
        Ok((geometry, x))
    }
}

impl Op for TransposedConvolution {
    fn name(&self) -> &'static str {
        "transposed_convolution"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        Ok(self.geometry(inputs)?.1)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let specs: Vec<_> = inputs.iter().map(Tensor::spec).collect();
        let (geometry, x) = self.geometry(&specs)?;
        for_real!(x.dtype, T => {
            let bias = inputs.get(2).map(Tensor::slice::<T>);
            let values = convolution::transposed::<T>(&geometry, inputs[0].slice(), inputs[1].slice(), bias);
            Ok(Tensor::from_vec(values, x.shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let specs: Vec<_> = inputs.iter().map(Tensor::spec).collect();
        let (geometry, x) = self.geometry(&specs)?;
        let bias = inputs.get(2);
        let tile = TRANSPOSED.reflect()?.constant("TILE");
        let image = gpu.empty(x)?;
        let [depth, height, width] = [0, 1, 2].map(|axis| geometry.phases(axis));
        let (height, width) = (&height, &width);
        for (d, h, w) in
            depth.iter().flat_map(|d| height.iter().flat_map(move |h| width.iter().map(move |w| (d, h, w))))
        {
            let columns = geometry.batch * d.count * h.count * w.count;
            let tiles = Work::Groups(geometry.groups * geometry.inputs.div_ceil(tile) * columns.div_ceil(tile));
            let buffers = [&image, &inputs[0], &inputs[1], bias.unwrap_or(&inputs[1])];
            gpu.dispatch(&TRANSPOSED, &buffers, &geometry.words_of([d, h, w], bias.is_some()), tiles)?;
        }
        Ok(image.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        Reads::nothing().input_if(0, wanted[1]).input_if(1, wanted[0])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (y, weight, g) = (cx.input(0), cx.input(1), cx.gradient());
        let mut slopes = vec![
            cx.wants(0).then(|| {
                Var::run(Rc::new(Convolution { links: self.links, size: y.dims()[2..].to_vec() }), &[g, weight])
            }),
            cx.wants(1).then(|| {
                Var::run(Rc::new(ConvolutionWeights { links: self.links, size: weight.dims()[2..].to_vec() }), &[g, y])
            }),
        ];
        if cx.inputs().len() > 2 {
            slopes.push(cx.wants(2).then(|| super::channel_sums(g)));
        }
        Ok(slopes)
    }
}
