//! Group and layer normalisation with learned scale and shift.

use gradreel::{Result, Var};

use super::{Init, Scope};

/// Group normalisation (Wu and He 2018) of `[batch, channels, …]`: mean 0 and variance 1 over each group of channels
/// and all positions, then `weight · x + bias` per channel.
pub struct GroupNorm {
    weight: Var,
    bias: Var,
    groups: usize,
    epsilon: f64,
}

impl GroupNorm {
    /// The layer at a scope; `epsilon` is added to the variance.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, groups: usize, channels: usize, epsilon: f64) -> Result<Self> {
        Self::scaled(scope, groups, channels, epsilon, Init::Ones)
    }

    /// The layer with another initial scale.
    ///
    /// # Errors
    /// As [`GroupNorm::new`].
    pub fn scaled(scope: &Scope<'_>, groups: usize, channels: usize, epsilon: f64, scale: Init) -> Result<Self> {
        let weight = scope.weight("weight", [channels], scale)?;
        Ok(Self { weight, bias: scope.weight("bias", [channels], Init::Zeros)?, groups, epsilon })
    }

    /// Applies the layer.
    ///
    /// # Panics
    /// When the channels are not those of the layer, or the groups do not divide them.
    #[track_caller]
    pub fn forward(&self, x: &Var) -> Var {
        let [weight, bias] = [&self.weight, &self.bias].map(|w| w.to_dtype(x.dtype()));
        x.group_norm(self.groups, self.epsilon, Some((&weight, &bias)))
    }

    /// The learned shift `[channels]`, which is the output for a constant input.
    pub fn shift(&self) -> &Var {
        &self.bias
    }

    /// Applies the layer, then SiLU.
    ///
    /// # Panics
    /// As [`GroupNorm::forward`].
    #[track_caller]
    pub fn silu(&self, x: &Var) -> Var {
        let [weight, bias] = [&self.weight, &self.bias].map(|w| w.to_dtype(x.dtype()));
        x.group_norm_silu(self.groups, self.epsilon, Some((&weight, &bias)))
    }
}

/// Layer normalisation (Ba et al. 2016) of the last axis with ε = 1e-5.
pub struct LayerNorm {
    weight: Var,
    bias: Var,
}

impl LayerNorm {
    /// The layer at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, channels: usize) -> Result<Self> {
        let weight = scope.weight("weight", [channels], Init::Ones)?;
        Ok(Self { weight, bias: scope.weight("bias", [channels], Init::Zeros)? })
    }

    /// Applies the layer.
    ///
    /// # Panics
    /// When the last axis is not `channels` long.
    #[track_caller]
    pub fn forward(&self, x: &Var) -> Var {
        let [weight, bias] = [&self.weight, &self.bias].map(|w| w.to_dtype(x.dtype()));
        x.layer_norm(1, 1e-5, Some((&weight, &bias)))
    }
}
