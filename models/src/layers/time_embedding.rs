//! Embedding of the diffusion time.

use gradreel::{Result, Tensor, Var};

use super::{Linear, Scope};

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
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, features: usize, outputs: usize) -> Result<Self> {
        Ok(Self {
            features,
            inner: Linear::new(&scope.at(0), features, outputs)?,
            outer: Linear::new(&scope.at(2), outputs, outputs)?,
        })
    }

    /// The embeddings of some times, on the tape and device and in the dtype of `like`: `[times.len(), outputs]`.
    ///
    /// # Errors
    /// When the features cannot be copied to the device.
    pub fn forward(&self, like: &Var, times: &[f64]) -> Result<Var> {
        // angles in double precision, as times reach 1000
        let times = like.tape().constant(Tensor::from_vec(times.to_vec(), [times.len()]));
        let features = times.sinusoid(self.features);
        let features = features.value()?.cast(like.dtype())?.to_device(&like.device())?;
        let features = like.tape().constant(features);
        Ok(self.outer.forward(&self.inner.forward(&features).silu()))
    }
}
