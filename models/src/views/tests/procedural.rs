//! Weights that are computed from their path and a seed, so that large networks need no large files.

use gradreel::{Result, Shape, Tape, Tensor, Var};
use gradreel_models::layers::{Init, Weights};
use rayon::prelude::*;

/// FNV-1a of the text, then SplitMix64 counters to numbers in −1..1, each given to `make`.
fn numbers(seed: &str, key: &str, count: usize, make: impl Fn(f32) -> f32 + Sync) -> Vec<f32> {
    let text = format!("{seed}:{key}");
    let hash =
        text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, byte| (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    let mut values = vec![0.0; count];
    const PART: usize = 1 << 16;
    values.par_chunks_mut(PART).enumerate().for_each(|(part, values)| {
        for (i, value) in values.iter_mut().enumerate() {
            let counter = (part * PART + i + 1) as u64;
            let mut z = hash.wrapping_add(counter.wrapping_mul(0x9E37_79B9_7F4A_7C15));
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            z ^= z >> 31;
            *value = make((z >> 40) as f32 * 2f32.powi(-23) - 1.0);
        }
    });
    values
}

/// A matrix or kernel has variance 1/n, a scale is near 1, a bias near 0.
pub fn weight(seed: &str, key: &str, shape: &Shape) -> Tensor {
    let dims = shape.dims();
    let values = if dims.len() >= 2 {
        let inputs: usize = dims[1..].iter().product();
        let amplitude = (3.0 / inputs as f64).sqrt() as f32;
        numbers(seed, key, shape.len(), |r| r * amplitude)
    } else if key.ends_with("weight") {
        numbers(seed, key, shape.len(), |r| 1.0 + 0.1 * r)
    } else {
        numbers(seed, key, shape.len(), |r| 0.1 * r)
    };
    Tensor::from_vec(values, shape)
}

/// An input of variance 1.
pub fn input(seed: &str, name: &str, shape: impl Into<Shape>) -> Tensor {
    let (shape, amplitude) = (shape.into(), 3f64.sqrt() as f32);
    Tensor::from_vec(numbers(seed, &format!("input:{name}"), shape.len(), |r| r * amplitude), shape)
}

/// A network's weights, each made when it is asked for.
pub struct Source {
    pub seed: &'static str,
    pub tape: Tape,
}

impl Weights for Source {
    fn weight(&self, path: &str, shape: &Shape, _: Init) -> Result<Var> {
        Ok(self.tape.constant(weight(self.seed, path, shape)))
    }
}

#[test]
fn the_first_numbers_are_those_of_the_description() {
    let first = numbers("nvs-dev", "time_embed.0.weight", 4, |r| r);
    assert_eq!(first, [-0.914_799_8, 0.069_127_92, -0.145_730_26, 0.582_809_8]);
}
