//! Detected position of the object, the input of the spatial-aware module.

use gradreel::{Error, ErrorKind, Key, Result};

use super::{ImageBox, Ring};

/// The object in the input image, with its depth if known.
///
/// The box alone gives the direction only. With a depth it becomes a region in space; the object is assumed to be
/// as deep as the longer side of its box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// The box in the input image.
    pub bounds: ImageBox,
    /// Depth of the object's centre along the axis of the input camera, in units of the model (the cube of voxels
    /// has side 1); `None` if only the direction is known.
    pub depth: Option<f64>,
}

impl From<ImageBox> for Detection {
    fn from(bounds: ImageBox) -> Self {
        Self { bounds, depth: None }
    }
}

impl Detection {
    /// Minimum and maximum depth of the object, with a margin as a share of the image.
    pub(super) fn depths(&self, ring: &Ring, margin: f64) -> Option<[f64; 2]> {
        let side = (0..2).map(|axis| self.bounds.high[axis] - self.bounds.low[axis]).fold(0.0, f64::max);
        self.depth.map(|middle| {
            let half = (0.5 * side + margin) * middle / ring.focal;
            [middle - half, middle + half]
        })
    }

    /// With normal noise on the box's sides and the depth: standard deviation `sides` relative to the box, `depth`
    /// relative to the depth.
    #[must_use]
    pub fn jittered(self, sides: f64, depth: f64, key: Key) -> Self {
        let bounds = self.bounds.jittered(sides, key);
        // numbers 0 to 3 move the sides
        let by = key.normal(5).nth(4).expect("five numbers");
        Self { bounds, depth: self.depth.map(|middle| middle * (1.0 + depth * by).max(0.1)) }
    }

    /// Rejects an invalid detection.
    pub(super) fn check(&self) -> Result<()> {
        self.bounds.check()?;
        self.depth.map_or(Ok(()), Self::check_depth)
    }

    /// Rejects an invalid depth.
    pub(crate) fn check_depth(depth: f64) -> Result<()> {
        if depth > 0.0 && depth.is_finite() {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "no object is this far away")
            .found(depth)
            .wanted("a distance in front of the camera, in units of the model, whose cameras are 1.5 from the middle of the cube")
            .fix("give 1.5 for an object in the middle, or leave the distance away if it is not known"))
    }
}
