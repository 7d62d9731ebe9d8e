//! The box in the input image lifted into space, and the resulting voxel weights.

use crate::views::{Detection, Ring};

/// Minimum depth in front of a camera.
pub(super) const NEAR: f64 = 1e-4;

impl Ring {
    /// Mask of the `size³` voxels that the object may occupy, in the order of [`Ring::voxels`]: the part of the
    /// cube inside the frustum of the box, seen from the input camera at this elevation (radians, azimuth 0),
    /// limited to the object's depth range if known.
    pub fn covered(&self, size: usize, elevation: f64, seen: &Detection) -> Vec<bool> {
        self.covered_widely(size, elevation, seen, 0.0)
    }

    /// As [`Ring::covered`], with a margin on all sides, as a share of the image.
    fn covered_widely(&self, size: usize, elevation: f64, seen: &Detection, margin: f64) -> Vec<bool> {
        let (pose, bounds) = (self.input_pose(elevation), seen.bounds.padded(margin));
        let [near, far] = seen.depths(self, margin).unwrap_or([NEAR, f64::INFINITY]);
        let within = |at: f64, axis: usize| (bounds.low[axis]..=bounds.high[axis]).contains(&at);
        self.voxels(size)
            .map(|voxel| {
                let [u, v, depth] = self.project(&pose, voxel, 1);
                depth > NEAR && (near..=far).contains(&depth) && within(u, 0) && within(v, 1)
            })
            .collect()
    }
}

/// φ of every voxel: 1 in the box, `least` outside, and 1 everywhere without a box.
pub(super) fn weights(
    ring: &Ring,
    size: usize,
    seen: Option<&Detection>,
    elevation: f64,
    [margin, least]: [f64; 2],
) -> Vec<f64> {
    match seen {
        None => vec![1.0; size * size * size],
        Some(seen) => {
            let covered = ring.covered_widely(size, elevation, seen, margin);
            covered.into_iter().map(|inside| if inside { 1.0 } else { least }).collect()
        }
    }
}
