//! Coverage and colour of the pixels along the contour.
//!
//! A pixel on the contour mixes object and background, `I = α F + (1 − α) B` in linear light. `F` is the mean
//! colour of nearby interior pixels; `B` is the plate, darkened like nearby exterior pixels. `α` is the projection
//! of `I` on the line from `B` to `F`; the object's colour is what remains after subtracting `(1 − α) B`.

use super::Mask;
use super::change::FLOOR;

/// Radius and Gaussian width of the local means \[pixels\].
const REACH: isize = 4;
const SPREAD: f32 = 1.5;
/// Distance of `F` and `B` in linear light above which the projection is fully trusted.
const TRUSTED: f32 = 0.03;

/// Per pixel, the unmixed colour in linear light (`None`: the image's own colour), and alpha.
pub(super) fn refine(mask: &Mask, seen: &[[f32; 3]], empty: &[[f32; 3]]) -> (Vec<Option<[f32; 3]>>, Vec<f32>) {
    let (width, height) = (mask.width as isize, mask.height as isize);
    // A pixel is on the contour if its 3×3 neighbourhood is mixed.
    let mixed: Vec<bool> = (0..seen.len())
        .map(|pixel| {
            let inside = mask.inside[pixel];
            window(pixel, width, height, 1).any(|(neighbour, _, _)| mask.inside[neighbour] != inside)
        })
        .collect();
    let mut colour = vec![None; seen.len()];
    let mut alpha: Vec<f32> = mask.inside.iter().map(|&inside| if inside { 1.0 } else { 0.0 }).collect();
    for pixel in (0..seen.len()).filter(|&pixel| mixed[pixel]) {
        let mut object = Mean::default();
        let mut light = Mean::default();
        for (neighbour, dx, dy) in window(pixel, width, height, REACH) {
            if mixed[neighbour] {
                continue;
            }
            let weight = (-((dx * dx + dy * dy) as f32) / (2.0 * SPREAD * SPREAD)).exp();
            if mask.inside[neighbour] {
                object.add(weight, seen[neighbour]);
            } else {
                light.add(weight, [0, 1, 2].map(|c| (seen[neighbour][c] + FLOOR) / (empty[neighbour][c] + FLOOR)));
            }
        }
        let Some(object) = object.value() else {
            // Thin parts have no interior: keep the image's own colour.
            continue;
        };
        let light = light.value().unwrap_or([1.0; 3]);
        let back = [0, 1, 2].map(|c| (light[c] * (empty[pixel][c] + FLOOR) - FLOOR).max(0.0));
        let a = coverage(seen[pixel], object, back, alpha[pixel]);
        alpha[pixel] = a;
        // Below one half the division amplifies noise: blend towards the interior colour.
        let trust = (2.0 * a - 1.0).clamp(0.0, 1.0);
        let clean = [0, 1, 2].map(|c| (seen[pixel][c] - (1.0 - a) * back[c]) / a.max(0.5));
        colour[pixel] = Some([0, 1, 2].map(|c| (trust * clean[c] + (1.0 - trust) * object[c]).clamp(0.0, 1.0)));
    }
    (colour, alpha)
}

/// Projection of a colour on the line from background to object; if these are alike, the mask's own value.
fn coverage(seen: [f32; 3], object: [f32; 3], back: [f32; 3], verdict: f32) -> f32 {
    let span = [0, 1, 2].map(|c| object[c] - back[c]);
    let length2: f32 = span.iter().map(|s| s * s).sum();
    let along: f32 = (0..3).map(|c| (seen[c] - back[c]) * span[c]).sum();
    let trust = (length2 / (TRUSTED * TRUSTED)).min(1.0);
    let projected = (along / length2.max(1e-9)).clamp(0.0, 1.0);
    trust * projected + (1.0 - trust) * verdict
}

/// Pixels within `reach` of one, with their offsets.
fn window(pixel: usize, width: isize, height: isize, reach: isize) -> impl Iterator<Item = (usize, isize, isize)> {
    let (x, y) = (pixel as isize % width, pixel as isize / width);
    (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| (dx, dy))).filter_map(move |(dx, dy)| {
        let (x, y) = (x + dx, y + dy);
        ((0..width).contains(&x) && (0..height).contains(&y)).then_some(((y * width + x) as usize, dx, dy))
    })
}

/// A weighted mean of three channels.
#[derive(Default)]
struct Mean {
    sum: [f32; 3],
    weight: f32,
}

impl Mean {
    fn add(&mut self, weight: f32, value: [f32; 3]) {
        for (sum, value) in self.sum.iter_mut().zip(value) {
            *sum += weight * value;
        }
        self.weight += weight;
    }

    fn value(&self) -> Option<[f32; 3]> {
        (self.weight > 0.0).then(|| self.sum.map(|s| s / self.weight))
    }
}
