//! `convolution_weights`: the weight of image and result. The gradient of a convolution in its weight.

use std::rc::Rc;

use super::forward::Convolution;
use super::transposed::TransposedConvolution;
use super::{Geometry, Links, WEIGHTS};
use crate::backend::cpu::convolution;
use crate::backend::gpu::{Gpu, Work};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Result, Spec, Tensor};

pub(in crate::ops) const ENTRY: Entry = Entry {
    name: "convolution_weights",
    gpu: true,
    cases: || {
        super::cases(|links, [x, weight, y], _| {
            let inputs = [uniform(1, x, -1.0..1.0), uniform(2, y, -1.0..1.0)];
            Case::new(ConvolutionWeights { links, size: weight[2..].to_vec() }, inputs)
        })
    },
};

/// Operands: image `[batch, groups · inputs, …]` and what a convolution made of it, `[batch, groups · outputs, …]`.
#[derive(Debug)]
pub(crate) struct ConvolutionWeights {
    pub(crate) links: Links,
    /// Size of the kernel along each axis.
    pub(crate) size: Vec<usize>,
}

impl ConvolutionWeights {
    fn geometry(&self, inputs: &[Spec]) -> Result<(Geometry, Spec)> {
        let [x, y] = Spec::exactly(self.name(), inputs)?;
        let channels = |spec: &Spec| spec.shape.dims().get(1).copied().unwrap_or(0);
        let dims = [&[channels(y), channels(x) / self.links.groups.max(1)], self.size.as_slice()].concat();
        let weight = Spec::new(dims, x.dtype);
        Ok((self.links.fit(self.name(), x, &weight, y)?, weight))
    }
}

impl Op for ConvolutionWeights {
    fn name(&self) -> &'static str {
        "convolution_weights"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        Ok(self.geometry(inputs)?.1)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let (geometry, weight) = self.geometry(&[inputs[0].spec(), inputs[1].spec()])?;
        for_real!(weight.dtype, T => {
            let values = convolution::weights::<T>(&geometry, inputs[0].slice(), inputs[1].slice());
            Ok(Tensor::from_vec(values, weight.shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let (geometry, weight) = self.geometry(&[inputs[0].spec(), inputs[1].spec()])?;
        let tile = WEIGHTS.reflect()?.constant("TILE");
        let columns = geometry.inputs * geometry.volumes()[2];
        let tiles = Work::Groups(geometry.groups * geometry.outputs.div_ceil(tile) * columns.div_ceil(tile));
        let operands = [&inputs[0], &inputs[1]];
        Ok(gpu.launch(&WEIGHTS, &operands, &geometry.words(false), weight, tiles)?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        Reads::nothing().input_if(0, wanted[1]).input_if(1, wanted[0])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (x, y, g) = (cx.input(0), cx.input(1), cx.gradient());
        Ok(vec![
            cx.wants(0).then(|| {
                Var::run(Rc::new(TransposedConvolution { links: self.links, size: x.dims()[2..].to_vec() }), &[y, g])
            }),
            cx.wants(1)
                .then(|| Var::run(Rc::new(Convolution { links: self.links, size: y.dims()[2..].to_vec() }), &[x, g])),
        ])
    }
}
