//! The autoencoder between images and latents (Rombach et al. 2022, KL, factor 8).

use gradreel::ops::Resampling;
use gradreel::{Result, Var};
use serde::{Deserialize, Serialize};

use crate::layers::{Convolution, GroupNorm, Kernel, Scope};

/// Sizes of the autoencoder. Each level below the first halves the resolution.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AutoencoderSizes {
    /// Channels of the first level before its multiplier.
    pub base: usize,
    /// Channels of each level in units of `base`.
    pub multipliers: Vec<usize>,
    /// Residual blocks of a level of the encoder; the decoder has one more.
    pub blocks: usize,
    /// Channels of a latent.
    pub latent: usize,
}

impl AutoencoderSizes {
    /// The published model.
    pub fn published() -> Self {
        Self { base: 128, multipliers: vec![1, 2, 4, 4], blocks: 2, latent: 4 }
    }

    fn channels(&self, level: usize) -> usize {
        self.base * self.multipliers[level]
    }
}

/// Encoder and decoder.
pub struct Autoencoder {
    encoder: Encoder,
    decoder: Decoder,
    quant: Convolution,
    post_quant: Convolution,
}

/// The latent distribution of an image: independent normals.
pub struct Posterior {
    /// Means `[b, latent, h, w]`.
    pub mean: Var,
    /// Logarithms of the variances, within −30..20.
    pub log_variance: Var,
}

impl Posterior {
    /// A sample for standard normal noise of the mean's shape.
    #[track_caller]
    pub fn sample(&self, noise: &Var) -> Var {
        &self.mean + &(&self.deviation() * noise)
    }

    /// Standard deviations.
    pub fn deviation(&self) -> Var {
        (&self.log_variance * 0.5).exp()
    }
}

impl Autoencoder {
    /// Factor from samples to the latents of the diffusion.
    pub const SCALE: f64 = 0.18215;

    /// Builds the autoencoder from the weights at a scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: &AutoencoderSizes) -> Result<Self> {
        let latent = sizes.latent;
        Ok(Self {
            encoder: Encoder::new(&scope.at("encoder"), sizes)?,
            decoder: Decoder::new(&scope.at("decoder"), sizes)?,
            quant: Convolution::new(&scope.at("quant_conv"), Kernel::image(2 * latent, 2 * latent, 1))?,
            post_quant: Convolution::new(&scope.at("post_quant_conv"), Kernel::image(latent, latent, 1))?,
        })
    }

    /// Images `[b, 3, h, w]` in −1..1 to means and log-variances, stacked along the channels.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the autoencoder.
    #[track_caller]
    pub fn moments(&self, images: &Var) -> Var {
        self.quant.forward(&self.encoder.forward(images))
    }

    /// Images `[b, 3, h, w]` in −1..1 to the distribution of their latents.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the autoencoder.
    #[track_caller]
    pub fn encode(&self, images: &Var) -> Posterior {
        let moments = self.moments(images);
        let half = moments.dims()[1] / 2;
        let log_variance = moments.slice(1, half..2 * half).clamp(-30.0, 20.0);
        Posterior { mean: moments.slice(1, 0..half), log_variance }
    }

    /// Unscaled latents `[b, latent, h, w]` to images in about −1..1.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the autoencoder.
    #[track_caller]
    pub fn decode(&self, latents: &Var) -> Var {
        self.decoder.forward(&self.post_quant.forward(latents))
    }
}

struct Encoder {
    into: Convolution,
    levels: Vec<(Vec<Residual>, Option<Convolution>)>,
    middle: Middle,
    head: (GroupNorm, Convolution),
}

impl Encoder {
    fn new(scope: &Scope<'_>, sizes: &AutoencoderSizes) -> Result<Self> {
        let mut channels = sizes.base;
        let count = sizes.multipliers.len();
        let into = Convolution::new(&scope.at("conv_in"), Kernel::image(3, channels, 3))?;
        let mut levels = Vec::with_capacity(count);
        for level in 0..count {
            let scope = scope.at(format_args!("down.{level}"));
            let mut blocks = Vec::with_capacity(sizes.blocks);
            for i in 0..sizes.blocks {
                blocks.push(Residual::new(&scope.at(format_args!("block.{i}")), channels, sizes.channels(level))?);
                channels = sizes.channels(level);
            }
            let half = Kernel::image(channels, channels, 3).stride(2).padding(0);
            let half = (level + 1 < count).then(|| Convolution::new(&scope.at("downsample.conv"), half));
            levels.push((blocks, half.transpose()?));
        }
        let middle = Middle::new(&scope.at("mid"), channels)?;
        Ok(Self { into, levels, middle, head: head(scope, channels, 2 * sizes.latent)? })
    }

    fn forward(&self, x: &Var) -> Var {
        let mut h = self.into.forward(x);
        for (blocks, half) in &self.levels {
            for block in blocks {
                h = block.forward(&h);
            }
            if let Some(half) = half {
                // zero padding to the right and below only
                h = half.forward(&h.pad(2, 0, 1).pad(3, 0, 1));
            }
        }
        let h = self.middle.forward(&h);
        self.head.1.forward(&self.head.0.silu(&h))
    }
}

