//! The box in the input image lifted into space, and the weights that it gives to voxels.

use crate::views::{ImageBox, Ring};

/// Nearest depth that a camera sees.
pub(super) const NEAR: f64 = 1e-4;

impl Ring {
    /// Which of `size³` voxels an image's box covers, in the order of [`Ring::voxels`]: the part of the cube that the input
    /// camera at this elevation (radians, azimuth 0) sees through the box. Nothing bounds the depth.
    pub fn covered(&self, size: usize, elevation: f64, seen: &ImageBox) -> Vec<bool> {
        let pose = self.input_pose(elevation);
        let within = |at: f64, axis: usize| (seen.low[axis]..=seen.high[axis]).contains(&at);
        self.voxels(size)
            .map(|voxel| {
                let [u, v, depth] = self.project(&pose, voxel, 1);
                depth > NEAR && within(u, 0) && within(v, 1)
            })
            .collect()
    }
}

/// φ of every voxel: 1 in the box, `least` outside, and 1 everywhere where there is no box.
pub(super) fn weights(
    ring: &Ring,
    size: usize,
    seen: Option<&ImageBox>,
    elevation: f64,
    [margin, least]: [f64; 2],
) -> Vec<f64> {
    match seen {
        None => vec![1.0; size * size * size],
        Some(seen) => {
            let covered = ring.covered(size, elevation, &seen.padded(margin));
            covered.into_iter().map(|inside| if inside { 1.0 } else { least }).collect()
        }
    }
}
