//! The residual block of the diffusion UNet.

use gradreel::{Result, Var};

use super::{Convolution, GroupNorm, Kernel, Linear, Scope};

/// Two `GN(32) → SiLU → 3×3` stages with the time vector added in between, and a skip connection, which is a 1×1
/// convolution if the widths differ (Dhariwal and Nichol 2021).
pub struct ResidualBlock {
    norm_in: GroupNorm,
    conv_in: Convolution,
    embedding: Linear,
    norm_out: GroupNorm,
    conv_out: Convolution,
    skip: Option<Convolution>,
}

impl ResidualBlock {
    /// The block at a scope: `inputs` channels to `outputs`, a time vector of `embedding` channels.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, inputs: usize, outputs: usize, embedding: usize) -> Result<Self> {
        let skip = || Convolution::new(&scope.at("skip_connection"), Kernel::image(inputs, outputs, 1));
        Ok(Self {
            norm_in: GroupNorm::new(&scope.at("in_layers.0"), 32, inputs, 1e-5)?,
            conv_in: Convolution::new(&scope.at("in_layers.2"), Kernel::image(inputs, outputs, 3))?,
            embedding: Linear::new(&scope.at("emb_layers.1"), embedding, outputs)?,
            norm_out: GroupNorm::new(&scope.at("out_layers.0"), 32, outputs, 1e-5)?,
            conv_out: Convolution::new(&scope.at("out_layers.3"), Kernel::image(outputs, outputs, 3).zeros())?,
            skip: (inputs != outputs).then(skip).transpose()?,
        })
    }

    /// Maps `x [b, inputs, h, w]` and the time vector `[b, embedding]` to `[b, outputs, h, w]`.
    ///
    /// # Panics
    /// When the channels are not those of the block.
    #[track_caller]
    pub fn forward(&self, x: &Var, embedding: &Var) -> Var {
        let h = self.conv_in.forward(&self.norm_in.silu(x));
        let h = &h + &per_channel(&self.embedding.forward(&embedding.silu()), 2);
        let h = self.conv_out.forward(&self.norm_out.silu(&h));
        match &self.skip {
            Some(skip) => &skip.forward(x) + &h,
            None => x + &h,
        }
    }
}

/// Appends axes of length 1: `[b, c] → [b, c, 1, ..]`.
#[track_caller]
pub(crate) fn per_channel(vectors: &Var, axes: usize) -> Var {
    let mut shape = vectors.dims().to_vec();
    shape.extend(vec![1; axes]);
    vectors.reshape(shape)
}
