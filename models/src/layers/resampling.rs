//! Halving and doubling of images between the levels of a UNet.

use gradreel::ops::Resampling;
use gradreel::{Result, Var};

use super::{Convolution, Kernel, Scope};

/// A 3×3 convolution of stride 2 with padding 1 on all sides (`op`).
pub struct Downsample(Convolution);

impl Downsample {
    /// The layer at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, channels: usize) -> Result<Self> {
        Ok(Self(Convolution::new(&scope.at("op"), Kernel::image(channels, channels, 3).stride(2))?))
    }

    /// `[b, c, h, w] → [b, c, ⌈h/2⌉, ⌈w/2⌉]`
    ///
    /// # Panics
    /// When the channels are not those of the layer.
    #[track_caller]
    pub fn forward(&self, x: &Var) -> Var {
        self.0.forward(x)
    }
}

/// Nearest-neighbour upsampling by 2, then a 3×3 convolution (`conv`).
pub struct Upsample(Convolution);

impl Upsample {
    /// The layer at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, channels: usize) -> Result<Self> {
        Ok(Self(Convolution::new(&scope.at("conv"), Kernel::image(channels, channels, 3))?))
    }

    /// `[b, c, h, w] → [b, c, 2h, 2w]`
    ///
    /// # Panics
    /// When the channels are not those of the layer.
    #[track_caller]
    pub fn forward(&self, x: &Var) -> Var {
        let [height, width] = [x.dims()[2], x.dims()[3]];
        self.0.forward(&x.resize([2 * height, 2 * width], Resampling::Nearest))
    }
}
