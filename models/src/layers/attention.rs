//! Multi-head attention among tokens.

use gradreel::{Result, Var};

use super::{Linear, Scope};

/// Sizes of an attention layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AttentionSizes {
    /// Channels of the query tokens.
    pub channels: usize,
    /// Channels of the context tokens.
    pub context: usize,
    /// Number of heads, which divides the channels.
    pub heads: usize,
}

/// Scaled dot-product attention (Vaswani et al. 2017) with projections `to_q`, `to_k`, `to_v` (no bias) and `to_out.0`.
pub struct Attention {
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    sizes: AttentionSizes,
}

impl Attention {
    /// The layer at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: AttentionSizes) -> Result<Self> {
        let AttentionSizes { channels, context, .. } = sizes;
        Ok(Self {
            query: Linear::without_bias(&scope.at("to_q"), channels, channels)?,
            key: Linear::without_bias(&scope.at("to_k"), context, channels)?,
            value: Linear::without_bias(&scope.at("to_v"), context, channels)?,
            out: Linear::new(&scope.at("to_out.0"), channels, channels)?,
            sizes,
        })
    }

    /// Attention of `x [b, n, channels]` to `context [b, m, context]`: `[b, n, channels]`.
    ///
    /// With a single context token the softmax is 1 for any query, so that only the value path is evaluated.
    ///
    /// # Panics
    /// When the channels are not those of the layer.
    #[track_caller]
    pub fn forward(&self, x: &Var, context: &Var) -> Var {
        if context.dims()[1] == 1 {
            let [batch, tokens, _] = x.dims()[..] else { panic!("attention: tokens are [b, n, c], not {}", x.shape()) };
            return self.of_one(context).broadcast_to([batch, tokens, self.sizes.channels]);
        }
        let value = self.value.forward(context);
        let heads = self.sizes.heads;
        let [query, key] = [self.query.forward(x), self.key.forward(context)];
        let [query, key, value] = [query, key, value].map(|tokens| split_heads(&tokens, heads));
        let scale = ((self.sizes.channels / heads) as f64).powf(-0.5);
        self.out.forward(&merge_heads(&query.attention(&key, &value, scale, None)))
    }

    /// Attention of every token to a single context token `[b, 1, context]`, independent of the query:
    /// `[b, 1, channels]`.
    #[track_caller]
    pub(crate) fn of_one(&self, context: &Var) -> Var {
        self.out.forward(&self.value.forward(context))
    }
}

/// `[b, n, heads · d] → [b, heads, n, d]`
#[track_caller]
pub(crate) fn split_heads(tokens: &Var, heads: usize) -> Var {
    let [batch, count, channels] = tokens.dims()[..] else { panic!("tokens are [b, n, c], not {}", tokens.shape()) };
    tokens.reshape([batch, count, heads, channels / heads]).permute(&[0, 2, 1, 3])
}

/// `[b, heads, n, d] → [b, n, heads · d]`
#[track_caller]
pub(crate) fn merge_heads(x: &Var) -> Var {
    let [batch, heads, count, size] = x.dims()[..] else { panic!("heads are [b, h, n, d], not {}", x.shape()) };
    x.permute(&[0, 2, 1, 3]).reshape([batch, count, heads * size])
}
