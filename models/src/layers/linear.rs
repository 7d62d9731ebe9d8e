//! The affine map of the last axis.

use gradreel::{Result, Var};

use super::{Init, Scope};

/// `y = x·Wᵀ + b` on the last axis: `[.., inputs] → [.., outputs]`. Weights `weight [outputs, inputs]`,
/// `bias [outputs]`.
pub struct Linear {
    weight: Var,
    bias: Option<Var>,
}

impl Linear {
    /// The layer at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, inputs: usize, outputs: usize) -> Result<Self> {
        Self::named(scope, ["weight", "bias"], inputs, outputs)
    }

    /// The layer with other names for weight and bias.
    ///
    /// # Errors
    /// As [`Linear::new`].
    pub fn named(scope: &Scope<'_>, [weight, bias]: [&str; 2], inputs: usize, outputs: usize) -> Result<Self> {
        let weight = scope.weight(weight, [outputs, inputs], Init::FanIn(inputs))?;
        Ok(Self { weight, bias: Some(scope.weight(bias, [outputs], Init::FanIn(inputs))?) })
    }

    /// The layer at a scope, without bias.
    ///
    /// # Errors
    /// As [`Linear::new`].
    pub fn without_bias(scope: &Scope<'_>, inputs: usize, outputs: usize) -> Result<Self> {
        Ok(Self { weight: scope.weight("weight", [outputs, inputs], Init::FanIn(inputs))?, bias: None })
    }

    /// Applies the layer.
    ///
    /// # Panics
    /// When the last axis is not `inputs` long.
    #[track_caller]
    pub fn forward(&self, x: &Var) -> Var {
        let bias = self.bias.as_ref().map(|bias| bias.to_dtype(x.dtype()));
        x.linear(&self.weight.to_dtype(x.dtype()), bias.as_ref())
    }
}
