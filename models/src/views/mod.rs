//! The unseen views: a multi-view latent diffusion model (SyncDreamer, Liu et al. 2023) whose parameter paths are those
//! of the published checkpoint.
//!
//! ```text
//! noised views → target encoder → un-projection → spatial net → frustum sampling → frustum net ─┐
//! input image → autoencoder → latent ┐                                                          │
//!             → CLIP tower → token ──┴───────────────────────→ UNet ← depth-wise attention ←─────┘
//! ```

mod resize;
mod image;
mod target_encoder;
mod spatial_net;
mod frustum_net;
mod unet;
mod autoencoder;
mod clip;
mod cameras;
mod volume;
mod denoiser;
mod schedule;
mod model;
mod weights;
mod training;

pub use autoencoder::{Autoencoder, AutoencoderSizes, Posterior};
pub use cameras::Ring;
pub use clip::{ClipSizes, ClipTower};
pub use denoiser::{Condition, Denoiser, DenoiserSizes, Look, Target, Told};
pub use frustum_net::{FrustumNet, FrustumSizes};
pub use image::prepare;
pub use model::{Model, ModelSizes, UNUSED};
pub use resize::Bicubic;
pub use schedule::{Ddim, Schedule, TIMES};
pub use spatial_net::{SpatialNet, SpatialSizes};
pub use target_encoder::{EncoderSizes, TargetEncoder};
pub use training::{Batch, BatchGradients, Draw, Plan, Step, Training};
pub use unet::{Unet, UnetSizes};
pub use volume::{VolumePath, VolumeSizes};
pub use weights::{FileWeights, Report};

use gradreel::{Result, Tensor, Var};

/// A tensor on the tape, device and in the dtype of another.
fn constant(like: &Var, value: Tensor) -> Result<Var> {
    Ok(like.tape().constant(value.cast(like.dtype())?.to_device(&like.device())?))
}
