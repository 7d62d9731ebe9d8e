//! Preview of latents without decoding: a linear colour map fitted to the input picture.

use faer::prelude::Solve;
use faer::{Mat, Side};
use gradreel::{Result, Tensor};

/// Red, green and blue as linear functions of a latent cell.
///
/// The autoencoder preserves colour almost linearly in its channels. The map is fitted by least squares to the
/// input picture and its latent, since the views share the colours of this picture.
#[derive(Debug, Clone)]
pub struct LatentColours {
    /// Per colour, the channel weights and a constant.
    weights: [Vec<f64>; 3],
    /// Scale of the diffusion's latents.
    scale: f64,
}

impl LatentColours {
    /// Fits the map to a picture `[1, 3, s, s]` and its unscaled latent `[1, latent, w, w]`, where `w` divides `s`.
    /// `scale` is the factor to the diffusion's latents ([`super::Coding::scale`]).
    ///
    /// # Errors
    /// If the tensors cannot be read.
    ///
    /// # Panics
    /// If the latent's width does not divide the picture's.
    #[track_caller]
    pub fn fit(picture: &Tensor, latent: &Tensor, scale: f64) -> Result<Self> {
        let (side, channels, width) = (picture.dims()[3], latent.dims()[1], latent.dims()[3]);
        assert!(width > 0 && side.is_multiple_of(width), "a latent of {width} for a picture of {side} pixels");
        let (pixels, values) = (picture.to_vec()?, latent.to_vec()?);
        let (block, area) = (side / width, width * width);
        let terms = |cell: usize| {
            let channel = |c: usize| values[c * area + cell];
            (0..channels).map(channel).chain([1.0]).collect::<Vec<f64>>()
        };
        let colour = |of: usize, cell: usize| {
            let (top, left) = (cell / width * block, cell % width * block);
            let row = |y: usize| &pixels[(of * side + top + y) * side + left..][..block];
            (0..block).map(|y| row(y).iter().sum::<f64>()).sum::<f64>() / (block * block) as f64
        };
        let count = channels + 1;
        let (mut matrix, mut right) = (Mat::<f64>::zeros(count, count), Mat::<f64>::zeros(count, 3));
        for cell in 0..area {
            let terms = terms(cell);
            for i in 0..count {
                for j in 0..count {
                    matrix[(i, j)] += terms[i] * terms[j];
                }
                for of in 0..3 {
                    right[(i, of)] += terms[i] * colour(of, cell);
                }
            }
        }
        // regularisation: a picture of one colour does not determine the map
        for i in 0..count {
            matrix[(i, i)] += 1e-3 * area as f64;
        }
        let found = match matrix.llt(Side::Lower) {
            Ok(factor) => factor.solve(&right),
            Err(_) => Mat::zeros(count, 3),
        };
        Ok(Self { weights: [0, 1, 2].map(|of| (0..count).map(|i| found[(i, of)]).collect()), scale })
    }

    /// The colours `[3, w, w]` in about −1..1 of each view of scaled latents `[1, views, latent, w, w]`.
    ///
    /// # Errors
    /// If the latents cannot be read.
    ///
    /// # Panics
    /// If the number of channels differs from that of the fit.
    #[track_caller]
    pub fn paint(&self, latents: &Tensor) -> Result<Vec<Tensor>> {
        let [_, _, channels, height, width] = latents.dims()[..] else {
            panic!("latents are [1, views, c, h, w], not {}", latents.shape())
        };
        assert_eq!(channels + 1, self.weights[0].len(), "another number of channels");
        let area = height * width;
        let paint = |view: &[f64]| {
            let colour = |weights: &Vec<f64>, cell: usize| {
                let sum: f64 = (0..channels).map(|c| weights[c] * view[c * area + cell] / self.scale).sum();
                (sum + weights[channels]) as f32
            };
            let values = self.weights.iter().flat_map(|weights| (0..area).map(move |cell| colour(weights, cell)));
            Tensor::from_vec(values.collect::<Vec<f32>>(), [3, height, width])
        };
        Ok(latents.to_vec()?.chunks(channels * area).map(paint).collect())
    }
}

#[cfg(test)]
mod tests {
    use gradreel::Key;

    use super::*;

    #[test]
    fn a_linear_autoencoder_is_found_out() {
        // colours that are linear in the latent: the map reproduces them
        let latent: Vec<f32> = Key::new(1).normal(4 * 36).map(|z| z as f32).collect();
        let truth = [[0.3, -0.2, 0.1, 0.4, 0.05], [0.0, 0.5, -0.3, 0.1, -0.2], [-0.4, 0.1, 0.2, 0.2, 0.3]];
        let colour = |of: usize, cell: usize| {
            (0..4).map(|c| truth[of][c] * f64::from(latent[c * 36 + cell])).sum::<f64>() + truth[of][4]
        };
        let pixels: Vec<f32> = (0..3 * 144)
            .map(|i| {
                let (of, y, x) = (i / 144, i / 12 % 12, i % 12);
                colour(of, y / 2 * 6 + x / 2) as f32
            })
            .collect();
        let latent = Tensor::from_vec(latent.clone(), [1, 4, 6, 6]);
        let map = LatentColours::fit(&Tensor::from_vec(pixels.clone(), [1, 3, 12, 12]), &latent, 0.5).unwrap();
        let scaled: Vec<f32> = latent.slice::<f32>().iter().map(|v| (f64::from(*v) * 0.5) as f32).collect();
        let painted = map.paint(&Tensor::from_vec(scaled, [1, 1, 4, 6, 6])).unwrap();
        assert_eq!((painted.len(), painted[0].dims()), (1, &[3, 6, 6][..]));
        for (i, found) in painted[0].slice::<f32>().iter().enumerate() {
            let wanted = colour(i / 36, i % 36);
            assert!((f64::from(*found) - wanted).abs() < 0.01, "{i}: {found}, not {wanted}");
        }
    }
}
