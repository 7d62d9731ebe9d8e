//! Weights that are computed from their path and a seed, so that large networks need no large files.

use gradreel::{Shape, Tensor};

/// FNV-1a of the text, then SplitMix64 counters to numbers in −1..1.
pub fn numbers(seed: &str, key: &str, count: usize) -> impl Iterator<Item = f32> {
    let text = format!("{seed}:{key}");
    let hash =
        text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, byte| (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    (1..=count as u64).map(move |i| {
        let mut z = hash.wrapping_add(i.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 40) as f32 * 2f32.powi(-23) - 1.0
    })
}

/// A matrix or kernel has variance 1/n, a scale is near 1, a bias near 0.
pub fn weight(seed: &str, key: &str, shape: &Shape) -> Tensor {
    let dims = shape.dims();
    let random = numbers(seed, key, shape.len());
    let values: Vec<f32> = if dims.len() >= 2 {
        let inputs: usize = dims[1..].iter().product();
        let amplitude = (3.0 / inputs as f64).sqrt() as f32;
        random.map(|r| r * amplitude).collect()
    } else if key.ends_with("weight") {
        random.map(|r| 1.0 + 0.1 * r).collect()
    } else {
        random.map(|r| 0.1 * r).collect()
    };
    Tensor::from_vec(values, shape)
}

#[test]
fn the_first_numbers_are_those_of_the_description() {
    let first: Vec<f32> = numbers("nvs-dev", "time_embed.0.weight", 4).collect();
    assert_eq!(first, [-0.914_799_8, 0.069_127_92, -0.145_730_26, 0.582_809_8]);
}
