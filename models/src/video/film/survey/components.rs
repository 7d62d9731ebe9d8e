//! Moving components: connected regions of a picture that differ from the background or from the pictures around.

use rayon::prelude::*;

use super::background::Background;
use super::sequence::{Rgb, Sequence};
use crate::video::matte::neighbours;

/// Lowest threshold of the change, in standard deviations of the smoothed difference, and number of levels, each
/// twice the one before.
const THRESHOLD: f32 = 4.0;
const LEVELS: usize = 5;

/// Least area of a component \[pixels\].
const LEAST_AREA: usize = 5;

/// A component of a higher level counts beside the one around it if it is smaller than this share of it.
const DISTINCT: f64 = 0.7;

/// Quantile of the change of a component's pixels that is taken for that inside it.
const INSIDE: f32 = 0.85;

/// Largest number of components kept per picture, of those against the background and of those against the pictures
/// around each.
const MOST: usize = 16;

/// A connected region that differs from the background.
#[derive(Debug, Clone)]
pub(in crate::video::film) struct Component {
    /// Centroid, weighted by the change \[pixels\].
    pub middle: [f64; 2],
    /// Covariance of the position \[pixels²\]: xx, xy, yy.
    pub spread: [f64; 3],
    /// The same of what lies within its edge.
    pub body: [f64; 3],
    /// Number of pixels.
    pub area: f64,
    /// Left, top, right and bottom \[pixels\], the last two exclusive.
    pub rect: [usize; 4],
    /// Mean colour.
    pub colour: [f64; 3],
    /// Mean change against the background, in levels.
    pub contrast: f64,
    /// 1 where it looks like a shadow, 0 where it does not.
    pub shadow: f64,
    /// Whether it touches the border.
    pub cut: bool,
    /// Its pixels: row, first column and column after the last.
    pub runs: Vec<[u16; 3]>,
}

impl Component {
    /// Extent across its longer axis \[pixels\]: four deviations, which is the diameter of a disc.
    pub fn across(&self) -> f64 {
        let [xx, xy, yy] = self.spread;
        let half = 0.5 * (xx - yy);
        4.0 * (0.5 * (xx + yy) - (half * half + xy * xy).sqrt()).max(0.0).sqrt()
    }

    /// Whether a place is on it.
    pub fn covers(&self, [x, y]: [f64; 2]) -> bool {
        let at = |v: f64| v.max(0.0) as u16;
        self.runs.iter().any(|[row, first, last]| *row == at(y) && (*first..*last).contains(&at(x)))
    }

    /// Whether another one is the same but for a few pixels.
    fn is_nearly(&self, other: &Self) -> bool {
        let off = (self.middle[0] - other.middle[0]).hypot(self.middle[1] - other.middle[1]);
        off < 0.05 * self.area.sqrt().max(10.0) && (self.area / other.area).ln().abs() < 0.15
    }

    /// Extent within its edge perpendicular to a direction \[pixels\].
    pub fn across_direction(&self, [x, y]: [f64; 2]) -> f64 {
        let length = x.hypot(y).max(f64::MIN_POSITIVE);
        let [a, b] = [-y / length, x / length];
        let [xx, xy, yy] = self.body;
        4.0 * (a * a * xx + 2.0 * a * b * xy + b * b * yy).max(0.0).sqrt()
    }
}

/// Number of pictures that one task takes in turn.
const AT_ONCE: usize = 16;

/// The components of every picture.
pub(in crate::video::film) fn all(sequence: &Sequence, background: &Background) -> Vec<Vec<Component>> {
    let count = sequence.pictures.len();
    let starts: Vec<usize> = (0..count).step_by(AT_ONCE).collect();
    let of = |start: usize| {
        let difference = |k: usize| signed(&sequence.pictures[k], background, sequence.width);
        let (mut before, mut now) = (start.checked_sub(1).map(difference), Some(difference(start)));
        let mut all = Vec::new();
        for k in start..(start + AT_ONCE).min(count) {
            let after = (k + 1 < count).then(|| difference(k + 1));
            let seen = now.take().expect("computed one ahead");
            let view = View { colours: &sequence.pictures[k], background: &background.colour, width: sequence.width };
            let mut found = view.components(&seen, &changes(&background.noise, |i| seen[i]));
            if let (Some(before), Some(after)) = (&before, &after) {
                let from = |other: &[[f32; 3]]| {
                    changes(&background.noise, |i| std::array::from_fn(|c| (seen[i][c] - other[i][c]) * HALF_EACH))
                };
                let (old, new) = (from(before), from(after));
                let moving: Vec<f32> = old.iter().zip(&new).map(|(a, b)| a.min(*b)).collect();
                let moving = view.components(&seen, &moving);
                let known = |new: &Component| found.iter().any(|old| old.is_nearly(new));
                let moving: Vec<Component> = moving.into_iter().filter(|new| !known(new)).collect();
                found.extend(moving);
            }
            all.push(found);
            (before, now) = (Some(seen), after);
        }
        all
    };
    starts.into_par_iter().flat_map_iter(of).collect()
}

