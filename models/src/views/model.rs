//! The complete model and the names of its weights.

use gradreel::{Result, Shape};
use serde::{Deserialize, Serialize};

use super::{Autoencoder, AutoencoderSizes, ClipSizes, ClipTower, Coder, Coding, Denoiser, DenoiserSizes};
use crate::layers::{Scope, listing};

/// Sizes of the complete model. A weights file whose sizes differ from the published ones stores them as
/// [`ModelSizes::to_json`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelSizes {
    /// Pixels along a side of an image.
    pub image: usize,
    /// Longer side of the object in the input image, in pixels of a 256-pixel image.
    #[serde(default = "published_crop", skip_serializing_if = "is_published_crop")]
    pub crop: usize,
    /// The diffusion.
    pub denoiser: DenoiserSizes,
    /// Image–latent coding.
    pub autoencoder: Coding,
    /// The CLIP tower; without one, every image's embedding is zero.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip: Option<ClipSizes>,
}

fn published_crop() -> usize {
    200
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives references")]
fn is_published_crop(crop: &usize) -> bool {
    *crop == published_crop()
}

impl ModelSizes {
    /// The published model.
    pub fn published() -> Self {
        Self {
            image: 256,
            crop: published_crop(),
            denoiser: DenoiserSizes::published(),
            autoencoder: AutoencoderSizes::published().into(),
            clip: Some(ClipSizes::PUBLISHED),
        }
    }

    /// Path and shape of every weight that the model reads.
    ///
    /// # Errors
    /// None for valid sizes.
    pub fn weights(&self) -> Result<Vec<(String, Shape)>> {
        listing(|scope| Model::new(scope, self))
    }
}

/// Entries of the published checkpoint that the model does not use: tables that it computes itself, and CLIP's text
/// side.
pub const UNUSED: &[&str] = &[
    "betas",
    "alphas",
    "alphas_cumprod",
    "sqrt_alphas_cumprod",
    "sqrt_one_minus_alphas_cumprod",
    "posterior_variance",
    "posterior_log_variance_clipped",
    "poses",
    "Ks",
    "azimuth",
    "clip_image_encoder.model.positional_embedding",
    "clip_image_encoder.model.text_projection",
    "clip_image_encoder.model.logit_scale",
    "clip_image_encoder.model.token_embedding.weight",
    "clip_image_encoder.model.ln_final.weight",
    "clip_image_encoder.model.ln_final.bias",
];

/// The complete model: from a picture to the latents of its views.
pub struct Model {
    /// The diffusion.
    pub denoiser: Denoiser,
    /// Image–latent coding.
    pub coder: Coder,
    /// Image embedding.
    pub clip: Option<ClipTower>,
}

impl Model {
    /// Builds the model from the weights at a scope, under the published names.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: &ModelSizes) -> Result<Self> {
        Ok(Self {
            denoiser: Denoiser::new(scope, &sizes.denoiser)?,
            coder: Self::coder(scope, sizes)?,
            clip: Self::clip(scope, sizes)?,
        })
    }

    /// The image–latent coder alone, from the complete model's scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn coder(scope: &Scope<'_>, sizes: &ModelSizes) -> Result<Coder> {
        Ok(match &sizes.autoencoder {
            Coding::Learned(sizes) => {
                Coder::Learned(Box::new(Autoencoder::new(&scope.at("first_stage_model"), sizes)?))
            }
            Coding::Patches(patches) => Coder::Patches(*patches),
        })
    }

    /// The CLIP tower alone, from the complete model's scope, if there is one.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn clip(scope: &Scope<'_>, sizes: &ModelSizes) -> Result<Option<ClipTower>> {
        sizes.clip.map(|clip| ClipTower::new(&scope.at("clip_image_encoder.model.visual"), clip)).transpose()
    }
}
