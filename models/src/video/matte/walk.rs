//! Spreading the evidence: random walker with priors on the pixel grid.
//!
//! The belief `z` that a pixel shows the object minimises
//! `Σ w_ab (z_a − z_b)² + Σ λ_a (z_a − p_a)²` over neighbouring pixels `a, b`, with the prior `p` from the evidence and
//! weights `w` that vanish across sharp changes. (Grady, *Random walks for image segmentation*, 2006, with a prior
//! instead of seeds.) A patch of the floor's hue inside an edge takes the belief of its surroundings; a shadow,
//! which joins the unchanged floor without an edge, takes the floor's.

use super::change::Change;

/// Step of the change between neighbours that counts as an edge.
const EDGE: f32 = 0.1;
/// Weight of a step in brightness relative to one in hue: shadows have steps in brightness, too.
const BRIGHTNESS_SHARE: f32 = 0.5;
/// Minimum coupling of neighbours, which keeps the system connected.
const LEAK: f32 = 1e-3;
/// Strength of the prior in an image of 320 pixels; the inverse of its square root is the range in pixels.
const PRIOR: f32 = 0.01;
/// Over-relaxation of the sweeps.
const OVER: f32 = 1.8;

/// Minimum evidence of the pixels that are solved for, as a share of the evidence at which object and background
/// are equally likely, and the margin around them (share of the image).
const NOTICEABLE: f32 = 0.5;
const MARGIN: f32 = 0.06;

/// Belief of every pixel, 0 (background) … 1 (object). Evidence equal to `even`, or to the noise level if that is
/// larger, gives one half.
pub(super) fn spread(change: &Change, even: f32, weight: &[f32], width: usize, height: usize) -> Vec<f32> {
    let even = even.max(6.0 * change.noise);
    let mut belief = vec![0.0; width * height];
    let Some([left, top, right, bottom]) = window(change, NOTICEABLE * even, width, height) else { return belief };
    let columns = right - left;
    let pixels: Vec<usize> = (top..bottom).flat_map(|y| (y * width + left)..(y * width + right)).collect();
    let scale = 320.0 / width.max(height) as f32;
    let strength = PRIOR * (scale * scale).clamp(0.15, 3.0);
    let prior: Vec<f32> = pixels
        .iter()
        .map(|&i| {
            let odds = (change.evidence[i] / even).powi(3);
            odds / (1.0 + odds)
        })
        .collect();
    let lambda: Vec<f32> =
        prior.iter().zip(&pixels).map(|(p, &i)| weight[i] * strength * ((2.0 * p - 1.0).abs() + 0.02) + 1e-6).collect();
    let edge2 = EDGE * EDGE + (3.0 * change.noise).powi(2);
    let coupling = |a: usize, b: usize| {
        let hue: f32 = (0..2).map(|c| (change.hue[a][c] - change.hue[b][c]).powi(2)).sum();
        let step = BRIGHTNESS_SHARE * (change.brightness[a] - change.brightness[b]);
        (-(hue + 3.0 * step * step) / edge2).exp() + LEAK
    };
    // Coupling to the right and downwards; zero beyond the window.
    let right: Vec<f32> =
        pixels.iter().map(|&i| if i % width + 1 == right { 0.0 } else { coupling(i, i + 1) }).collect();
    let down: Vec<f32> =
        pixels.iter().map(|&i| if i / width + 1 == bottom { 0.0 } else { coupling(i, i + width) }).collect();
    let mut z = prior.clone();
    let sweeps = (80.0 / scale.clamp(0.4, 1.5)) as usize;
    for _ in 0..sweeps {
        if sweep(&mut z, &prior, &lambda, &right, &down, columns) < 1e-3 {
            break;
        }
    }
    for (&pixel, z) in pixels.iter().zip(z) {
        belief[pixel] = z;
    }
    belief
}

/// The rectangle `[left, top, right, bottom]` around all pixels that reach the level together with a neighbour.
fn window(change: &Change, level: f32, width: usize, height: usize) -> Option<[usize; 4]> {
    let reaches = |i: usize| change.evidence[i] > level;
    let mut window: Option<[usize; 4]> = None;
    for i in (0..width * height).filter(|&i| reaches(i)) {
        let (x, y) = (i % width, i / width);
        if (x + 1 < width && reaches(i + 1)) || (y + 1 < height && reaches(i + width)) {
            let [l, t, r, b] = window.unwrap_or([x, y, x, y]);
            window = Some([l.min(x), t.min(y), r.max(x + 1), b.max(y + 1)]);
        }
    }
    let margin = 2 + (MARGIN * width.max(height) as f32) as usize;
    window.map(|[l, t, r, b]| {
        [l.saturating_sub(margin), t.saturating_sub(margin), (r + margin).min(width), (b + margin).min(height)]
    })
}

/// One sweep of successive over-relaxation; returns the largest change.
fn sweep(z: &mut [f32], prior: &[f32], lambda: &[f32], right: &[f32], down: &[f32], width: usize) -> f32 {
    let mut largest = 0.0f32;
    for i in 0..z.len() {
        let mut sum = lambda[i] * prior[i];
        let mut total = lambda[i];
        let mut add = |weight: f32, value: f32| {
            sum += weight * value;
            total += weight;
        };
        if i >= 1 {
            add(right[i - 1], z[i - 1]);
        }
        if i >= width {
            add(down[i - width], z[i - width]);
        }
        if i + 1 < z.len() {
            add(right[i], z[i + 1]);
        }
        if i + width < z.len() {
            add(down[i], z[i + width]);
        }
        let step = OVER * (sum / total - z[i]);
        z[i] += step;
        largest = largest.max(step.abs());
    }
    largest
}
