//! How much memory sampling takes, and how many views may run at once within a budget.

use gradreel::{Error, ErrorKind, Result};

use super::{Coding, ModelSizes};

/// Bytes that sampling holds beside the weights' file, estimated from the sizes of the largest activations and weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// What all views of a step share, at its largest: the un-projected volume on its way through the spatial net.
    pub shared: usize,
    /// What each view that runs adds: the UNet's largest weight, widened and made ready for a minimal filter, beside the
    /// view's frustum and images.
    pub view: usize,
    /// The decoder's pictures, after the sampling.
    pub decoding: usize,
    /// The largest single array of one view.
    pub largest: usize,
}

impl MemoryEstimate {
    /// The estimate for numbers of so many bytes.
    pub fn of(sizes: &ModelSizes, number: usize) -> Self {
        let (volume, unet, width) = (&sizes.denoiser.volume, &sizes.denoiser.unet, sizes.latent_width());
        let voxels = volume.voxels.pow(3) * number;
        let unprojected = sizes.denoiser.ring.views * volume.features * voxels;
        let frustum = volume.frustum[0] * volume.depth * width * width * number;
        let (wide, pixels) = (unet.base * unet.multipliers[0], width * width * number);
        // 3×3 taps of a layer that takes in a skip, and 16 of it as a minimal filter
        let deep = unet.base * unet.multipliers.iter().max().expect("four levels");
        let weight = 2 * deep * deep * (9 + 16) * number;
        let decoder = match &sizes.autoencoder {
            Coding::Learned(sizes) => sizes.base * sizes.multipliers.get(1).unwrap_or(&1),
            Coding::Patches(_) => 3,
        };
        // encoded views and what is gathered of them, the volume combined and corrected
        let aware = sizes.denoiser.spatial_aware.as_ref().map_or(0, |module| {
            let views = sizes.denoiser.ring.views * module.features * width * width * number;
            4 * views + (64 << 20) + 6 * module.widths[0].max(module.features) * voxels
        });
        Self {
            shared: 3 * unprojected + 4 * volume.spatial[0] * voxels + aware,
            // the pyramid and its normalised copies; skips, gates of the transformers
            view: weight + 6 * frustum + 30 * wide * pixels,
            decoding: 8 * decoder * sizes.image * sizes.image * number,
            largest: frustum.max(8 * wide * pixels),
        }
    }

    /// Bytes held at most with so many views at once.
    pub fn total(&self, at_once: usize) -> usize {
        self.shared.max(self.shared / 4 + at_once * self.view).max(self.decoding)
    }

    /// The most views at once, up to `most`, that stay within a budget of bytes.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when not even one does.
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
