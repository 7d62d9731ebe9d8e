//! Depth-wise attention: every pixel attends to the depth samples behind it in a frustum volume.

use std::cell::RefCell;

use gradreel::{Result, Var};

use super::{Convolution, GroupNorm, Kernel, Scope};

const HEADS: usize = 4;

/// Sizes of a depth-wise attention block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DepthAttentionSizes {
    /// Channels of the image.
    pub channels: usize,
    /// Channels of each of the four heads.
    pub head: usize,
    /// Channels of the frustum volume.
    pub context: usize,
}

/// Depth-wise attention with projections and an outer residual (Liu et al. 2023): a softmax over the depth bins at each
/// pixel and head. It is initialised to the identity.
pub struct DepthAttention {
    proj_in: (Convolution, GroupNorm),
    proj_context: (Convolution, GroupNorm),
    query: Convolution,
    key: Convolution,
    value: Convolution,
    out: Convolution,
    proj_out: [(GroupNorm, Convolution); 2],
    head: usize,
    /// Cached output for a missing volume, for weights without gradient.
    nothing: RefCell<Option<Var>>,
}

impl DepthAttention {
    /// The block at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: DepthAttentionSizes) -> Result<Self> {
        let DepthAttentionSizes { channels, head, context } = sizes;
        let inner = HEADS * head;
        let conv = |name, kernel: Kernel| Convolution::new(&scope.at(name), kernel);
        let norm = |name, channels| GroupNorm::new(&scope.at(name), 8, channels, 1e-5);
        let into = Kernel::volume(context, inner, 1).without_bias();
        let same = Kernel::image(inner, inner, 1).without_bias();
        let to_inner = Kernel::image(inner, inner, 3).without_bias();
        let to_image = Kernel::image(inner, channels, 3).without_bias().zeros();
        Ok(Self {
            proj_in: (conv("proj_in.0", Kernel::image(channels, inner, 1))?, norm("proj_in.1", inner)?),
            proj_context: (
                conv("proj_context.0", Kernel::volume(context, context, 1).without_bias())?,
                norm("proj_context.1", context)?,
            ),
            query: conv("depth_attn.to_q", same)?,
            key: conv("depth_attn.to_k", into)?,
            value: conv("depth_attn.to_v", into)?,
            out: conv("depth_attn.to_out", same)?,
            proj_out: [
                (norm("proj_out.0", inner)?, conv("proj_out.2", to_inner)?),
                (norm("proj_out.3", inner)?, conv("proj_out.5", to_image)?),
            ],
            head,
            nothing: RefCell::default(),
        })
    }

    /// Maps `x [b, channels, h, w]` and the volume `[b, context, d, h, w]` to `[b, channels, h, w]`. A missing volume
    /// counts as zeros: the added term then depends on the weights and the size only, and is cached while the weights
    /// have no gradient.
    ///
    /// # Panics
    /// When the sizes are not those of the block.
    #[track_caller]
    pub fn forward(&self, x: &Var, volume: Option<&Var>) -> Var {
        match volume {
            Some(volume) => x + &self.project_out(&self.gather(x, volume)),
            None => x + &self.nothing(x),
        }
    }

    #[track_caller]
    fn project_out(&self, gathered: &Var) -> Var {
        let mut h = self.out.forward(gathered);
        for (norm, conv) in &self.proj_out {
            h = conv.forward(&norm.forward(&h).relu());
        }
        h
    }

    /// The term that a volume of zeros adds to images like `x`: `[1, channels, h, w]`.
    #[track_caller]
    fn nothing(&self, x: &Var) -> Var {
        let mut kept = self.nothing.borrow_mut();
        let fits =
            |made: &&Var| made.dims()[2..] == x.dims()[2..] && made.dtype() == x.dtype() && made.device() == x.device();
        if let Some(made) = kept.as_ref().filter(fits) {
            return made.clone();
        }
        let made = self.project_out(&self.gather_nothing(x));
        // values on a tape with an error are invalid
        if !made.is_differentiable() && made.value().is_ok() {
            *kept = Some(made.clone());
        }
        made
    }

    /// The attention output of the pixels: `[b, inner, h, w]`.
    #[track_caller]
    fn gather(&self, x: &Var, volume: &Var) -> Var {
        let a = self.proj_in.1.silu(&self.proj_in.0.forward(x));
        let context = self.proj_context.1.forward(&self.proj_context.0.forward(volume)).relu();
        let &[batch, channels, depth, height, width] = context.dims() else {
            panic!("volumes are [b, c, d, h, w], not {}", context.shape())
        };
        // q · (K c) = (Kᵀ q) · c and Σ w (V c) = V (Σ w c) avoid keys and values of the many depth samples
        let [key, value] = [&self.key, &self.value].map(|conv| conv.matrices(self.head, x));
        let query = self.query.forward(&a).reshape([batch, HEADS, self.head, height * width]);
        let asked = key.transposed_matmul(&query).reshape([batch, HEADS, channels, height, width]);
        let context = context.reshape([batch, 1, channels, depth, height, width]);
        let found = asked.depth_attention(&context, &context, (self.head as f64).powf(-0.5));
        value.matmul(&found.reshape([batch, HEADS, channels, height * width])).reshape(a.shape())
    }

    /// The attention output for a volume of zeros. All depth bins are equal, so that the softmax is uniform for any
    /// query: one vector for all pixels, `[1, inner, h, w]`.
    #[track_caller]
    fn gather_nothing(&self, x: &Var) -> Var {
        let alike = self.proj_context.1.shift().to_dtype(x.dtype()).relu();
        let channels = alike.len();
        let found = self.value.forward(&alike.reshape([1, channels, 1, 1, 1]));
        let inner = found.len();
        found.reshape([1, inner, 1, 1]).broadcast_to([1, inner, x.dims()[2], x.dims()[3]])
    }
}
