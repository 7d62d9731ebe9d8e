//! Decoding of sampled latents to pictures.

use gradreel::{Device, Result, Tape, Tensor};

use super::frozen::Frozen;
use super::{Model, ModelSizes, on_cpu};
use crate::layers::{Scope, Weights};

/// Decodes some views of sampled latents `[1, views, latent, w, w]` one at a time; `found` receives each view's
/// index and its picture `[3, s, s]` in about −1..1.
///
/// # Errors
/// If a weight is missing or has the wrong shape, the device fails, or `found` returns an error.
///
/// # Panics
/// If a view does not exist.
#[track_caller]
pub fn decode(
    weights: &dyn Weights,
    sizes: &ModelSizes,
    latents: &Tensor,
    views: &[usize],
    device: &Device,
    found: &mut dyn FnMut(usize, Tensor) -> Result<()>,
) -> Result<()> {
    let frozen = Frozen(weights);
    let coder = Model::coder(&Scope::root(&frozen), sizes)?;
    for &view in views {
        let tape = Tape::new();
        let latent = tape.constant(latents.to_device(device)?).select(0, 0).slice(0, view..view + 1);
        let picture = on_cpu(&coder.decode(&(&latent / sizes.autoencoder.scale())))?;
        let [_, channels, height, width] = picture.dims()[..] else { unreachable!("images are [b, 3, h, w]") };
        found(view, picture.reshape([channels, height, width]))?;
    }
    Ok(())
}
