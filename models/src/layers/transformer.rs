//! The spatial transformer: pixels as tokens that attend to each other and to a context.

use gradreel::{Result, Var};

use super::{Attention, AttentionSizes, Convolution, GroupNorm, Kernel, LayerNorm, Linear, Scope};

/// Sizes of a spatial transformer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransformerSizes {
    /// Channels of the image.
    pub channels: usize,
    /// Number of heads, which divides the channels.
    pub heads: usize,
    /// Channels of the context tokens.
    pub context: usize,
}

/// Self-attention, cross-attention and a gated feed-forward layer over the pixels of an image, with an outer residual
/// (Rombach et al. 2022).
pub struct SpatialTransformer {
    norm: GroupNorm,
    proj_in: Convolution,
    block: Block,
    proj_out: Convolution,
}

impl SpatialTransformer {
    /// The layer at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: TransformerSizes) -> Result<Self> {
        let pointwise = Kernel::image(sizes.channels, sizes.channels, 1);
        Ok(Self {
            norm: GroupNorm::new(&scope.at("norm"), 32, sizes.channels, 1e-6)?,
            proj_in: Convolution::new(&scope.at("proj_in"), pointwise)?,
            block: Block::new(&scope.at("transformer_blocks.0"), sizes)?,
            proj_out: Convolution::new(&scope.at("proj_out"), pointwise.zeros())?,
        })
    }

    /// Maps `x [b, channels, h, w]` and `context [b, m, context]` to `[b, channels, h, w]`.
    ///
    /// # Panics
    /// When the channels are not those of the layer.
    #[track_caller]
    pub fn forward(&self, x: &Var, context: &Var) -> Var {
        let [batch, channels, height, width] = x.dims()[..] else {
            panic!("spatial transformer: images are [b, c, h, w], not {}", x.shape())
        };
        let h = self.proj_in.forward(&self.norm.forward(x));
        let tokens = h.reshape([batch, channels, height * width]).permute(&[0, 2, 1]);
        let tokens = self.block.forward(&tokens, context);
        let h = tokens.permute(&[0, 2, 1]).reshape([batch, channels, height, width]);
        x + &self.proj_out.forward(&h)
    }
}

struct Block {
    norms: [LayerNorm; 3],
    own: Attention,
    cross: Attention,
    gate: Linear,
    out: Linear,
}

impl Block {
    fn new(scope: &Scope<'_>, TransformerSizes { channels, heads, context }: TransformerSizes) -> Result<Self> {
        let norm = |name| LayerNorm::new(&scope.at(name), channels);
        Ok(Self {
            norms: [norm("norm1")?, norm("norm2")?, norm("norm3")?],
            own: Attention::new(&scope.at("attn1"), AttentionSizes { channels, context: channels, heads })?,
            cross: Attention::new(&scope.at("attn2"), AttentionSizes { channels, context, heads })?,
            gate: Linear::new(&scope.at("ff.net.0.proj"), channels, 8 * channels)?,
            out: Linear::new(&scope.at("ff.net.2"), 4 * channels, channels)?,
        })
    }

    fn forward(&self, tokens: &Var, context: &Var) -> Var {
        let x = self.norms[0].forward(tokens);
        let tokens = &self.own.forward(&x, &x) + tokens;
        let tokens = match context.dims()[1] {
            1 => &self.cross.of_one(context) + &tokens,
            _ => &self.cross.forward(&self.norms[1].forward(&tokens), context) + &tokens,
        };
        let both = self.gate.forward(&self.norms[2].forward(&tokens));
        let half = both.dims()[2] / 2;
        let gated = &both.slice(2, 0..half) * &both.slice(2, half..2 * half).gelu();
        &self.out.forward(&gated) + &tokens
    }
}
