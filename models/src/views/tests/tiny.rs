//! A whole model that is as small as its layers allow.

use crate::views::{AutoencoderSizes, ClipSizes, DenoiserSizes, ModelSizes, Ring, Subject, UnetSizes, VolumeSizes};
use gradreel::{DType, Key, Tensor};

use super::procedural::input;

/// Latents of 8 pixels, four views.
pub fn sizes() -> ModelSizes {
    let volumes = [8, 8, 16, 16];
    ModelSizes {
        image: 16,
        crop: 200,
        denoiser: DenoiserSizes {
            ring: Ring::published(4),
            unet: UnetSizes { inputs: 8, outputs: 4, base: 32, multipliers: [1; 4], heads: 2, context: 8, volumes },
            volume: VolumeSizes {
                latent: 4,
                features: 4,
                time: 16,
                spatial: [8, 8, 16, 16],
                frustum: volumes,
                voxels: 8,
                depth: 8,
                input: false,
            },
            spatial_aware: None,
            output: Default::default(),
        },
        autoencoder: AutoencoderSizes { base: 32, multipliers: vec![1, 1], blocks: 1, latent: 4 }.into(),
        clip: Some(ClipSizes { resolution: 14, patch: 7, width: 16, layers: 1, heads: 2, outputs: 8 }),
    }
}

/// What might have been made of a picture.
pub fn subject() -> Subject {
    let latent = input("tiny", "latent", [1, 4, 8, 8]);
    Subject { embedding: input("tiny", "embedding", [1, 1, 8]), latent, elevation: 0.4, seen: None }
}

/// A picture of noise.
pub fn picture() -> Tensor {
    let values = Key::new(5).uniform(3 * 16 * 16).map(|u| 2.0 * u - 1.0);
    Tensor::from_vec(values.collect::<Vec<f64>>(), [1, 3, 16, 16]).cast(DType::F32).unwrap()
}
