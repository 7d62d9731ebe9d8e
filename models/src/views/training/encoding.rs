//! Encoding samples of objects as batches of latents.

use gradreel::{Device, Key, Result, Tape, Tensor};
use serde::{Deserialize, Serialize};

use super::Batch;
use crate::layers::Scope;
use crate::views::frozen::Frozen;
use crate::views::objects::{Sample, View};
use crate::views::subject::embed;
use crate::views::{Detection, FileWeights, Model, ModelSizes, Subject, on_cpu};

/// Simulated errors of detected boxes and depths during training: noise and missing detections.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Detector {
    /// Standard deviation of each side, relative to the box.
    pub jitter: f64,
    /// Probability that the box is missing.
    pub missed: f64,
    /// Relative standard deviation of the depth.
    pub depth_jitter: f64,
    /// Probability that the depth of a detected object is unknown.
    pub depth_missed: f64,
}

impl Detector {
    /// Exact boxes and depths.
    pub const EXACT: Self = Self { jitter: 0.0, missed: 0.0, depth_jitter: 0.0, depth_missed: 0.0 };

    /// Exact boxes without depths.
    pub const FLAT: Self = Self { depth_missed: 1.0, ..Self::EXACT };

    fn finds(self, seen: Option<Detection>, key: Key) -> Option<Detection> {
        let [miss, move_by] = key.split();
        let chances: Vec<f64> = miss.uniform(2).collect();
        let seen = seen.filter(|_| chances[0] >= self.missed)?;
        let depth = seen.depth.filter(|_| chances[1] >= self.depth_missed);
        Some(Detection { depth, ..seen }.jittered(self.jitter, self.depth_jitter, move_by))
    }
}

/// Views as images `[n, 3, s, s]`.
fn images(views: &[&View]) -> Tensor {
    let size = views[0].size;
    let values: Vec<f32> = views.iter().flat_map(|view| view.colours.iter().copied()).collect();
    Tensor::from_vec(values, [views.len(), 3, size, size])
}

/// Encodes samples for a training step of a model with these weights. Random numbers depend on `key` only.
///
/// # Errors
/// If a weight is missing or has the wrong shape, or the device fails.
///
/// # Panics
/// If there are no samples, or their images do not have the size of the model.
#[track_caller]
pub fn encode(
    weights: &FileWeights,
    sizes: &ModelSizes,
    samples: &[Sample],
    detector: Detector,
    key: Key,
) -> Result<Batch> {
    let [noise, boxes] = key.split();
    let (count, views) = (samples.len(), sizes.denoiser.ring.views);
    let (width, channels) = (sizes.latent_width(), sizes.autoencoder.channels());
    let tape = Tape::new();
    let weights = weights.on(&tape);
    let frozen = Frozen(&weights);
    let scope = Scope::root(&frozen);
    let coder = Model::coder(&scope, sizes)?;
    let device = weights.device().clone();
    let device = if sizes.clip.is_none() && sizes.autoencoder.scale() == 1.0 { Device::Cpu } else { device };
    let inputs: Vec<&View> = samples.iter().map(|sample| &sample.input).collect();
    let inputs = tape.constant(images(&inputs).to_device(&device)?);
    let seen = coder.encode(&inputs, Some(noise.fold(0)))?;
    let mut latents = Vec::with_capacity(count * views * channels * width * width);
    for (number, sample) in samples.iter().enumerate() {
        let all: Vec<&View> = sample.views.iter().collect();
        let all = tape.constant(images(&all).to_device(&device)?);
        let latent = &coder.encode(&all, Some(noise.fold(number as u64 + 1)))? * sizes.autoencoder.scale();
        latents.extend_from_slice(on_cpu(&latent)?.slice::<f32>());
    }
    Ok(Batch {
        latents: Tensor::from_vec(latents, [count, views, channels, width, width]),
        embeddings: on_cpu(&embed(&scope, sizes, &inputs)?)?,
        images: on_cpu(&seen)?,
        elevations: samples.iter().map(|sample| sample.elevation).collect(),
        boxes: match sizes.denoiser.spatial_aware {
            None => Vec::new(),
            Some(_) => {
                let find = |(i, sample): (usize, &Sample)| {
                    detector.finds(sample.seen(&sizes.denoiser.ring), boxes.fold(i as u64))
                };
                samples.iter().enumerate().map(find).collect()
            }
        },
    })
}

/// The sampler's conditioning on one sample's input image.
///
/// # Errors
/// As [`encode`].
///
/// # Panics
/// As [`encode`].
#[track_caller]
pub fn subject_of(
    weights: &FileWeights,
    sizes: &ModelSizes,
    sample: &Sample,
    detector: Detector,
    key: Key,
) -> Result<Subject> {
    let picture = images(&[&sample.input]);
    let found = Subject::encode(weights, sizes, &picture, sample.elevation, key, weights.device())?;
    Ok(Subject { seen: detector.finds(sample.seen(&sizes.denoiser.ring), key.fold(1)), ..found })
}
