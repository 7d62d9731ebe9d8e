//! The UNet of the denoiser, with spatial transformers and depth-wise attention.

use gradreel::{Result, Var};
use serde::{Deserialize, Serialize};

use crate::layers::{
    Convolution, DepthAttention, DepthAttentionSizes, Downsample, GroupNorm, Kernel, ResidualBlock, Scope, Segment,
    SpatialTransformer, TimeEmbedding, TransformerSizes, Upsample,
};

/// Sizes of the UNet. Its four levels have `base · multipliers[i]` channels; all but the deepest have spatial
/// transformers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnetSizes {
    /// Channels of the input: noised latent and input-image latent.
    pub inputs: usize,
    /// Channels of the output.
    pub outputs: usize,
    /// Channels of the first level before its multiplier.
    pub base: usize,
    /// Channels of each level in units of `base`.
    pub multipliers: [usize; 4],
    /// Heads of the spatial transformers.
    pub heads: usize,
    /// Channels of the context token.
    pub context: usize,
    /// Channels of the frustum volumes, finest first.
    pub volumes: [usize; 4],
}

impl UnetSizes {
    /// The published model.
    pub const PUBLISHED: Self = Self {
        inputs: 8,
        outputs: 4,
        base: 320,
        multipliers: [1, 2, 4, 4],
        heads: 8,
        context: 768,
        volumes: [64, 128, 256, 512],
    };

    fn channels(&self, level: usize) -> usize {
        self.base * self.multipliers[level]
    }

    fn transformer(&self, scope: &Scope<'_>, level: usize) -> Result<SpatialTransformer> {
        let (channels, heads, context) = (self.channels(level), self.heads, self.context);
        SpatialTransformer::new(scope, TransformerSizes { channels, heads, context })
    }

    /// A residual block from `channels` channels to those of a level, followed by the level's transformer.
    fn stage(self, scope: &Scope<'_>, level: usize, channels: usize) -> Result<Segment<Stage>> {
        Segment::new(scope, move |scope| {
            Ok(Stage {
                residual: ResidualBlock::new(&scope.at(0), channels, self.channels(level), 4 * self.base)?,
                transformer: (level < 3).then(|| self.transformer(&scope.at(1), level)).transpose()?,
            })
        })
    }

    fn middle(self, scope: &Scope<'_>) -> Result<Segment<Middle>> {
        let channels = self.channels(3);
        Segment::new(scope, move |scope| {
            let block = |name: usize| ResidualBlock::new(&scope.at(name), channels, channels, 4 * self.base);
            Ok(Middle(block(0)?, self.transformer(&scope.at(1), 3)?, block(2)?))
        })
    }

    /// The block after a stage of `channels` channels, which attends to the volume of a level. A head is half as
    /// wide as the volume.
    fn depth_attention(&self, scope: &Scope<'_>, channels: usize, level: usize) -> Result<Segment<DepthAttention>> {
        let context = self.volumes[level];
        let sizes = DepthAttentionSizes { channels, head: context / 2, context };
        Segment::new(scope, move |scope| DepthAttention::new(scope, sizes))
    }
}

/// A numbered block of the encoder.
enum Down {
    First(Convolution),
    Stage(Box<Segment<Stage>>),
    Half(Downsample),
}

/// A numbered block of the decoder, followed by depth-wise attention.
struct Up {
    stage: Segment<Stage>,
    twice: Option<Upsample>,
    depth: Option<(Segment<DepthAttention>, usize)>,
}

struct Stage {
    residual: ResidualBlock,
    transformer: Option<SpatialTransformer>,
}

impl Stage {
    fn forward(&self, x: &Var, time: &Var, context: &Var) -> Var {
        let h = self.residual.forward(x, time);
        self.transformer.as_ref().map_or_else(|| h.clone(), |transformer| transformer.forward(&h, context))
    }
}

struct Middle(ResidualBlock, SpatialTransformer, ResidualBlock);

/// Depth-wise attention to the volume of a level, if there are volumes.
fn attend(depth: &Segment<DepthAttention>, x: &Var, volume: Option<&Var>) -> Result<Var> {
    match volume {
        Some(volume) => depth.run(&[x, volume], |depth, inputs| depth.forward(&inputs[0], Some(&inputs[1]))),
        None => depth.run(&[x], |depth, inputs| depth.forward(&inputs[0], None)),
    }
}

/// The noise predictor ε(x, t, token, volumes).
pub struct Unet {
    time: TimeEmbedding,
    down: Vec<Down>,
    middle: Segment<Middle>,
    middle_depth: Segment<DepthAttention>,
    up: Vec<Up>,
    norm: GroupNorm,
    out: Convolution,
}