/// Deviation of a value over that of a difference of two.
const HALF_EACH: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// The smoothed difference of a picture from the background \[levels\].
fn signed(seen: &[Rgb], background: &Background, width: usize) -> Vec<[f32; 3]> {
    let gain = gain(seen, &background.colour);
    let raw: Vec<[f32; 3]> = seen
        .iter()
        .zip(&background.colour)
        .map(|(a, b)| std::array::from_fn(|c| f32::from(a[c]) - gain[c] * f32::from(b[c])))
        .collect();
    smoothed(&raw, width)
}

/// Lengths of differences in standard deviations. What the smoothing leaves of the noise is estimated from the
/// differences themselves.
fn changes(noise: &[f32], difference: impl Fn(usize) -> [f32; 3]) -> Vec<f32> {
    let mut change: Vec<f32> = (0..noise.len()).map(|i| length(difference(i)) / noise[i]).collect();
    let mut sample: Vec<f32> = change.iter().step_by(11).copied().collect();
    let middle = sample.len() / 2;
    // three dimensions: the median length is 1.54 deviations
    let unit = (*sample.select_nth_unstable_by(middle, f32::total_cmp).1 / 1.54).max(LEAST_UNIT);
    change.iter_mut().for_each(|c| *c /= unit);
    change
}

/// Least share of the noise that smoothing leaves.
const LEAST_UNIT: f32 = 0.4;

fn length(d: [f32; 3]) -> f32 {
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

/// Median ratio of brightness per channel: a camera adjusts its exposure.
fn gain(seen: &[Rgb], other: &[Rgb]) -> [f32; 3] {
    let step = (seen.len() / 3000).max(1);
    std::array::from_fn(|c| {
        let bright = |(a, b): &(&Rgb, &Rgb)| a[c] > 16 && b[c] > 16 && b[c] < 250 && a[c] < 250;
        let pairs = seen.iter().zip(other).step_by(step).filter(bright);
        let mut ratios: Vec<f32> = pairs.map(|(a, b)| f32::from(a[c]) / f32::from(b[c])).collect();
        if ratios.len() < 100 {
            return 1.0;
        }
        let middle = ratios.len() / 2;
        ratios.select_nth_unstable_by(middle, f32::total_cmp).1.clamp(0.8, 1.25)
    })
}

/// Binomial means over three by three pixels.
fn smoothed(raw: &[[f32; 3]], width: usize) -> Vec<[f32; 3]> {
    let height = raw.len() / width;
    let mean = |a: [f32; 3], b: [f32; 3], c: [f32; 3]| -> [f32; 3] {
        std::array::from_fn(|k| 0.25 * a[k] + 0.5 * b[k] + 0.25 * c[k])
    };
    let mut along = Vec::with_capacity(raw.len());
    for row in raw.chunks_exact(width) {
        for x in 0..width {
            along.push(mean(row[x.saturating_sub(1)], row[x], row[(x + 1).min(width - 1)]));
        }
    }
    let mut out = Vec::with_capacity(raw.len());
    for y in 0..height {
        let (up, down) = (y.saturating_sub(1) * width, (y + 1).min(height - 1) * width);
        for x in 0..width {
            out.push(mean(along[up + x], along[y * width + x], along[down + x]));
        }
    }
    out
}

/// A picture whose components are sought.
struct View<'a> {
    colours: &'a [Rgb],
    background: &'a [Rgb],
    width: usize,
}

