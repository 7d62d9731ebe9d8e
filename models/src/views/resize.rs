//! Differentiable bicubic resizing as a linear map of rows and of columns.

use gradreel::{Result, Tensor, Var};

/// Bicubic filter variants; the published tool chain uses both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bicubic {
    /// Corners aligned, a = −0.75, no anti-aliasing, edges repeated.
    Aligned,
    /// Pixel areas aligned, a = −0.5, the support widened when shrinking and truncated at the edges (as image
    /// programs do).
    Area,
}

impl Bicubic {
    /// Weights of `from` samples in each of `to` outputs, row by row.
    fn weights(self, from: usize, to: usize) -> Vec<f64> {
        let mut weights = vec![0.0; from * to];
        for (i, row) in weights.chunks_exact_mut(from).enumerate() {
            match self {
                Self::Aligned => {
                    let place = if to > 1 { i as f64 * (from - 1) as f64 / (to - 1) as f64 } else { 0.0 };
                    let first = place.floor() as i64 - 1;
                    for tap in first..first + 4 {
                        row[tap.clamp(0, from as i64 - 1) as usize] += cubic(place - tap as f64, -0.75);
                    }
                }
                Self::Area => {
                    let scale = from as f64 / to as f64;
                    let wide = scale.max(1.0);
                    let centre = (i as f64 + 0.5) * scale;
                    let first = (centre - 2.0 * wide + 0.5).max(0.0) as usize;
                    let last = ((centre + 2.0 * wide + 0.5) as usize).min(from);
                    for (tap, weight) in row.iter_mut().enumerate().take(last).skip(first) {
                        *weight = cubic((tap as f64 + 0.5 - centre) / wide, -0.5);
                    }
                    let total: f64 = row.iter().sum();
                    row.iter_mut().for_each(|weight| *weight /= total);
                }
            }
        }
        weights
    }

    /// Resizes images `[b, c, h, w]` to `[b, c, height, width]`.
    ///
    /// # Errors
    /// If the weights cannot be moved to the device of the images.
    ///
    /// # Panics
    /// If the images do not have four axes.
    #[track_caller]
    pub fn resize(self, images: &Var, height: usize, width: usize) -> Result<Var> {
        let [batch, channels, rows, columns] = images.dims()[..] else {
            panic!("resize: images are [b, c, h, w], not {}", images.shape())
        };
        let map = |from, to| super::constant(images, Tensor::from_vec(self.weights(from, to), [to, from]));
        let wide = images.reshape([batch * channels * rows, columns]).linear(&map(columns, width)?, None);
        let turned = wide.reshape([batch * channels, rows, width]).permute(&[0, 2, 1]);
        let tall = turned.reshape([batch * channels * width, rows]).linear(&map(rows, height)?, None);
        let back = tall.reshape([batch * channels, width, height]).permute(&[0, 2, 1]);
        Ok(back.reshape([batch, channels, height, width]))
    }
}

/// Keys' cubic convolution kernel.
fn cubic(x: f64, a: f64) -> f64 {
    let x = x.abs();
    if x < 1.0 {
        ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0
    } else if x < 2.0 {
        ((x - 5.0) * x + 8.0) * x * a - 4.0 * a
    } else {
        0.0
    }
}
