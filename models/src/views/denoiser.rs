//! The multi-view denoiser: predicts the noise in all views from one spatial volume, its frustum volumes and a
//! UNet.

use gradreel::{Result, Tape, Tensor, Var};
use serde::{Deserialize, Serialize};

use super::spatial_aware::Surroundings;
use super::{Detection, Ring, Schedule, SpatialAware, SpatialAwareSizes, Unet, UnetSizes, VolumePath, VolumeSizes};
use crate::layers::{Linear, Scope, TimeEmbedding};

/// The sizes of the multi-view model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DenoiserSizes {
    /// The cameras of the target views.
    pub ring: Ring,
    /// The UNet.
    pub unet: UnetSizes,
    /// The volume side.
    pub volume: VolumeSizes,
    /// The spatial-aware module, which aligns the object with the input image; the published model has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spatial_aware: Option<SpatialAwareSizes>,
    /// Prediction target of the UNet; the published model predicts the noise.
    #[serde(default, skip_serializing_if = "Output::is_noise")]
    pub output: Output,
}

/// Prediction target of the UNet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Output {
    /// The noise ε.
    #[default]
    Noise,
    /// The clean latents x₀; the noise is `(x_t − √ᾱ x₀) / √(1 − ᾱ)`. A network of few channels then need not carry
    /// the noise of its input through (Li and He 2025).
    Clean,
}

impl Output {
    fn is_noise(&self) -> bool {
        *self == Self::Noise
    }
}

impl DenoiserSizes {
    /// The published model: 16 views.
    pub fn published() -> Self {
        let (unet, volume) = (UnetSizes::PUBLISHED, VolumeSizes::PUBLISHED);
        Self { ring: Ring::published(16), unet, volume, spatial_aware: None, output: Output::Noise }
    }
}

/// Conditioning on the input image.
pub struct Condition {
    /// CLIP embedding `[b, 1, context]`.
    pub embedding: Var,
    /// Latent `[b, latent, w, w]`, not scaled by [`super::Coding::scale`].
    pub latent: Var,
    /// Elevation of its camera in radians, per sample.
    pub elevations: Vec<f64>,
    /// Detections for the spatial-aware module: one per sample, or none at all.
    pub boxes: Vec<Option<Detection>>,
}

/// The trained parts of the diffusion: UNet, volume path, time embedding, projection of the context token.
pub struct Denoiser {
    time: TimeEmbedding,
    volumes: VolumePath,
    projection: Linear,
    unet: Unet,
    spatial_aware: Option<SpatialAware>,
    output: Output,
}

