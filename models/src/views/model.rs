//! The whole published model and the names of its weights.

use gradreel::{Result, Shape};
use serde::{Deserialize, Serialize};

use super::{Autoencoder, AutoencoderSizes, ClipSizes, ClipTower, Coder, Coding, Denoiser, DenoiserSizes};
use crate::layers::{Scope, listing};

/// The sizes of the whole model. [`ModelSizes::to_json`] is how a file of weights says that it has others than the
/// published ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelSizes {
    /// Pixels along a side of an image.
    pub image: usize,
    /// Longer side of the object in the input image, in pixels of 256.
    #[serde(default = "published_crop", skip_serializing_if = "is_published_crop")]
    pub crop: usize,
    /// The diffusion.
    pub denoiser: DenoiserSizes,
    /// Between images and latents.
    pub autoencoder: Coding,
    /// The CLIP tower; without one the embedding of every image is zero.
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
    /// Never with sound sizes.
    pub fn weights(&self) -> Result<Vec<(String, Shape)>> {
        listing(|scope| Model::new(scope, self))
    }
}

/// Entries of the published checkpoint that the model has no use for: tables that it computes itself, and the text side of
/// CLIP.
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

/// The whole model: a picture to the latents of its views.
pub struct Model {
    /// The diffusion.
    pub denoiser: Denoiser,
    /// Between images and latents.
    pub coder: Coder,
    /// The image's embedding.
    pub clip: Option<ClipTower>,
}

impl Model {
    /// The model at a scope, under the published names.
    ///
    /// # Errors
    /// When a weight is missing or mis-shaped.
    pub fn new(scope: &Scope<'_>, sizes: &ModelSizes) -> Result<Self> {
        Ok(Self {
            denoiser: Denoiser::new(scope, &sizes.denoiser)?,
            coder: Self::coder(scope, sizes)?,
            clip: Self::clip(scope, sizes)?,
        })
    }

    /// What is between images and latents alone, of the whole model's scope.
    ///
    /// # Errors
    /// When a weight is missing or mis-shaped.
    pub fn coder(scope: &Scope<'_>, sizes: &ModelSizes) -> Result<Coder> {
        Ok(match &sizes.autoencoder {
            Coding::Learned(sizes) => {
                Coder::Learned(Box::new(Autoencoder::new(&scope.at("first_stage_model"), sizes)?))
            }
            Coding::Patches(patches) => Coder::Patches(*patches),
        })
    }

    /// The CLIP tower alone, of the whole model's scope, if it has one.
    ///
    /// # Errors
    /// When a weight is missing or mis-shaped.
    pub fn clip(scope: &Scope<'_>, sizes: &ModelSizes) -> Result<Option<ClipTower>> {
        sizes.clip.map(|clip| ClipTower::new(&scope.at("clip_image_encoder.model.visual"), clip)).transpose()
    }
}
