//! What the model knows about the input picture.

use gradreel::{Device, Key, Result, Tape, Tensor};

use super::frozen::Frozen;
use super::{Bicubic, ClipTower, Condition, Model, ModelSizes, on_cpu};
use crate::layers::{Scope, Weights};

/// The input picture as the sampler sees it, in plain tensors on the CPU.
#[derive(Debug, Clone)]
pub struct Subject {
    /// CLIP embedding `[1, 1, context]`.
    pub embedding: Tensor,
    /// Latent `[1, latent, w, w]`, not scaled by [`super::Autoencoder::SCALE`].
    pub latent: Tensor,
    /// Elevation of its camera in radians.
    pub elevation: f64,
}

impl Subject {
    /// Embeds and encodes a picture `[1, 3, s, s]` in −1..1 (see [`super::prepare`]) that was taken from this elevation in
    /// radians. The latent is a sample of the encoder's distribution, with noise of this key.
    ///
    /// # Errors
    /// When a weight is missing or mis-shaped, or the device fails.
    ///
    /// # Panics
    /// When the picture has not the size of the model.
    #[track_caller]
    pub fn encode(
        weights: &dyn Weights,
        sizes: &ModelSizes,
        picture: &Tensor,
        elevation: f64,
        key: Key,
        device: &Device,
    ) -> Result<Self> {
        assert_eq!(picture.dims(), [1, 3, sizes.image, sizes.image], "the picture has another size than the model");
        let frozen = Frozen(weights);
        let scope = Scope::root(&frozen);
        let tape = Tape::new();
        let picture = tape.constant(picture.to_device(device)?);
        let side = sizes.clip.resolution;
        let resized = Bicubic::Aligned.resize(&picture, side, side)?;
        let embedding = Model::clip(&scope, sizes)?.forward(&ClipTower::normalise(&resized)?);
        let posterior = Model::autoencoder(&scope, sizes)?.encode(&picture);
        let noise = Tensor::normal(key, posterior.mean.shape().clone(), picture.dtype()).to_device(device)?;
        let latent = posterior.sample(&tape.constant(noise));
        let context = embedding.len();
        Ok(Self { embedding: on_cpu(&embedding)?.reshape([1, 1, context]), latent: on_cpu(&latent)?, elevation })
    }

    /// The condition of a denoiser on a tape and device.
    ///
    /// # Errors
    /// When the tensors cannot be moved there.
    pub fn condition(&self, tape: &Tape, device: &Device) -> Result<Condition> {
        Ok(Condition {
            embedding: tape.constant(self.embedding.to_device(device)?),
            latent: tape.constant(self.latent.to_device(device)?),
            elevations: vec![self.elevation],
        })
    }
}
