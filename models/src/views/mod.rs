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
//! [`spatial_aware`] corrects the spatial volume such that the object is aligned with the picture. [`Training`]
//! trains a model, published or [`ModelSizes::small`], or that module alone, on procedural [`objects`] or meshes
//! from files; [`Score`] measures how well views agree.

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
pub mod spatial_aware;
mod denoiser;
mod schedule;
mod model;
mod sizes;
mod weights;
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

pub use autoencoder::{Autoencoder, AutoencoderSizes, Posterior};
pub use cameras::Ring;
pub use clip::{ClipSizes, ClipTower};
pub use coding::{Coder, Coding, Patches};
pub use decoding::decode;
pub use denoiser::{Condition, Denoiser, DenoiserSizes, Look, Output, Target, Told};
pub use detection::Detection;
pub use ensemble::Ensemble;
pub use frustum_net::{FrustumNet, FrustumSizes};
pub use image::prepare;
pub use image_box::ImageBox;
pub use memory_estimate::MemoryEstimate;
pub(crate) use memory_estimate::megabytes;
pub use model::{Model, ModelSizes, UNUSED};
pub use picture::open_picture;
pub use preview::LatentColours;
pub use resize::Bicubic;
pub use sampler::{Moment, Predictor, SamplerSettings, Sampling};
pub use schedule::{Ddim, Schedule, TIMES};
pub use score::Score;
pub use spatial_aware::{SpatialAware, SpatialAwareSizes};
pub use spatial_net::{SpatialNet, SpatialSizes};
pub use subject::Subject;
pub use target_encoder::{EncoderSizes, TargetEncoder};
pub use training::{Batch, BatchGradients, Detector, Draw, Plan, Step, Training, encode, subject_of};
pub use unet::{Unet, UnetSizes};
pub use volume::{VolumePath, VolumeSizes};
pub use weights::{FileWeights, Report};

use gradreel::{Device, Result, Tensor, Var};

/// A constant on the tape and device and in the dtype of another variable.
fn constant(like: &Var, value: Tensor) -> Result<Var> {
    Ok(like.tape().constant(value.cast(like.dtype())?.to_device(&like.device())?))
}

/// The value of a variable, on the CPU.
fn on_cpu(x: &Var) -> Result<Tensor> {
    x.value()?.to_device(&Device::Cpu)
}