impl Denoiser {
    /// Builds the model from the weights at a scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: &DenoiserSizes) -> Result<Self> {
        let (time, context) = (sizes.volume.time, sizes.unet.context);
        let aware =
            |of: &SpatialAwareSizes| SpatialAware::new(&scope.at("spatial_aware"), of, &sizes.volume, &sizes.ring);
        Ok(Self {
            time: TimeEmbedding::new(&scope.at("time_embed"), time, time)?,
            volumes: VolumePath::new(&scope.at("spatial_volume"), sizes.volume, sizes.ring.clone())?,
            projection: Linear::new(&scope.at("cc_projection"), context + 4, context)?,
            unet: Unet::new(&scope.at("model.diffusion_model"), &sizes.unet)?,
            spatial_aware: sizes.spatial_aware.as_ref().map(aware).transpose()?,
            output: sizes.output,
        })
    }

    /// The cameras of the target views.
    pub fn ring(&self) -> &Ring {
        self.volumes.ring()
    }

    /// The context tokens `[b, 1, context]` for viewpoints `[b, 4]`.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the model.
    #[track_caller]
    pub fn tokens(&self, embedding: &Var, viewpoints: &Var) -> Var {
        let [batch, four] = viewpoints.dims()[..] else { panic!("viewpoints are [b, 4]") };
        self.projection.forward(&embedding.concat(&[&viewpoints.reshape([batch, 1, four])], 2))
    }

    /// Prepares one evaluation: the spatial volumes of all noised views `[b, views, latent, w, w]`, with one
    /// diffusion time per sample.
    ///
    /// # Errors
    /// If sampling positions or features cannot be moved to the views' device.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the model.
    #[track_caller]
    pub fn look(&self, noised: &Var, times: &[usize], condition: &Condition) -> Result<Look> {
        let times: Vec<f64> = times.iter().map(|t| *t as f64).collect();
        let time = self.time.forward(noised, &times)?;
        let viewpoints = self.volumes.viewpoints(noised, &condition.elevations)?;
        let mut unprojected = self.volumes.unproject(noised, &time, &viewpoints)?;
        if let Some(input) = self.volumes.unproject_input(&condition.latent, &time, &condition.elevations)? {
            unprojected = unprojected.concat(&[&input], 1);
        }
        let mut volume = self.volumes.spatial_volume(&unprojected, &time)?;
        if let Some(module) = &self.spatial_aware {
            let given = Surroundings {
                noised,
                time: &time,
                viewpoints: &viewpoints,
                elevations: &condition.elevations,
                boxes: &condition.boxes,
            };
            volume = module.correct(&volume, &given)?;
        }
        Ok(Look { noised: noised.clone(), times, time, viewpoints, volume })
    }

    /// The noise in some views, `[targets.len(), latent, w, w]`, with classifier-free guidance of this strength (1:
    /// none). `ε = ε_u + s (ε_c − ε_u)`; the unconditional branch receives zeros for token, latent and volumes.
    ///
    /// # Errors
    /// As [`Denoiser::look`].
    ///
    /// # Panics
    /// If a sample or view does not exist.
    #[track_caller]
    pub fn noise(&self, look: &Look, condition: &Condition, targets: &[Target], guidance: f64) -> Result<Var> {
        let predicted = self.predict(look, condition, targets, &[], guidance)?;
        if self.output.is_noise() {
            return Ok(predicted);
        }
        let times = look.times_of(targets);
        let [clean, noise] = weights(&predicted, &times)?;
        Ok(&(&of_targets(&look.noised, targets) - &(&predicted * &clean)) / &noise)
    }

    /// The UNet's output for some views with conditions dropped as in `told`, which is empty or has one entry per
    /// target.
    #[track_caller]
    fn predict(
        &self,
        look: &Look,
        condition: &Condition,
        targets: &[Target],
        told: &[Told],
        guidance: f64,
    ) -> Result<Var> {
        let width = *look.noised.dims().last().expect("noised views are [b, views, c, h, w]");
        let of_sample =
            |x: &Var| stacked(&targets.iter().map(|t| x.slice(0, t.sample..t.sample + 1)).collect::<Vec<_>>());
        let x = of_targets(&look.noised, targets);
        let viewpoints = of_targets(&look.viewpoints, targets);
        let seen = |run: &[Target]| {
            let sample = run[0].sample;
            let views: Vec<usize> = run.iter().map(|t| t.view).collect();
            self.volumes.frustum_samples(&look.volume.slice(0, sample..sample + 1), &views, width)
        };
        let samples: Vec<Var> = targets.chunk_by(|a, b| a.sample == b.sample).map(seen).collect::<Result<_>>()?;
        let pyramid = self.volumes.pyramid(&stacked(&samples), &of_sample(&look.time), &viewpoints)?;
        let [a, b, c, d] = pyramid.each_ref().map(|volume| where_told(volume, told, Told::volumes));
        let pyramid = [a?, b?, c?, d?];
        let times = look.times_of(targets);
        let token = where_told(&self.tokens(&of_sample(&condition.embedding), &viewpoints), told, Told::token)?;
        let image = where_told(&of_sample(&condition.latent), told, Told::image)?;
        let conditional = self.unet.forward(&x.concat(&[&image], 1), &times, &token, Some(&pyramid))?;
        if guidance == 1.0 {
            return Ok(conditional);
        }
        let nothing = self.unet.forward(&x.concat(&[&(&image * 0.0)], 1), &times, &(&token * 0.0), None)?;
        Ok(&nothing + &(&(&conditional - &nothing) * guidance))
    }

    /// The training loss: all views of each sample are noised at one time, some views are predicted (one per sample
    /// in the published training), and the loss is the mean squared error of the UNet's output. Returns the loss
    /// and the prediction.
    ///
    /// `x0` and `noise` are `[b, views, latent, w, w]`, with one time per sample; targets of one sample must be
    /// adjacent. `told` gives the conditions of each target; empty means all.
    ///
    /// # Errors
    /// As [`Denoiser::look`].
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the model, or a time or view does not exist.
    #[track_caller]
    pub fn loss(
        &self,
        schedule: &Schedule,
        [x0, noise]: [&Var; 2],
        times: &[usize],
        targets: &[Target],
        condition: &Condition,
        told: &[Told],
    ) -> Result<[Var; 2]> {
        let noised = schedule.add_noise(x0, noise, times)?;
        let look = self.look(&noised, times, condition)?;
        let predicted = self.predict(&look, condition, targets, told, 1.0)?;
        let loss = match self.output {
            Output::Noise => (&predicted - &of_targets(noise, targets)).square().mean_all(),
            Output::Clean => (&predicted - &of_targets(x0, targets)).square().mean_all(),
        };
        Ok([loss, predicted])
    }
}

