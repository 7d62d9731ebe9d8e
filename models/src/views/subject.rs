//! Conditioning of the sampler on the input picture.

use gradreel::{Device, Key, Result, Tape, Tensor, Var};

use super::frozen::Frozen;
use super::{Bicubic, ClipTower, Condition, Detection, ImageBox, Model, ModelSizes, on_cpu};
use crate::layers::{Scope, Weights};

/// The encoded input picture, as plain tensors on the CPU.
#[derive(Debug, Clone)]
pub struct Subject {
    /// CLIP embedding `[1, 1, context]`.
    pub embedding: Tensor,
    /// Latent `[1, latent, w, w]`, not scaled by [`super::Coding::scale`].
    pub latent: Tensor,
    /// Elevation of its camera in radians.
    pub elevation: f64,
    /// Detection of the object, for a model with a spatial-aware module.
    pub seen: Option<Detection>,
}

impl Subject {
    /// Embeds and encodes a picture `[1, 3, s, s]` in −1..1 (see `prepare`) taken from this elevation in
    /// radians. The latent is sampled from the encoder's distribution with noise from `key`. A model with a
    /// spatial-aware module receives the bounding box of the non-white pixels.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape, or the device fails.
    ///
    /// # Panics
    /// If the picture does not have the size of the model.
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
        let embedding = embed(&scope, sizes, &picture)?;
        let latent = Model::coder(&scope, sizes)?.encode(&picture, Some(key))?;
        let seen = match sizes.denoiser.spatial_aware {
            Some(_) => ImageBox::of_picture(&on_cpu(&picture)?)?.map(Detection::from),
            None => None,
        };
        Ok(Self { embedding: on_cpu(&embedding)?, latent: on_cpu(&latent)?, elevation, seen })
    }

    /// The condition of a denoiser on a tape and device.
    ///
    /// # Errors
    /// If the tensors cannot be moved there.
    pub fn condition(&self, tape: &Tape, device: &Device) -> Result<Condition> {
        Ok(Condition {
            embedding: tape.constant(self.embedding.to_device(device)?),
            latent: tape.constant(self.latent.to_device(device)?),
            elevations: vec![self.elevation],
            boxes: vec![self.seen],
        })
    }
}

/// CLIP embeddings `[b, 1, context]` of images `[b, 3, s, s]`; zeros for a model without a tower.
#[track_caller]
pub(super) fn embed(scope: &Scope<'_>, sizes: &ModelSizes, images: &Var) -> Result<Var> {
    let (batch, context) = (images.dims()[0], sizes.denoiser.unet.context);
    match (Model::clip(scope, sizes)?, sizes.clip) {
        (Some(tower), Some(clip)) => {
            let resized = Bicubic::Aligned.resize(images, clip.resolution, clip.resolution)?;
            Ok(tower.forward(&ClipTower::normalise(&resized)?).reshape([batch, 1, context]))
        }
        _ => super::constant(images, Tensor::zeros([batch, 1, context], images.dtype())),
    }
}