impl Unet {
    /// Builds the network from the weights at a scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: &UnetSizes) -> Result<Self> {
        let embedding = 4 * sizes.base;
        let mut down = Vec::new();
        let mut skips = vec![sizes.base];
        let mut channels = sizes.base;
        let into = Kernel::image(sizes.inputs, channels, 3);
        down.push(Down::First(Convolution::new(&scope.at("input_blocks.0.0"), into)?));
        for level in 0..4 {
            for _ in 0..2 {
                let scope = scope.at(format_args!("input_blocks.{}", down.len()));
                down.push(Down::Stage(Box::new(sizes.stage(&scope, level, channels)?)));
                channels = sizes.channels(level);
                skips.push(channels);
            }
            if level < 3 {
                let scope = scope.at(format_args!("input_blocks.{}.0", down.len()));
                down.push(Down::Half(Downsample::new(&scope, channels)?));
                skips.push(channels);
            }
        }
        let middle = sizes.middle(&scope.at("middle_block"))?;
        let middle_depth = sizes.depth_attention(&scope.at("middle_conditions"), channels, 3)?;
        let mut up = Vec::new();
        for level in (0..4).rev() {
            for turn in 0..3 {
                let number = up.len();
                let block = scope.at(format_args!("output_blocks.{number}"));
                let skip = skips.pop().expect("as many blocks up as down");
                let stage = sizes.stage(&block, level, channels + skip)?;
                channels = sizes.channels(level);
                let grows = turn == 2 && level > 0;
                let place = 1 + usize::from(level < 3);
                let twice = grows.then(|| Upsample::new(&block.at(place), channels)).transpose()?;
                let volume = level - usize::from(grows);
                let depth = |number: usize| {
                    let scope = scope.at(format_args!("output_conditions.{number}"));
                    Ok::<_, gradreel::Error>((sizes.depth_attention(&scope, channels, volume)?, volume))
                };
                let depth = number.checked_sub(3).map(depth).transpose()?;
                up.push(Up { stage, twice, depth });
            }
        }
        Ok(Self {
            time: TimeEmbedding::new(&scope.at("time_embed"), sizes.base, embedding)?,
            down,
            middle,
            middle_depth,
            up,
            norm: GroupNorm::new(&scope.at("out.0"), 32, channels, 1e-5)?,
            out: Convolution::new(&scope.at("out.2"), Kernel::image(channels, sizes.outputs, 3).zeros())?,
        })
    }

    /// Predicts the noise in `x [b, inputs, w, w]` at `times` (one per sample), given context tokens
    /// `[b, m, context]` and the volumes of each level, finest first. Without volumes, the depth-wise attention
    /// receives zeros.
    ///
    /// # Errors
    /// If the time features cannot be cast to the dtype of `x`.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the network.
    #[track_caller]
    pub fn forward(&self, x: &Var, times: &[f64], context: &Var, volumes: Option<&[Var; 4]>) -> Result<Var> {
        self.forward_watched(x, times, context, volumes, &mut |_, _| ())
    }

    /// Like [`Unet::forward`]; `watch` receives the output of every block with its name.
    ///
    /// # Errors
    /// As [`Unet::forward`].
    ///
    /// # Panics
    /// As [`Unet::forward`].
    #[track_caller]
    pub fn forward_watched(
        &self,
        x: &Var,
        times: &[f64],
        context: &Var,
        volumes: Option<&[Var; 4]>,
        watch: &mut dyn FnMut(&str, &Var),
    ) -> Result<Var> {
        let time = self.time.forward(x, times)?;
        let mut h = x.clone();
        let mut skips = Vec::with_capacity(self.down.len());
        for (number, block) in self.down.iter().enumerate() {
            h = match block {
                Down::First(conv) => conv.forward(&h),
                Down::Stage(stage) => stage
                    .run(&[&h, &time, context], |stage, inputs| stage.forward(&inputs[0], &inputs[1], &inputs[2]))?,
                Down::Half(half) => half.forward(&h),
            };
            watch(&format!("input_blocks.{number}"), &h);
            skips.push(h.clone());
        }
        h = self.middle.run(&[&h, &time, context], |Middle(first, transformer, second), inputs| {
            let [x, time, context] = inputs else { unreachable!("three operands") };
            second.forward(&transformer.forward(&first.forward(x, time), context), time)
        })?;
        watch("middle_block", &h);
        h = attend(&self.middle_depth, &h, volumes.map(|v| &v[3]))?;
        watch("middle_conditions", &h);
        for (number, block) in self.up.iter().enumerate() {
            let skip = skips.pop().expect("as many blocks up as down");
            h = block.stage.run(&[&h, &skip, &time, context], |stage, inputs| {
                stage.forward(&inputs[0].concat(&[&inputs[1]], 1), &inputs[2], &inputs[3])
            })?;
            if let Some(twice) = &block.twice {
                h = twice.forward(&h);
            }
            watch(&format!("output_blocks.{number}"), &h);
            if let Some((depth, level)) = &block.depth {
                h = attend(depth, &h, volumes.map(|v| &v[*level]))?;
                watch(&format!("output_conditions.{}", number - 3), &h);
            }
        }
        Ok(self.out.forward(&self.norm.silu(&h)))
    }
}
