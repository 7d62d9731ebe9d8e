//! How much memory sampling takes, and how many views may run at once within a budget.

use gradreel::{Error, ErrorKind, Result};

use super::DenoiserSizes;

/// Bytes that sampling holds beside the weights, estimated from the sizes of the largest activations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Footprint {
    /// What all views of a step share, at its largest: the un-projected volume on its way through the spatial net.
    pub shared: usize,
    /// What each view that runs adds: its frustum on its way through the frustum net and the depth-wise attention, and the
    /// UNet's own images.
    pub view: usize,
    /// The largest single array of one view.
    pub largest: usize,
}

impl Footprint {
    /// The estimate for latents of `width²` in numbers of so many bytes.
    pub fn of(sizes: &DenoiserSizes, width: usize, number: usize) -> Self {
        let (volume, unet) = (&sizes.volume, &sizes.unet);
        let voxels = volume.voxels.pow(3) * number;
        let unprojected = sizes.ring.views * volume.features * voxels;
        let frustum = volume.depth * width * width * number;
        // four heads of half as many channels each, for keys and for values
        let keys = 2 * volume.frustum[0] * frustum;
        let (wide, pixels) = (unet.base * unet.multipliers[0], width * width * number);
        Self {
            shared: 3 * unprojected + 4 * volume.spatial[0] * voxels,
            // pyramid, its normalised copies, keys and values; skips, gates of the transformers
            view: 4 * volume.frustum[0] * frustum + 2 * keys + 30 * wide * pixels,
            largest: keys.max(8 * wide * pixels),
        }
    }

    /// Bytes held at most with so many views at once.
    pub fn total(&self, at_once: usize) -> usize {
        self.shared.max(self.shared / 4 + at_once * self.view)
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
