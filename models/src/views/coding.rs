//! Image–latent coding: a learned autoencoder, or patches of raw pixels.

use gradreel::{Key, Result, Tensor, Var};
use serde::{Deserialize, Serialize};

use super::{Autoencoder, AutoencoderSizes};

/// How images are coded as latents.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Coding {
    /// By an autoencoder, as in the published model.
    Learned(AutoencoderSizes),
    /// Pixels of a patch stacked as channels, without learned weights.
    Patches(Patches),
}

/// Square patches of an image become channels: `[b, 3, h, w]` in −1..1 to `[b, 3 p², h / p, w / p]` in −2..0, with
/// white at 0.
///
/// With white at 0, the background of a noised latent is pure noise, as at the start of sampling.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Patches {
    /// Pixels along a side of a patch.
    pub patch: usize,
    /// Factor from patches to the latents of the diffusion. Below 1, noise also hides the low frequencies that
    /// neighbouring pixels share, so that the model must use the input image (Chen 2023).
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub scale: f64,
}

fn one() -> f64 {
    1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives references")]
fn is_one(scale: &f64) -> bool {
    *scale == one()
}

impl Coding {
    /// Channels of a latent.
    pub fn channels(&self) -> usize {
        match self {
            Self::Learned(sizes) => sizes.latent,
            Self::Patches(Patches { patch, .. }) => 3 * patch * patch,
        }
    }

    /// Image pixels per latent cell along a side.
    pub fn factor(&self) -> usize {
        match self {
            Self::Learned(sizes) => 1 << sizes.multipliers.len().saturating_sub(1),
            Self::Patches(Patches { patch, .. }) => *patch,
        }
    }

    /// Factor from the coding's latents to those of the diffusion.
    pub fn scale(&self) -> f64 {
        match self {
            Self::Learned(_) => Autoencoder::SCALE,
            Self::Patches(Patches { scale, .. }) => *scale,
        }
    }
}

impl From<AutoencoderSizes> for Coding {
    fn from(sizes: AutoencoderSizes) -> Self {
        Self::Learned(sizes)
    }
}

impl Patches {
    /// Images to latents.
    ///
    /// # Panics
    /// If the patch size does not divide the sides.
    #[track_caller]
    pub fn encode(self, images: &Var) -> Var {
        let p = self.patch;
        let [batch, channels, height, width] = images.dims()[..] else { panic!("images are [b, 3, h, w]") };
        assert!(height.is_multiple_of(p) && width.is_multiple_of(p), "patches of {p} pixels for {height} × {width}");
        let (rows, columns) = (height / p, width / p);
        let apart = images.reshape([batch, channels, rows, p, columns, p]).permute(&[0, 1, 3, 5, 2, 4]);
        &apart.reshape([batch, channels * p * p, rows, columns]) - 1.0
    }

    /// Latents to images.
    ///
    /// # Panics
    /// If the number of channels is not that of the patches.
    #[track_caller]
    pub fn decode(self, latents: &Var) -> Var {
        let p = self.patch;
        let [batch, all, rows, columns] = latents.dims()[..] else { panic!("latents are [b, c, h, w]") };
        assert!(all.is_multiple_of(p * p), "{all} channels for patches of {p} pixels");
        let channels = all / (p * p);
        let apart = latents.reshape([batch, channels, p, p, rows, columns]).permute(&[0, 1, 4, 2, 5, 3]);
        &apart.reshape([batch, channels, rows * p, columns * p]) + 1.0
    }
}

/// The coding with its weights.
pub enum Coder {
    /// The autoencoder.
    Learned(Box<Autoencoder>),
    /// Patches.
    Patches(Patches),
}

impl Coder {
    /// Images `[b, 3, h, w]` in −1..1 to unscaled latents (see [`Coding::scale`]). With an autoencoder, they are
    /// sampled from its distribution with random numbers of the key `noise`, or the means without a key.
    ///
    /// # Errors
    /// If the noise cannot be moved to the images' device.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the coding.
    #[track_caller]
    pub fn encode(&self, images: &Var, noise: Option<Key>) -> Result<Var> {
        match self {
            Self::Patches(patches) => Ok(patches.encode(images)),
            Self::Learned(autoencoder) => {
                let posterior = autoencoder.encode(images);
                match noise {
                    Some(key) => {
                        let mean = &posterior.mean;
                        let noise =
                            Tensor::normal(key, mean.shape().clone(), mean.dtype()).to_device(&mean.device())?;
                        Ok(posterior.sample(&mean.tape().constant(noise)))
                    }
                    None => Ok(posterior.mean),
                }
            }
        }
    }

    /// Unscaled latents to images in about −1..1.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the coding.
    #[track_caller]
    pub fn decode(&self, latents: &Var) -> Var {
        match self {
            Self::Patches(patches) => patches.decode(latents),
            Self::Learned(autoencoder) => autoencoder.decode(latents),
        }
    }
}
