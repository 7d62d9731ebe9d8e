//! The CLIP vision tower (Radford et al. 2021): maps an image to one embedding.

use gradreel::{Result, Tensor, Var};
use serde::{Deserialize, Serialize};

use crate::layers::{Convolution, Init, Kernel, LayerNorm, Linear, Scope, merge_heads, split_heads};

/// The sizes of the tower.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipSizes {
    /// Pixels along a side of the image.
    pub resolution: usize,
    /// Pixels along a side of a patch.
    pub patch: usize,
    /// Channels of a token.
    pub width: usize,
    /// Number of transformer blocks.
    pub layers: usize,
    /// Heads of each block.
    pub heads: usize,
    /// Channels of the embedding.
    pub outputs: usize,
}

impl ClipSizes {
    /// ViT-L/14.
    pub const PUBLISHED: Self = Self { resolution: 224, patch: 14, width: 1024, layers: 24, heads: 16, outputs: 768 };
}

/// The tower.
pub struct ClipTower {
    patches: Convolution,
    class: Var,
    places: Var,
    norm_in: LayerNorm,
    blocks: Vec<Block>,
    norm_out: LayerNorm,
    projection: Var,
    sizes: ClipSizes,
}

struct Block {
    norms: [LayerNorm; 2],
    packed: Linear,
    out: Linear,
    wide: Linear,
    narrow: Linear,
    heads: usize,
}

/// Mean and standard deviation per colour channel of CLIP's training images.
const COLOURS: [[f64; 3]; 2] = [[0.481_454_66, 0.457_827_5, 0.408_210_73], [0.268_629_54, 0.261_302_58, 0.275_777_11]];

impl ClipTower {
    /// Builds the tower from the weights at a scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: ClipSizes) -> Result<Self> {
        let ClipSizes { resolution, patch, width, layers, outputs, .. } = sizes;
        let tokens = (resolution / patch).pow(2) + 1;
        let patches = Kernel::image(3, width, patch).stride(patch).padding(0).without_bias();
        let spread = Init::Normal((width as f64).powf(-0.5));
        let block = |i| Block::new(&scope.at(format_args!("transformer.resblocks.{i}")), sizes);
        Ok(Self {
            patches: Convolution::new(&scope.at("conv1"), patches)?,
            class: scope.weight("class_embedding", [width], spread)?,
            places: scope.weight("positional_embedding", [tokens, width], spread)?,
            norm_in: LayerNorm::new(&scope.at("ln_pre"), width)?,
            blocks: (0..layers).map(block).collect::<Result<_>>()?,
            norm_out: LayerNorm::new(&scope.at("ln_post"), width)?,
            projection: scope.weight("proj", [width, outputs], spread)?,
            sizes,
        })
    }

    /// Normalises images `[b, 3, resolution, resolution]` in −1..1 for the tower.
    ///
    /// # Errors
    /// If the colours cannot be cast to the dtype of the images.
    pub fn normalise(images: &Var) -> Result<Var> {
        let [mean, deviation] =
            COLOURS.map(|values| super::constant(images, Tensor::from_vec(values.to_vec(), [1, 3, 1, 1])));
        let in_unit_range = &(images + 1.0) * 0.5;
        Ok(&(&in_unit_range - &mean?) / &deviation?)
    }

    /// Normalised images `[b, 3, resolution, resolution]` to embeddings `[b, outputs]`.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the tower.
    #[track_caller]
    pub fn forward(&self, images: &Var) -> Var {
        let batch = images.dims()[0];
        let width = self.sizes.width;
        let patches = self.patches.forward(images).reshape([batch, width, self.places.dims()[0] - 1]);
        let class = self.class.to_dtype(images.dtype()).reshape([1, 1, width]).broadcast_to([batch, 1, width]);
        let tokens = &class.concat(&[&patches.permute(&[0, 2, 1])], 1) + &self.places.to_dtype(images.dtype());
        let mut tokens = self.norm_in.forward(&tokens);
        for block in &self.blocks {
            tokens = block.forward(&tokens);
        }
        let first = tokens.slice(1, 0..1).reshape([batch, width]);
        self.norm_out.forward(&first).matmul(&self.projection.to_dtype(images.dtype()))
    }
}

impl Block {
    fn new(scope: &Scope<'_>, ClipSizes { width, heads, .. }: ClipSizes) -> Result<Self> {
        // packed projection, stored as in PyTorch's attention module under names without a dot
        let packed = Linear::named(&scope.at("attn"), ["in_proj_weight", "in_proj_bias"], width, 3 * width)?;
        Ok(Self {
            norms: [LayerNorm::new(&scope.at("ln_1"), width)?, LayerNorm::new(&scope.at("ln_2"), width)?],
            packed,
            out: Linear::new(&scope.at("attn.out_proj"), width, width)?,
            wide: Linear::new(&scope.at("mlp.c_fc"), width, 4 * width)?,
            narrow: Linear::new(&scope.at("mlp.c_proj"), 4 * width, width)?,
            heads,
        })
    }

    fn forward(&self, tokens: &Var) -> Var {
        let width = tokens.dims()[2];
        let packed = self.packed.forward(&self.norms[0].forward(tokens));
        let part = |i: usize| split_heads(&packed.slice(2, i * width..(i + 1) * width), self.heads);
        let scale = ((width / self.heads) as f64).powf(-0.5);
        let gathered = part(0).attention(&part(1), &part(2), scale, None);
        let tokens = tokens + &self.out.forward(&merge_heads(&gathered));
        let wide = self.wide.forward(&self.norms[1].forward(&tokens)).gelu_sigmoid();
        &tokens + &self.narrow.forward(&wide)
    }
}
