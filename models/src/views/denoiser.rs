//! All noised views at once to the noise in them: one spatial volume, then each view's frustum and denoiser.

use gradreel::{Result, Var};

use super::{Ring, Unet, UnetSizes, VolumePath, VolumeSizes};
use crate::layers::{Linear, Scope, TimeEmbedding};

/// The sizes of the multi-view model.
#[derive(Debug, Clone, PartialEq)]
pub struct DenoiserSizes {
    /// The cameras of the target views.
    pub ring: Ring,
    /// The UNet.
    pub unet: UnetSizes,
    /// The volume side.
    pub volume: VolumeSizes,
}

impl DenoiserSizes {
    /// The published model: 16 views.
    pub fn published() -> Self {
        Self { ring: Ring::published(16), unet: UnetSizes::PUBLISHED, volume: VolumeSizes::PUBLISHED }
    }
}

/// What the model knows about the input image.
pub struct Condition {
    /// CLIP embedding `[b, 1, context]`.
    pub embedding: Var,
    /// Latent `[b, latent, w, w]`, not scaled by [`super::Autoencoder::SCALE`].
    pub latent: Var,
    /// Elevation of its camera in radians, one for each of the batch.
    pub elevations: Vec<f64>,
}

/// The trained parts of the diffusion: UNet, volume side, time embedding, projection of the context token.
pub struct Denoiser {
    time: TimeEmbedding,
    volumes: VolumePath,
    projection: Linear,
    unet: Unet,
}

impl Denoiser {
    /// The model at a scope.
    ///
    /// # Errors
    /// When a weight is missing or mis-shaped.
    pub fn new(scope: &Scope<'_>, sizes: &DenoiserSizes) -> Result<Self> {
        let (time, context) = (sizes.volume.time, sizes.unet.context);
        Ok(Self {
            time: TimeEmbedding::new(&scope.at("time_embed"), time, time)?,
            volumes: VolumePath::new(&scope.at("spatial_volume"), sizes.volume, sizes.ring.clone())?,
            projection: Linear::new(&scope.at("cc_projection"), context + 4, context)?,
            unet: Unet::new(&scope.at("model.diffusion_model"), &sizes.unet)?,
        })
    }

    /// The cameras of the target views.
    pub fn ring(&self) -> &Ring {
        self.volumes.ring()
    }

    /// The context tokens `[b, 1, context]` for viewpoints `[b, 4]`.
    ///
    /// # Panics
    /// When the sizes are not those of the model.
    #[track_caller]
    pub fn tokens(&self, embedding: &Var, viewpoints: &Var) -> Var {
        let [batch, four] = viewpoints.dims()[..] else { panic!("viewpoints are [b, 4]") };
        self.projection.forward(&embedding.concat(&[&viewpoints.reshape([batch, 1, four])], 2))
    }

    /// Prepares one evaluation: the spatial volume of all noised views `[1, views, latent, w, w]` of one sample at a time.
    ///
    /// # Errors
    /// When places or features cannot be moved where the views are.
    ///
    /// # Panics
    /// When the sizes are not those of the model.
    #[track_caller]
    pub fn look(&self, noised: &Var, time: usize, condition: &Condition) -> Result<Look> {
        let time_vector = self.time.forward(noised, &[time as f64])?;
        let viewpoints = self.volumes.viewpoints(noised, &condition.elevations)?;
        let unprojected = self.volumes.unproject(noised, &time_vector, &viewpoints)?;
        let volume = self.volumes.spatial_volume(&unprojected, &time_vector);
        Ok(Look { time, time_vector, viewpoints, volume })
    }

    /// The noise in some of the views, `[views.len(), latent, w, w]`, with classifier-free guidance of this strength
    /// (1: none). `ε = ε_u + s (ε_c − ε_u)`; the unconditional branch sees a token of zeros, a latent of zeros and
    /// volumes of zeros.
    ///
    /// # Errors
    /// As [`Denoiser::look`].
    ///
    /// # Panics
    /// When the sizes are not those of the model, or a view does not exist.
    #[track_caller]
    pub fn noise(&self, noised: &Var, look: &Look, condition: &Condition, views: &[usize], guidance: f64) -> Result<Var> {
        let [_, _, latent, height, width] = noised.dims()[..] else { panic!("noised views are [1, views, c, h, w]") };
        let count = views.len();
        let pick = |x: &Var| {
            let parts: Vec<Var> = views.iter().map(|&view| x.slice(1, view..view + 1)).collect();
            parts[0].concat(&parts[1..].iter().collect::<Vec<_>>(), 1)
        };
        let x = pick(noised).reshape([count, latent, height, width]);
        let viewpoints = pick(&look.viewpoints).reshape([count, 4]);
        let times = vec![look.time as f64; count];
        let time_vectors = look.time_vector.broadcast_to([count, look.time_vector.dims()[1]]);
        let samples = self.volumes.frustum_samples(&look.volume, views, width)?;
        let pyramid = self.volumes.pyramid(&samples, &time_vectors, &viewpoints);
        let embedding = &condition.embedding;
        let token = self.tokens(&embedding.broadcast_to([count, 1, embedding.dims()[2]]), &viewpoints);
        let image = condition.latent.broadcast_to([count, latent, height, width]);
        let conditional = self.unet.forward(&x.concat(&[&image], 1), &times, &token, Some(&pyramid))?;
        if guidance == 1.0 {
            return Ok(conditional);
        }
        let nothing = self.unet.forward(&x.concat(&[&(&image * 0.0)], 1), &times, &(&token * 0.0), None)?;
        Ok(&nothing + &(&(&conditional - &nothing) * guidance))
    }
}

/// What one evaluation of all views has seen.
pub struct Look {
    time: usize,
    time_vector: Var,
    viewpoints: Var,
    /// The spatial volume `[1, c, v, v, v]`.
    pub volume: Var,
}
