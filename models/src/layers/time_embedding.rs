//! Diffusion time as a vector.

use gradreel::{DType, Result, Tape, Var};

use super::{Linear, Scope};

/// Sinusoidal features of diffusion times: `[cos(t f₀).., sin(t f₀)..]` with `fᵢ = 10000^(−i/half)`, a zero appended when
/// `size` is odd. `[times.len(), size]`.
pub fn sinusoid(tape: &Tape, times: &[f64], size: usize, dtype: DType) -> Result<Var> {
    Ok(tape.constant(gradreel::ops::sinusoidal(times, size).cast(dtype)?))
}

/// Sinusoidal features, then `Linear, SiLU, Linear` (names `0` and `2`).
pub struct TimeEmbedding {
    features: usize,
    inner: Linear,
    outer: Linear,
}

impl TimeEmbedding {
    /// The layer at a scope: `features` sinusoids to `outputs` channels.
    ///
    /// # Errors
    /// When a weight is missing or mis-shaped.
    pub fn new(scope: &Scope<'_>, features: usize, outputs: usize) -> Result<Self> {
        Ok(Self {
            features,
            inner: Linear::new(&scope.at(0), features, outputs)?,
            outer: Linear::new(&scope.at(2), outputs, outputs)?,
        })
    }

    /// The vectors of some times: `[times.len(), outputs]`.
    ///
    /// # Errors
    /// When the features cannot be cast to the weights' dtype.
    pub fn forward(&self, tape: &Tape, times: &[f64], dtype: DType) -> Result<Var> {
        let features = sinusoid(tape, times, self.features, dtype)?;
        Ok(self.outer.forward(&self.inner.forward(&features).silu()))
    }
}