impl View<'_> {
    /// The components of a change at all levels, by the difference from the background.
    fn components(&self, difference: &[[f32; 3]], change: &[f32]) -> Vec<Component> {
        let (width, height) = (self.width, change.len() / self.width);
        let mut active: Vec<usize> = (0..change.len()).filter(|i| change[*i] > THRESHOLD).collect();
        // level up to which a pixel was visited
        let mut visited = vec![0u8; change.len()];
        let mut around: Vec<u32> = vec![0; change.len()];
        let mut found: Vec<Vec<usize>> = Vec::new();
        for level in 0..LEVELS {
            let least = THRESHOLD * (1 << level) as f32;
            active.retain(|i| change[*i] > least);
            let mark = level as u8 + 1;
            for &start in &active {
                if visited[start] == mark {
                    continue;
                }
                visited[start] = mark;
                let mut pixels = vec![start];
                let mut next = 0;
                while let Some(&pixel) = pixels.get(next) {
                    next += 1;
                    for near in neighbours(pixel, width, height) {
                        if visited[near] != mark && change[near] > least {
                            visited[near] = mark;
                            pixels.push(near);
                        }
                    }
                }
                if pixels.len() < LEAST_AREA {
                    continue;
                }
                // the size of the component around it, on a lower level
                let outer = around[start] as f64;
                if level == 0 || outer == 0.0 || (pixels.len() as f64) < DISTINCT * outer {
                    pixels.iter().for_each(|pixel| around[*pixel] = pixels.len() as u32);
                    found.push(pixels);
                }
            }
        }
        let mut made: Vec<Component> = found.into_iter().map(|pixels| self.described(pixels, difference)).collect();
        let clear = |piece: &Component| piece.area.sqrt() * piece.contrast;
        made.sort_by(|a, b| clear(b).total_cmp(&clear(a)));
        made.truncate(MOST);
        made
    }

    fn described(&self, mut pixels: Vec<usize>, difference: &[[f32; 3]]) -> Component {
        pixels.sort_unstable();
        let (width, height) = (self.width, difference.len() / self.width);
        // the direction of the change
        let sum = pixels.iter().fold([0.0f32; 3], |s, i| std::array::from_fn(|c| s[c] + difference[*i][c]));
        let size = length(sum).max(f32::MIN_POSITIVE);
        let towards = sum.map(|v| v / size);
        let along = |i: usize| (0..3).map(|c| difference[i][c] * towards[c]).sum::<f32>();
        let weight = |i: usize| f64::from(along(i).max(0.05 * length(difference[i])));
        // its edge is where the change is half of that inside: blur and soft shadows end below
        let mut sorted: Vec<f32> = pixels.iter().map(|i| along(*i)).collect();
        let rank = (INSIDE * (sorted.len() - 1) as f32) as usize;
        let inside = *sorted.select_nth_unstable_by(rank, f32::total_cmp).1;
        let within: Vec<([f64; 2], f64)> = pixels
            .iter()
            .map(|&i| {
                let place = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
                (place, f64::from((2.0 * along(i) / inside - 0.5).clamp(0.0, 1.0)))
            })
            .collect();
        let (mut mass, mut moment, mut second) = (0.0, [0.0; 2], [0.0; 3]);
        let mut rect = [usize::MAX, usize::MAX, 0, 0];
        let (mut colour, mut ratio) = ([0.0; 3], [0.0; 3]);
        let mut runs: Vec<[u16; 3]> = Vec::new();
        for &i in &pixels {
            let (x, y, w) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5, weight(i));
            mass += w;
            moment = [moment[0] + w * x, moment[1] + w * y];
            second = [second[0] + w * x * x, second[1] + w * x * y, second[2] + w * y * y];
            let (column, row) = (i % width, i / width);
            rect = [rect[0].min(column), rect[1].min(row), rect[2].max(column + 1), rect[3].max(row + 1)];
            for c in 0..3 {
                colour[c] += w * f64::from(self.colours[i][c]);
                ratio[c] += w * light_ratio(self.colours[i][c], self.background[i][c]);
            }
            match runs.last_mut() {
                Some(run) if usize::from(run[0]) == row && usize::from(run[2]) == column => run[2] += 1,
                _ => runs.push([row as u16, column as u16, column as u16 + 1]),
            }
        }
        let middle = moment.map(|m| m / mass);
        let spread = [
            second[0] / mass - middle[0] * middle[0],
            second[1] / mass - middle[0] * middle[1],
            second[2] / mass - middle[1] * middle[1],
        ];
        Component {
            middle,
            spread,
            area: pixels.len() as f64,
            rect,
            colour: colour.map(|v| v / mass),
            contrast: mass / pixels.len() as f64,
            body: covariance(&within),
            shadow: shadow(ratio.map(|v| v / mass)),
            cut: rect[0] == 0 || rect[1] == 0 || rect[2] == width || rect[3] == height,
            runs,
        }
    }
}

/// Covariance of weighted places: xx, xy, yy.
fn covariance(places: &[([f64; 2], f64)]) -> [f64; 3] {
    let mean = |of: &dyn Fn([f64; 2]) -> f64| {
        places.iter().map(|(place, weight)| weight * of(*place)).sum::<f64>()
            / places.iter().map(|(_, weight)| weight).sum::<f64>().max(f64::MIN_POSITIVE)
    };
    let [x, y] = [mean(&|p| p[0]), mean(&|p| p[1])];
    [mean(&|p| (p[0] - x).powi(2)), mean(&|p| (p[0] - x) * (p[1] - y)), mean(&|p| (p[1] - y).powi(2))]
}

/// Logarithm of the ratio of linear light, with a floor against noise.
fn light_ratio(seen: u8, other: u8) -> f64 {
    let linear = |v: u8| (f64::from(v) / 255.0).powf(2.2) + 0.01;
    (linear(seen) / linear(other)).ln()
}

/// Likeness with a shadow: darker by a part, in the same hue.
fn shadow(ratio: [f64; 3]) -> f64 {
    let mean = ratio.iter().sum::<f64>() / 3.0;
    let hue = ratio.iter().map(|r| (r - mean).powi(2)).sum::<f64>().sqrt();
    if !(-1.6..-0.02).contains(&mean) {
        return 0.0;
    }
    (1.0 - hue / (0.08 - 0.25 * mean)).clamp(0.0, 1.0)
}
