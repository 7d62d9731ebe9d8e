//! Downscaling of frames: box averages over blocks of pixels.

use ndarray::{Array2, Array3};

use super::clip::Frame;

impl Frame {
    /// Averages blocks of `factor` × `factor` pixels; a remainder at the right and lower edge is dropped.
    ///
    /// `rgb` is already composited on white, so its plain average equals the composite of the averaged
    /// premultiplied colour; `alpha` and `weight` are averaged directly.
    ///
    /// # Panics
    /// If the factor is zero or leaves no pixel.
    #[track_caller]
    #[must_use]
    pub fn scaled(&self, factor: usize) -> Frame {
        let (h, w) = self.alpha.dim();
        assert!(
            factor > 0 && h >= factor && w >= factor,
            "Frame::scaled: factor {factor} does not fit an image of {w} × {h} pixels"
        );
        let size = (h / factor, w / factor);
        let by = 1.0 / (factor * factor) as f32;
        let mean = |read: &dyn Fn(usize, usize) -> f32, y: usize, x: usize| {
            let block = (0..factor).flat_map(|j| (0..factor).map(move |i| (y * factor + j, x * factor + i)));
            block.map(|(row, column)| read(row, column)).sum::<f32>() * by
        };
        Frame {
            rgb: Array3::from_shape_fn((size.0, size.1, 3), |(y, x, c)| mean(&|r, q| self.rgb[[r, q, c]], y, x)),
            alpha: Array2::from_shape_fn(size, |(y, x)| mean(&|r, q| self.alpha[[r, q]], y, x)),
            weight: Array2::from_shape_fn(size, |(y, x)| mean(&|r, q| self.weight[[r, q]], y, x)),
        }
    }
}