struct Decoder {
    into: Convolution,
    middle: Middle,
    levels: Vec<(Vec<Residual>, Option<Convolution>)>,
    head: (GroupNorm, Convolution),
}

impl Decoder {
    fn new(scope: &Scope<'_>, sizes: &AutoencoderSizes) -> Result<Self> {
        let count = sizes.multipliers.len();
        let mut channels = sizes.channels(count - 1);
        let into = Convolution::new(&scope.at("conv_in"), Kernel::image(sizes.latent, channels, 3))?;
        let middle = Middle::new(&scope.at("mid"), channels)?;
        let mut levels = Vec::with_capacity(count);
        for level in (0..count).rev() {
            let scope = scope.at(format_args!("up.{level}"));
            let mut blocks = Vec::with_capacity(sizes.blocks + 1);
            for i in 0..=sizes.blocks {
                blocks.push(Residual::new(&scope.at(format_args!("block.{i}")), channels, sizes.channels(level))?);
                channels = sizes.channels(level);
            }
            let twice = || Convolution::new(&scope.at("upsample.conv"), Kernel::image(channels, channels, 3));
            levels.push((blocks, (level > 0).then(twice).transpose()?));
        }
        Ok(Self { into, middle, levels, head: head(scope, channels, 3)? })
    }

    fn forward(&self, latents: &Var) -> Var {
        let mut h = self.middle.forward(&self.into.forward(latents));
        for (blocks, twice) in &self.levels {
            for block in blocks {
                h = block.forward(&h);
            }
            if let Some(twice) = twice {
                let [height, width] = [h.dims()[2], h.dims()[3]];
                h = twice.forward(&h.resize([2 * height, 2 * width], Resampling::Nearest));
            }
        }
        self.head.1.forward(&self.head.0.silu(&h))
    }
}

fn head(scope: &Scope<'_>, channels: usize, outputs: usize) -> Result<(GroupNorm, Convolution)> {
    Ok((
        GroupNorm::new(&scope.at("norm_out"), 32, channels, 1e-6)?,
        Convolution::new(&scope.at("conv_out"), Kernel::image(channels, outputs, 3))?,
    ))
}

/// Two `GN(32) → SiLU → 3×3` stages around a skip connection.
struct Residual {
    stages: [(GroupNorm, Convolution); 2],
    shortcut: Option<Convolution>,
}

impl Residual {
    fn new(scope: &Scope<'_>, inputs: usize, outputs: usize) -> Result<Self> {
        let stage = |i: usize, inputs| {
            Ok((
                GroupNorm::new(&scope.at(format_args!("norm{i}")), 32, inputs, 1e-6)?,
                Convolution::new(&scope.at(format_args!("conv{i}")), Kernel::image(inputs, outputs, 3))?,
            ))
        };
        let shortcut = || Convolution::new(&scope.at("nin_shortcut"), Kernel::image(inputs, outputs, 1));
        Ok(Self {
            stages: [stage(1, inputs)?, stage(2, outputs)?],
            shortcut: (inputs != outputs).then(shortcut).transpose()?,
        })
    }

    fn forward(&self, x: &Var) -> Var {
        let mut h = x.clone();
        for (norm, conv) in &self.stages {
            h = conv.forward(&norm.silu(&h));
        }
        match &self.shortcut {
            Some(shortcut) => &shortcut.forward(x) + &h,
            None => x + &h,
        }
    }
}

/// Residual, attention among all pixels with a single head, residual.
struct Middle {
    blocks: [Residual; 2],
    norm: GroupNorm,
    projections: [Convolution; 3],
    out: Convolution,
}

impl Middle {
    fn new(scope: &Scope<'_>, channels: usize) -> Result<Self> {
        let block = |name| Residual::new(&scope.at(name), channels, channels);
        let conv = |name| Convolution::new(&scope.at("attn_1").at(name), Kernel::image(channels, channels, 1));
        Ok(Self {
            blocks: [block("block_1")?, block("block_2")?],
            norm: GroupNorm::new(&scope.at("attn_1.norm"), 32, channels, 1e-6)?,
            projections: [conv("q")?, conv("k")?, conv("v")?],
            out: conv("proj_out")?,
        })
    }

    fn forward(&self, x: &Var) -> Var {
        let x = self.blocks[0].forward(x);
        let h = self.norm.forward(&x);
        let [batch, channels, height, width] = h.dims()[..] else { panic!("images are [b, c, h, w]") };
        let [q, k, v] = [0, 1, 2].map(|i| {
            let pixels = self.projections[i].forward(&h).reshape([batch, 1, channels, height * width]);
            pixels.permute(&[0, 1, 3, 2])
        });
        let gathered = q.attention(&k, &v, (channels as f64).powf(-0.5), None);
        let gathered = gathered.permute(&[0, 1, 3, 2]).reshape([batch, channels, height, width]);
        self.blocks[1].forward(&(&x + &self.out.forward(&gathered)))
    }
}
