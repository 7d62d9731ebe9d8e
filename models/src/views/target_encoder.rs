//! The encoder of one noised target view.

use gradreel::{Result, Var};

use crate::layers::{Convolution, GroupNorm, Kernel, Scope, per_channel};

/// The sizes of the encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EncoderSizes {
    /// Channels of a latent.
    pub inputs: usize,
    /// Internal channels.
    pub width: usize,
    /// Channels of the features.
    pub outputs: usize,
    /// Channels of the time vector.
    pub time: usize,
    /// Channels of the viewpoint embedding.
    pub view: usize,
}

/// Three residual units on the noised latent, conditioned on time and viewpoint.
pub struct TargetEncoder {
    into: Convolution,
    units: [Unit; 3],
    norm: GroupNorm,
    out: Convolution,
}

struct Unit {
    time: Convolution,
    view: Convolution,
    stages: [(GroupNorm, Convolution); 2],
}

impl Unit {
    fn new(scope: &Scope<'_>, sizes: EncoderSizes) -> Result<Self> {
        let width = sizes.width;
        let stage = |norm, conv| {
            Ok((
                GroupNorm::new(&scope.at(norm), 8, width, 1e-5)?,
                Convolution::new(&scope.at(conv), Kernel::image(width, width, 3))?,
            ))
        };
        Ok(Self {
            time: Convolution::new(&scope.at("time_embed"), Kernel::image(sizes.time, width, 1))?,
            view: Convolution::new(&scope.at("view_embed"), Kernel::image(sizes.view, width, 1))?,
            stages: [stage("conv.0", "conv.2")?, stage("conv.3", "conv.5")?],
        })
    }

    fn forward(&self, x: &Var, time: &Var, view: &Var) -> Var {
        let mut h = &(x + &self.time.forward(time)) + &self.view.forward(view);
        for (norm, conv) in &self.stages {
            h = conv.forward(&norm.silu(&h));
        }
        x + &h
    }
}

impl TargetEncoder {
    /// Builds the encoder from the weights at a scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: EncoderSizes) -> Result<Self> {
        let unit = |i: usize| Unit::new(&scope.at(format_args!("out_conv{i}")), sizes);
        Ok(Self {
            into: Convolution::new(&scope.at("init_conv"), Kernel::image(sizes.inputs, sizes.width, 3))?,
            units: [unit(0)?, unit(1)?, unit(2)?],
            norm: GroupNorm::new(&scope.at("final_out.0"), 8, sizes.width, 1e-5)?,
            out: Convolution::new(&scope.at("final_out.2"), Kernel::image(sizes.width, sizes.outputs, 3))?,
        })
    }

    /// Latents `[b, inputs, h, w]`, time vectors `[b, time]` and viewpoint embeddings `[b, view]` to features
    /// `[b, outputs, h, w]`.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the encoder.
    #[track_caller]
    pub fn forward(&self, x: &Var, time: &Var, view: &Var) -> Var {
        let [time, view] = [time, view].map(|vectors| per_channel(vectors, 2));
        let mut h = self.into.forward(x);
        for unit in &self.units {
            h = unit.forward(&h, &time, &view);
        }
        self.out.forward(&self.norm.silu(&h))
    }
}