/// One view of one sample of the batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Target {
    /// Which of the batch.
    pub sample: usize,
    /// Which of its views.
    pub view: usize,
}

/// Conditions given to the model for a training sample. Classifier-free guidance requires training with dropped
/// conditions (Ho and Salimans 2022).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Told {
    /// Everything.
    All,
    /// All but the latent of the input image.
    NoImage,
    /// All but the frustum volumes.
    NoVolumes,
    /// All but the context token.
    NoToken,
    /// None of the three.
    Nothing,
}

impl Told {
    fn image(self) -> bool {
        !matches!(self, Self::NoImage | Self::Nothing)
    }

    fn volumes(self) -> bool {
        !matches!(self, Self::NoVolumes | Self::Nothing)
    }

    fn token(self) -> bool {
        !matches!(self, Self::NoToken | Self::Nothing)
    }
}

/// `x` with zeros for those samples whose condition is dropped.
fn where_told(x: &Var, told: &[Told], is_told: fn(Told) -> bool) -> Result<Var> {
    if told.iter().all(|one| is_told(*one)) {
        return Ok(x.clone());
    }
    let mut shape = vec![1; x.dims().len()];
    shape[0] = told.len();
    let mask: Vec<f64> = told.iter().map(|one| f64::from(u8::from(is_told(*one)))).collect();
    Ok(x * &super::constant(x, Tensor::from_vec(mask, shape))?)
}

/// Precomputed state of one evaluation of all views.
pub struct Look {
    noised: Var,
    times: Vec<f64>,
    time: Var,
    viewpoints: Var,
    /// The spatial volumes `[b, c, v, v, v]`.
    pub volume: Var,
}

/// A [`Look`] as plain tensors, which can be sent to other threads.
pub(super) struct Sight {
    noised: Tensor,
    times: Vec<f64>,
    time: Tensor,
    viewpoints: Tensor,
    volume: Tensor,
}

impl Look {
    fn times_of(&self, targets: &[Target]) -> Vec<f64> {
        targets.iter().map(|target| self.times[target.sample]).collect()
    }

    pub(super) fn sight(&self) -> Result<Sight> {
        Ok(Sight {
            noised: self.noised.value()?.clone(),
            times: self.times.clone(),
            time: self.time.value()?.clone(),
            viewpoints: self.viewpoints.value()?.clone(),
            volume: self.volume.value()?.clone(),
        })
    }

    pub(super) fn of(tape: &Tape, sight: &Sight) -> Self {
        let constant = |tensor: &Tensor| tape.constant(tensor.clone());
        Self {
            noised: constant(&sight.noised),
            times: sight.times.clone(),
            time: constant(&sight.time),
            viewpoints: constant(&sight.viewpoints),
            volume: constant(&sight.volume),
        }
    }
}

/// `√ᾱ` and `√(1 − ᾱ)` for some diffusion times, each `[n, 1, 1, 1]`, on the device of `like`.
fn weights(like: &Var, times: &[f64]) -> Result<[Var; 2]> {
    let schedule = Schedule::published();
    let each = |which: usize| {
        let values: Vec<f64> = times.iter().map(|time| schedule.weights(*time as usize)[which]).collect();
        super::constant(like, Tensor::from_vec(values, [times.len(), 1, 1, 1]))
    };
    Ok([each(0)?, each(1)?])
}

/// Selects the targets of a per-view quantity: `[b, views, …]` to `[n, …]`.
#[track_caller]
fn of_targets(x: &Var, targets: &[Target]) -> Var {
    let each = |t: &Target| x.slice(0, t.sample..t.sample + 1).select(1, t.view);
    stacked(&targets.iter().map(each).collect::<Vec<_>>())
}

/// Concatenates variables along the first axis.
#[track_caller]
fn stacked(parts: &[Var]) -> Var {
    parts[0].concat(&parts[1..].iter().collect::<Vec<_>>(), 0)
}
