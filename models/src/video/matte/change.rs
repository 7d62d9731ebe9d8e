//! How much each pixel changed against the plate, beyond what a shadow does.

/// Light added before taking ratios, so that dark pixels do not drown in noise (share of full scale).
pub(super) const FLOOR: f32 = 0.04;
/// A shadow leaves at least this share of the plate's light …
const DARKEST_SHADOW: f32 = 0.12;
/// … and light reflected by the object adds at most this share.
const BRIGHTEST_REFLECTION: f32 = 1.08;

/// The log ratio of image and plate, `ln((I + ε)/(P + ε))` in linear light, split in brightness and hue.
///
/// A shadow multiplies all channels by about the same factor: it moves the brightness and leaves the hue.
pub(super) struct Change {
    /// Mean of the three log ratios.
    pub brightness: Vec<f32>,
    /// The log ratios without their mean.
    pub hue: Vec<[f32; 3]>,
    /// Evidence for the object, `sqrt(|hue|² + 3 e²)`; `e` is by how much the brightness leaves the range of shadows.
    pub evidence: Vec<f32>,
    /// Standard deviation of the hue, per dimension, where nothing happened.
    pub noise: f32,
}

impl Change {
    pub fn between(seen: &[[f32; 3]], empty: &[[f32; 3]]) -> Change {
        let (low, high) = (DARKEST_SHADOW.ln(), BRIGHTEST_REFLECTION.ln());
        let mut change = Change {
            brightness: Vec::with_capacity(seen.len()),
            hue: Vec::with_capacity(seen.len()),
            evidence: Vec::with_capacity(seen.len()),
            noise: 0.0,
        };
        for (i, p) in seen.iter().zip(empty) {
            let ratio = [0, 1, 2].map(|c| ((i[c] + FLOOR) / (p[c] + FLOOR)).ln());
            let mean = (ratio[0] + ratio[1] + ratio[2]) / 3.0;
            let hue = ratio.map(|r| r - mean);
            let excess = (mean - high).max(0.0) + (low - mean).max(0.0);
            change.brightness.push(mean);
            change.hue.push(hue);
            change.evidence.push((hue.iter().map(|h| h * h).sum::<f32>() + 3.0 * excess * excess).sqrt());
        }
        change.noise = noise(&change.hue);
        change
    }
}

/// From differences of neighbouring pixels, of which only few cross an outline. Pixels equal to the plate to the last
/// bit (a rendered sky) say nothing about noise.
fn noise(hue: &[[f32; 3]]) -> f32 {
    let changed = |h: &[f32; 3]| *h != [0.0; 3];
    let step = |pair: &[[f32; 3]]| (0..3).map(|c| (pair[0][c] - pair[1][c]).powi(2)).sum::<f32>().sqrt();
    let mut steps: Vec<f32> = hue.windows(2).filter(|pair| pair.iter().all(changed)).map(step).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    // Hue has two dimensions: the length of a difference of two samples has its median at 1.18 √2 σ.
    *steps.select_nth_unstable_by(middle, f32::total_cmp).1 / 1.67
}
