//! What the views of a film will cost, before any is made.

use std::time::Instant;

use gradreel::{DType, Key, Result, Tape, Tensor};

use crate::views::ModelSizes;

/// Side of the matrices whose product tells the machine's speed.
const SIDE: usize = 384;

/// Products that are timed; the fastest counts.
const TRIALS: usize = 3;

/// Work of a network beside its convolutions, as a share of theirs: attention, normalisation.
const BESIDE: f64 = 1.3;

/// The speed of a network's convolutions as a share of that of a large matrix product.
const REACHED: f64 = 0.2;

/// Multiplications of one view in one step, without guidance, to a factor of about 2: the convolutions of the UNet and of the frustum's
/// network, and the view's share of the volume's.
pub(super) fn of_view(sizes: &ModelSizes) -> f64 {
    let (unet, volume, width) = (&sizes.denoiser.unet, &sizes.denoiser.volume, sizes.latent_width());
    let flat = |(level, multiplier): (usize, &usize)| {
        let (channels, side) = ((unet.base * multiplier) as f64, (width >> level).max(1) as f64);
        // two residual blocks on the way down, three that also receive as many channels on the way up
        side * side * channels * channels * 9.0 * (4.0 + 9.0)
    };
    // two convolutions on the way down a level, two on the way up
    let solid = |channels: &[usize; 4], cells: f64| -> f64 {
        let level = |(level, channels): (usize, &usize)| {
            cells / 8f64.powi(level as i32) * (channels * channels) as f64 * 27.0 * 4.0
        };
        channels.iter().enumerate().map(level).sum()
    };
    let frustum = solid(&volume.frustum, (volume.depth * width * width) as f64);
    let shared = solid(&volume.spatial, volume.voxels.pow(3) as f64) / sizes.denoiser.ring.views as f64;
    BESIDE * (unet.multipliers.iter().enumerate().map(flat).sum::<f64>() + frustum + shared)
}

/// Seconds that so many views of so many steps will take on this machine, to a factor of about 2.
///
/// # Errors
/// When a tensor cannot be made.
pub(super) fn seconds(sizes: &ModelSizes, guided: bool, views: usize, steps: usize) -> Result<f64> {
    let twice = if guided { 2.0 } else { 1.0 };
    Ok(of_view(sizes) * twice * (views * steps) as f64 / (REACHED * rate()?))
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
        assert!(large > 50.0 * small, "{large:.1e} after {small:.1e}");
        // the published model takes about a hundred thousand million multiplications a view
        assert!((2e10..3e11).contains(&large), "{large:.1e}");
    }
}
