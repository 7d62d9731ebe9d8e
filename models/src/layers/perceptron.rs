//! A multilayer perceptron with ReLU.

use gradreel::ops::Activation;
use gradreel::{Result, Var};

use super::{Init, Scope};

/// Affine layers with ReLU between them and none after the last: `[n, inputs] → [n, outputs]`, evaluated in one pass
/// over the rows.
pub struct Perceptron {
    layers: Vec<[Var; 2]>,
}

impl Perceptron {
    /// The layers with these names and output widths, at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, inputs: usize, layers: &[(&str, usize)]) -> Result<Self> {
        Self::ending_in(scope, inputs, layers, None)
    }

    /// [`Perceptron::new`] with another initialisation of the last layer's weight and bias.
    ///
    /// # Errors
    /// As [`Perceptron::new`].
    pub fn ending_in(
        scope: &Scope<'_>,
        inputs: usize,
        layers: &[(&str, usize)],
        last: Option<[Init; 2]>,
    ) -> Result<Self> {
        let mut from = inputs;
        let mut made = Vec::with_capacity(layers.len());
        for (number, (name, outputs)) in layers.iter().enumerate() {
            let usual = [Init::FanIn(from); 2];
            let [weight, bias] = if number + 1 == layers.len() { last.unwrap_or(usual) } else { usual };
            let scope = scope.at(name);
            made.push([scope.weight("weight", [*outputs, from], weight)?, scope.weight("bias", [*outputs], bias)?]);
            from = *outputs;
        }
        Ok(Self { layers: made })
    }

    /// Applies the layers to rows.
    ///
    /// # Panics
    /// When the last axis is not `inputs` long.
    #[track_caller]
    pub fn forward(&self, x: &Var) -> Var {
        let layers: Vec<(&Var, &Var)> = self.layers.iter().map(|[weight, bias]| (weight, bias)).collect();
        x.mlp(&layers, Activation::Relu)
    }
}
