//! Convolutions in two and three dimensions.

use gradreel::ops::Conv;
use gradreel::{Result, Var};

use super::{Init, Scope};

/// Sizes of a convolution. [`Kernel::image`] and [`Kernel::volume`] start with stride 1 and the padding that preserves
/// the size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kernel {
    axes: usize,
    inputs: usize,
    outputs: usize,
    size: usize,
    stride: usize,
    padding: usize,
    bias: bool,
    zeros: bool,
}

impl Kernel {
    /// A square kernel on images.
    pub const fn image(inputs: usize, outputs: usize, size: usize) -> Self {
        Self { axes: 2, inputs, outputs, size, stride: 1, padding: size / 2, bias: true, zeros: false }
    }

    /// A cubic kernel on volumes.
    pub const fn volume(inputs: usize, outputs: usize, size: usize) -> Self {
        Self { axes: 3, ..Self::image(inputs, outputs, size) }
    }

    /// Sets the stride of all axes.
    #[must_use]
    pub const fn stride(self, stride: usize) -> Self {
        Self { stride, ..self }
    }

    /// Sets the zero padding at both ends of all axes.
    #[must_use]
    pub const fn padding(self, padding: usize) -> Self {
        Self { padding, ..self }
    }

    /// Removes the bias.
    #[must_use]
    pub const fn without_bias(self) -> Self {
        Self { bias: false, ..self }
    }

    /// Initialises the weights to zero when there are none to load.
    #[must_use]
    pub const fn zeros(self) -> Self {
        Self { zeros: true, ..self }
    }
}

/// A convolution, or a transposed one that doubles the size. Weights `weight [outputs, inputs, k, ..]` (transposed:
/// `[inputs, outputs, k, ..]`) and `bias [outputs]`.
pub struct Convolution {
    weight: Var,
    bias: Option<Var>,
    conv: Conv,
    transposed: bool,
}

impl Convolution {
    /// The layer at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, kernel: Kernel) -> Result<Self> {
        Self::build(scope, kernel, None)
    }

    /// The transposed convolution with kernel 3, stride 2, padding 1 and output padding 1, which doubles every axis.
    ///
    /// # Errors
    /// As [`Convolution::new`].
    pub fn doubling(scope: &Scope<'_>, kernel: Kernel) -> Result<Self> {
        Self::build(scope, kernel.stride(2).padding(1), Some(1))
    }

    /// The transposed convolution of a kernel: with size and stride 2 and no padding, every place becomes a square of 2×2.
    ///
    /// # Errors
    /// As [`Convolution::new`].
    pub fn transposed(scope: &Scope<'_>, kernel: Kernel) -> Result<Self> {
        Self::build(scope, kernel, Some(0))
    }

    /// A convolution, or a transposed one with so much padding of its output.
    fn build(scope: &Scope<'_>, k: Kernel, output_padding: Option<usize>) -> Result<Self> {
        let transposed = output_padding.is_some();
        let mut shape = if transposed { vec![k.inputs, k.outputs] } else { vec![k.outputs, k.inputs] };
        shape.extend(vec![k.size; k.axes]);
        let init = if k.zeros { Init::Zeros } else { Init::FanIn(shape[1..].iter().product()) };
        let weight = scope.weight("weight", shape, init)?;
        let bias = if k.bias { Some(scope.weight("bias", [k.outputs], init)?) } else { None };
        let conv = Conv::new().stride(k.stride).padding(k.padding);
        let conv = output_padding.map_or(conv.clone(), |padding| conv.output_padding(padding));
        Ok(Self { weight, bias, conv, transposed })
    }

    /// The weight of a pointwise convolution as matrices of `rows` rows each, `[outputs / rows, rows, inputs]`, for
    /// products with `x`.
    #[track_caller]
    pub(crate) fn matrices(&self, rows: usize, x: &Var) -> Var {
        let [outputs, inputs] = [self.weight.dims()[0], self.weight.dims()[1]];
        let weight = self.weight.to_dtype(x.dtype()).reshape([outputs / rows, rows, inputs]);
        match weight.value() {
            // a constant may belong to another tape; move it to that of `x`
            Ok(value) if !weight.is_differentiable() => x.tape().constant(value.clone()),
            _ => weight,
        }
    }

    /// Applies the layer.
    ///
    /// # Panics
    /// When the channels are not those of the layer, or the kernel does not fit.
    #[track_caller]
    pub fn forward(&self, x: &Var) -> Var {
        let weight = self.weight.to_dtype(x.dtype());
        let bias = self.bias.as_ref().map(|bias| bias.to_dtype(x.dtype()));
        match self.transposed {
            false => x.conv(&weight, bias.as_ref(), &self.conv),
            true => x.conv_transpose(&weight, bias.as_ref(), &self.conv),
        }
    }
}
