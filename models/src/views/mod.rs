//! Novel views: a multi-view latent diffusion model (SyncDreamer, Liu et al. 2023) with the parameter paths of the
//! published checkpoint.
//!
//! ```text
//! noised views → target encoder → un-projection → spatial net → frustum sampling → frustum net ─┐
//! input image → autoencoder → latent ┐                                                          │
//!             → CLIP tower → token ──┴───────────────────────→ UNet ← depth-wise attention ←─────┘
//! ```
//!
//! From a picture to its views: [`FileWeights`] supplies the weights, [`Subject`] is the conditioning on the
//! picture, and [`Sampling`] is the state of a run. It requests the noise in the views from an [`Ensemble`], as
//! many at once as [`MemoryEstimate`] allows; [`decode`] turns the latents into pictures.
//!
//! `spatial_aware` corrects the spatial volume such that the object is aligned with the picture. `Training`
//! trains a model, published or [`ModelSizes::small`], or that module alone, on procedural [`objects`] or meshes
//! from files; `Score` measures how well views agree.

mod resize;
mod image;
mod target_encoder;
mod spatial_net;
mod frustum_net;
mod unet;
mod autoencoder;
mod coding;
mod clip;
mod cameras;
mod volume;
mod image_box;
mod detection;
pub(crate) mod spatial_aware;
mod denoiser;
mod schedule;
mod model;
mod sizes;
mod weights;
#[doc(hidden)] // the benchmarks and the fuzz tests use parts of it
pub mod objects;
mod score;
mod training;
mod frozen;
mod picture;
mod subject;
mod sampler;
mod sampler_file;
mod without_input;
mod memory_estimate;
mod ensemble;
mod preview;
mod decoding;
#[cfg(test)]
pub(crate) mod tests;

pub use autoencoder::AutoencoderSizes;
pub use cameras::Ring;
pub use clip::ClipSizes;
pub use coding::Coding;
pub use decoding::decode;
pub use denoiser::DenoiserSizes;
pub use ensemble::Ensemble;
pub use memory_estimate::MemoryEstimate;
pub use model::{Model, ModelSizes};
pub use picture::open_picture;
pub use sampler::{SamplerSettings, Sampling};
pub use subject::Subject;
pub use weights::FileWeights;

// the benchmarks use these; they are no part of the API
#[doc(hidden)]
pub use {
    autoencoder::Autoencoder,
    clip::ClipTower,
    denoiser::{Condition, Denoiser, Target},
    frustum_net::{FrustumNet, FrustumSizes},
    image_box::ImageBox,
    schedule::Schedule,
    spatial_net::{SpatialNet, SpatialSizes},
    unet::{Unet, UnetSizes},
    volume::VolumeSizes,
};

pub(crate) use coding::{Coder, Patches};
pub(crate) use denoiser::{Look, Output, Told};
pub(crate) use detection::Detection;
pub(crate) use image::prepare;
pub(crate) use memory_estimate::megabytes;
pub(crate) use model::UNUSED;
pub(crate) use preview::LatentColours;
pub(crate) use resize::Bicubic;
pub(crate) use sampler::{Moment, Predictor};
pub(crate) use schedule::Ddim;
pub(crate) use score::Score;
pub(crate) use spatial_aware::{SpatialAware, SpatialAwareSizes};
pub(crate) use target_encoder::{EncoderSizes, TargetEncoder};
pub(crate) use training::{Detector, Plan, Training, encode, subject_of};
pub(crate) use volume::VolumePath;

use gradreel::{Device, Result, Tensor, Var};

/// A constant on the tape and device and in the dtype of another variable.
fn constant(like: &Var, value: Tensor) -> Result<Var> {
    Ok(like.tape().constant(value.cast(like.dtype())?.to_device(&like.device())?))
}

/// The value of a variable, on the CPU.
fn on_cpu(x: &Var) -> Result<Tensor> {
    x.value()?.to_device(&Device::Cpu)
}
