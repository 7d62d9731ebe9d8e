//! Samples side by side, with what the loss needs of their truth.

use gradreel::Tensor;

use super::features::CHANNELS;
use super::picture::{PIXELS, SIZE};
use super::sample::Sample;

/// A batch of samples as tensors of `f32`.
#[derive(Debug, Clone)]
pub(crate) struct Batch {
    /// `[b, CHANNELS, SIZE, SIZE]`
    pub features: Tensor,
    /// True front and back: `[b, SIZE, SIZE]`.
    pub depths: [Tensor; 2],
    /// 1 where the truth is known: `[b, SIZE, SIZE]`.
    pub mask: Tensor,
    /// The mask divided by its sum in each picture and by the number of pictures: all sum up to 1.
    pub weights: Tensor,
    /// True slopes of the front per diameter in squares of 2×2 pixels, and where they count: `[b, 2, SIZE/2, SIZE/2]`. These
    /// weights sum up to 1 for each direction.
    pub slopes: [Tensor; 2],
}

/// Steepest slope that is learnt from; steeper ones are jumps.
const STEEPEST: f32 = 3.0;

impl Batch {
    /// The batch of some samples.
    pub fn of(samples: &[Sample]) -> Self {
        let (batch, half) = (samples.len(), SIZE / 2);
        let joined = |plane: &dyn Fn(&Sample) -> Vec<f32>| samples.iter().flat_map(plane).collect::<Vec<f32>>();
        let maps = |plane: &dyn Fn(&Sample) -> Vec<f32>| Tensor::from_vec(joined(plane), [batch, SIZE, SIZE]);
        let weights = |sample: &Sample| {
            let scale = 1.0 / (sample.weights.iter().sum::<f32>().max(1.0) * batch as f32);
            sample.weights.iter().map(|w| w * scale).collect()
        };
        let (mut slopes, mut counted) = (Vec::new(), Vec::new());
        for sample in samples {
            let (values, counts) = slopes_of(sample);
            slopes.extend(values);
            counted.extend(counts);
        }
        let scale = 2.0 / counted.iter().sum::<f32>().max(1.0);
        counted.iter_mut().for_each(|count| *count *= scale);
        Self {
            features: Tensor::from_vec(joined(&|s| s.features.clone()), [batch, CHANNELS, SIZE, SIZE]),
            depths: [0, 1].map(|k| maps(&|s: &Sample| s.depths[k].clone())),
            mask: maps(&|s| s.weights.clone()),
            weights: maps(&weights),
            slopes: [slopes, counted].map(|values| Tensor::from_vec(values, [batch, 2, half, half])),
        }
    }

    /// Number of samples.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.mask.dims()[0]
    }
}

/// Slopes of the front of a sample, to the right and then downwards, and 1 where all four pixels are known and it is no jump.
fn slopes_of(sample: &Sample) -> (Vec<f32>, Vec<f32>) {
    let half = SIZE / 2;
    let count: f32 = sample.features[super::features::MASK * PIXELS..][..PIXELS].iter().sum();
    // pixels of a diameter
    let diameter = 2.0 * (count / std::f32::consts::PI).sqrt();
    let (mut values, mut counts) = (vec![0.0; 2 * half * half], vec![0.0; 2 * half * half]);
    for row in 0..half {
        for column in 0..half {
            let corner = 2 * row * SIZE + 2 * column;
            let four = [corner, corner + 1, corner + SIZE, corner + SIZE + 1];
            let [a, b, c, d] = four.map(|pixel| sample.depths[0][pixel]);
            let slope = [b + d - a - c, c + d - a - b].map(|difference| 0.5 * difference * diameter);
            let known = four.iter().all(|&pixel| sample.weights[pixel] > 0.0);
            if known && slope.iter().all(|s| s.abs() < STEEPEST) {
                for (direction, slope) in slope.into_iter().enumerate() {
                    let at = (direction * half + row) * half + column;
                    (values[at], counts[at]) = (slope, 1.0);
                }
            }
        }
    }
    (values, counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::features::MASK;

    /// A plane `z = 0.5 x − 0.25 y` in diameters has these slopes everywhere.
    #[test]
    fn slopes_are_those_of_a_plane() {
        let inside = |pixel: usize| (8..56).contains(&(pixel % SIZE)) && (16..48).contains(&(pixel / SIZE));
        let count = (48 * 32) as f32;
        let diameter = 2.0 * (count / std::f32::consts::PI).sqrt();
        let weights: Vec<f32> = (0..PIXELS).map(|pixel| f32::from(u8::from(inside(pixel)))).collect();
        let mut features = vec![0.0; CHANNELS * PIXELS];
        features[MASK * PIXELS..][..PIXELS].copy_from_slice(&weights);
        let plane = |pixel: usize| (0.5 * (pixel % SIZE) as f32 - 0.25 * (pixel / SIZE) as f32) / diameter;
        let depth: Vec<f32> = (0..PIXELS).map(|pixel| if inside(pixel) { plane(pixel) } else { 0.0 }).collect();
        let sample = Sample { features, depths: [depth.clone(), depth], weights, angle: 0.2 };
        let batch = Batch::of(&[sample.clone(), sample]);
        assert_eq!(batch.len(), 2);
        let [slopes, counted] = batch.slopes.each_ref().map(|tensor| tensor.slice::<f32>());
        for (at, (slope, weight)) in slopes.iter().zip(counted).enumerate() {
            let wanted = if (at / (SIZE * SIZE / 4)).is_multiple_of(2) { 0.5 } else { -0.25 };
            assert!(*weight == 0.0 || (slope - wanted).abs() < 1e-4, "{slope}");
        }
        assert!((counted.iter().sum::<f32>() - 2.0).abs() < 1e-4);
        assert!((batch.weights.slice::<f32>().iter().sum::<f32>() - 1.0).abs() < 1e-4);
        assert_eq!(counted.iter().filter(|w| **w > 0.0).count(), 2 * 2 * 24 * 16);
    }
}
