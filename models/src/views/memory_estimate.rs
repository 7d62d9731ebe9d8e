//! Memory estimate of sampling, and the number of concurrent views within a budget.

use gradreel::{Error, ErrorKind, Result};

use super::{Coding, ModelSizes};

/// Peak memory of sampling besides the weights' file \[bytes\], estimated from the largest activations and weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Shared by all views of a step: the un-projected volume passing through the spatial net.
    pub shared: usize,
    /// Per concurrent view: the UNet's largest weight, cast and transformed for a minimal filter, and the view's
    /// frustum and images.
    pub view: usize,
    /// Activations of the decoder, after sampling.
    pub decoding: usize,
    /// The largest single array of one view.
    pub largest: usize,
}

impl MemoryEstimate {
    /// The estimate for values of `number` bytes.
    pub fn of(sizes: &ModelSizes, number: usize) -> Self {
        let (volume, unet, width) = (&sizes.denoiser.volume, &sizes.denoiser.unet, sizes.latent_width());
        let voxels = volume.voxels.pow(3) * number;
        let unprojected = sizes.denoiser.ring.views * volume.features * voxels;
        let frustum = volume.frustum[0] * volume.depth * width * width * number;
        let (wide, pixels) = (unet.base * unet.multipliers[0], width * width * number);
        // 9 taps of a 3×3 layer that receives a skip connection, and 16 as a minimal filter
        let deep = unet.base * unet.multipliers.iter().max().expect("four levels");
        let weight = 2 * deep * deep * (9 + 16) * number;
        let decoder = match &sizes.autoencoder {
            Coding::Learned(sizes) => sizes.base * sizes.multipliers.get(1).unwrap_or(&1),
            Coding::Patches(_) => 3,
        };
        // encoded views with gathered features, and the combined and corrected volume
        let aware = sizes.denoiser.spatial_aware.as_ref().map_or(0, |module| {
            let views = sizes.denoiser.ring.views * module.features * width * width * number;
            4 * views + (64 << 20) + 6 * module.widths[0].max(module.features) * voxels
        });
        Self {
            shared: 3 * unprojected + 4 * volume.spatial[0] * voxels + aware,
            // the pyramid with its normalised copies; skip connections and gates of the transformers
            view: weight + 6 * frustum + 30 * wide * pixels,
            decoding: 8 * decoder * sizes.image * sizes.image * number,
            largest: frustum.max(8 * wide * pixels),
        }
    }

    /// Peak memory with this many concurrent views \[bytes\].
    pub fn total(&self, at_once: usize) -> usize {
        self.shared.max(self.shared / 4 + at_once * self.view).max(self.decoding)
    }

    /// Largest number of concurrent views, up to `most`, within a budget in bytes.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if a single view exceeds it.
    pub fn at_once(&self, budget: usize, most: usize) -> Result<usize> {
        let fitting = (1..=most.max(1)).rev().find(|views| self.total(*views) <= budget);
        fitting.ok_or_else(|| {
            Error::new(ErrorKind::Input, "the memory budget does not hold a single view")
                .found(megabytes(budget))
                .wanted(format!("at least {} beside the weights", megabytes(self.total(1))))
                .fix("raise the budget")
        })
    }
}

/// `140 MB`, rounded up.
pub(crate) fn megabytes(bytes: usize) -> String {
    format!("{} MB", bytes.div_ceil(1_000_000))
}
