//! What the views of a film will cost, before any is made.

use std::time::Instant;

use gradreel::{DType, Key, Result, Tape, Tensor};

use crate::views::ModelSizes;

/// Side of the matrices whose product tells the machine's speed.
const SIDE: usize = 384;

/// Products that are timed; the fastest counts.
const TRIALS: usize = 3;

/// Work of a network beside its largest convolutions, as a share of theirs: attention, the volumes, normalisation.
const BESIDE: f64 = 1.6;

/// Multiplications of one view in one step, without guidance, to a factor of about 2: the 3×3 convolutions of the UNet's two paths at
/// four resolutions.
pub(super) fn of_view(sizes: &ModelSizes) -> f64 {
    let (unet, width) = (&sizes.denoiser.unet, sizes.latent_width());
    let level = |(level, multiplier): (usize, &usize)| {
        let (channels, side) = ((unet.base * multiplier) as f64, (width >> level).max(1) as f64);
        // two residual blocks on the way down, three that also receive as many channels on the way up
        side * side * channels * channels * 9.0 * (4.0 + 9.0)
    };
    BESIDE * unet.multipliers.iter().enumerate().map(level).sum::<f64>()
}

/// Seconds that so many views of so many steps will take on this machine, to a factor of about 2.
///
/// # Errors
/// When a tensor cannot be made.
pub(super) fn seconds(sizes: &ModelSizes, guided: bool, views: usize, steps: usize) -> Result<f64> {
    let twice = if guided { 2.0 } else { 1.0 };
    Ok(of_view(sizes) * twice * (views * steps) as f64 / rate()?)
}

/// Multiplications in a second of a matrix product.
fn rate() -> Result<f64> {
    let matrix = |key: u64| Tensor::normal(Key::new(key), [SIDE, SIDE], DType::F32);
    let tape = Tape::new();
    let [a, b] = [matrix(1), matrix(2)].map(|matrix| tape.constant(matrix));
    let mut fastest = f64::INFINITY;
    for _ in 0..TRIALS {
        let since = Instant::now();
        a.matmul(&b).value()?;
        fastest = fastest.min(since.elapsed().as_secs_f64());
    }
    Ok((SIDE as f64).powi(3) / fastest.max(1e-6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn larger_models_cost_more() {
        let [small, large] = [ModelSizes::small(), ModelSizes::published()].map(|sizes| of_view(&sizes));
        assert!(large > 100.0 * small, "{large:.1e} after {small:.1e}");
        // the published UNet takes some tens of thousand million multiplications a view
        assert!((2e10..3e11).contains(&large), "{large:.1e}");
    }
}
