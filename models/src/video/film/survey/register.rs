//! Motion of the camera: each picture is aligned with one of them by a homography.
//!
//! Alignment is by intensity (inverse compositional Gauss–Newton) at the places with the strongest gradients, spread
//! over the picture, with weights that ignore what moves against the background.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::sequence::{Rgb, Sequence};

/// Cells of a grid along the longer side, each of which lends its strongest gradients, and their number per cell.
const CELLS: usize = 16;
const PER_CELL: usize = 12;

/// Least gradient of a place that tells a motion \[levels a pixel\].
const LEAST_GRADIENT: f32 = 4.0;

/// Least number of such places.
const LEAST_PLACES: usize = 60;

/// Iterations at each stage, and the parameters that each stage fits: a shift, an affine map, a homography.
const ROUNDS: usize = 8;
const STAGES: [(usize, &[usize]); 3] = [(2, &[2, 5]), (1, &[0, 1, 2, 3, 4, 5]), (0, &[0, 1, 2, 3, 4, 5, 6, 7])];

/// Motion of a corner below which the camera stands still \[pixels\].
const STILL: f64 = 0.3;

/// An alignment counts if it leaves at most this share of the difference, and moves corners by at most this share of
/// the longer side.
const HELPS: (f64, f64) = (0.6, 0.6);

/// Least numbers of rows and of columns of cells with places: a few edges in a corner tell nothing of the whole.
const SPREAD: usize = 5;

/// Largest difference of an aligned picture from the reference: levels, and multiples of the usual one.
const UNLIKE: (f64, f64) = (8.0, 3.0);

/// Usual deviations of the parameters from no motion, in units of half the longer side, and the number of places whose
/// errors are one: those of neighbours are alike.
const USUAL: [f64; 8] = [0.02, 0.02, 0.05, 0.02, 0.02, 0.05, 0.01, 0.01];
const ALIKE: f64 = 30.0;

/// Least share of the pictures that move if the camera does.
const MOST_MOVE: f64 = 0.5;

/// A homography about the middle of the picture, in units of half its longer side.
pub(in crate::video::film) type Homography = [f64; 9];

/// No motion.
pub(in crate::video::film) const IDENTITY: Homography = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

/// How the camera moves.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::video::film) struct Motion {
    /// Where each picture shows a place of the reference.
    pub maps: Vec<Homography>,
    /// Largest displacement of a corner \[share of the longer side\].
    pub most: f64,
    /// Indices of the pictures that could not be aligned.
    pub lost: Vec<usize>,
}

/// A grey picture.
struct Grey {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

/// A place of the reference that tells a motion.
struct Place {
    at: [f64; 2],
    value: f32,
    /// Derivatives of the value with respect to the parameters.
    slopes: [f32; 8],
}

impl Motion {
    /// The motion in a sequence; `None` if the camera stands still, or if the background has too few edges to tell.
    pub fn of(sequence: &Sequence) -> Option<Self> {
        let count = sequence.pictures.len();
        if count < 2 {
            return None;
        }
        let reference = count / 2;
        let base = pyramid(sequence, reference);
        let places: Vec<Vec<Place>> = base.iter().map(places).collect();
        let cells = |axis: usize| {
            let cell = |place: &Place| ((place.at[axis] + 1.0) * 0.5 * CELLS as f64) as usize;
            places[0].iter().map(cell).collect::<BTreeSet<usize>>().len()
        };
        let sides =
            [sequence.width, sequence.height].map(|side| side as f64 / sequence.width.max(sequence.height) as f64);
        let spread = |axis: usize| cells(axis) as f64 >= (SPREAD as f64 * sides[axis]).max(2.0);
        if places[0].len() < LEAST_PLACES || !spread(0) || !spread(1) {
            return None;
        }
        let mut maps = vec![IDENTITY; count];
        let mut off = vec![0.0; count];
        // from the reference outwards, each from the one before
        let half = |indices: Vec<usize>| -> Vec<(usize, Homography, f64)> {
            let mut map = IDENTITY;
            let follow = |k: usize| {
                let (found, left) = aligned(&pyramid(sequence, k), &places, map);
                map = found;
                (k, found, left)
            };
            indices.into_iter().map(follow).collect()
        };
        let (after, before) =
            rayon::join(|| half((reference + 1..count).collect()), || half((0..reference).rev().collect()));
        for (k, map, left) in after.into_iter().chain(before) {
            (maps[k], off[k]) = (map, left);
        }
        let size = [sequence.width, sequence.height];
        let longer = sequence.width.max(sequence.height) as f64;
        let most = maps.iter().map(|map| displacement(map, size)).fold(0.0, f64::max);
        // a hand moves the camera all the time: a few pictures that seem to move are mistaken
        let moving = maps.iter().filter(|map| displacement(map, size) > STILL).count();
        if (moving as f64) < MOST_MOVE * count as f64 {
            return None;
        }
        let limit = UNLIKE.0.max(UNLIKE.1 * super::flight::middle(off.clone()));
        let lost: Vec<usize> = (0..count).filter(|k| off[*k] > limit).collect();
        (most > STILL || !lost.is_empty()).then(|| Self { maps, most: most / longer, lost })
    }

    /// The sequence as a camera at rest sees it.
    pub fn undo(&self, sequence: &mut Sequence) {
        let (width, height) = (sequence.width, sequence.height);
        sequence.pictures.par_iter_mut().zip(&self.maps).for_each(|(picture, map)| {
            *picture = warped(picture, width, height, map);
        });
    }
}

/// Largest displacement of a corner \[pixels\].
fn displacement(map: &Homography, [width, height]: [usize; 2]) -> f64 {
    let half = 0.5 * width.max(height) as f64;
    let (x, y) = (0.5 * width as f64 / half, 0.5 * height as f64 / half);
    let corners = [[-x, -y], [x, -y], [-x, y], [x, y]];
    let off = |at: [f64; 2]| {
        let to = mapped(map, at);
        half * (to[0] - at[0]).hypot(to[1] - at[1])
    };
    corners.map(off).into_iter().fold(0.0, f64::max)
}

/// Where a map takes a place.
fn mapped(m: &Homography, [x, y]: [f64; 2]) -> [f64; 2] {
    let scale = 1.0 / (m[6] * x + m[7] * y + m[8]);
    [(m[0] * x + m[1] * y + m[2]) * scale, (m[3] * x + m[4] * y + m[5]) * scale]
}

/// A picture of pixels of three or four channels as the reference shows it; places outside show its edge.
pub(in crate::video::film) fn warped<const N: usize>(
    pixels: &[[u8; N]],
    width: usize,
    height: usize,
    map: &Homography,
) -> Vec<[u8; N]> {
    if *map == IDENTITY {
        return pixels.to_vec();
    }
    let half = 0.5 * width.max(height) as f64;
    let middle = [0.5 * width as f64, 0.5 * height as f64];
    let pixel = |i: usize| {
        let at = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        let to = mapped(map, [0, 1].map(|c| (at[c] - middle[c]) / half));
        let [x, y] = [0, 1].map(|c| to[c] * half + middle[c] - 0.5);
        let (x, y) = (x.clamp(0.0, (width - 1) as f64), y.clamp(0.0, (height - 1) as f64));
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (u, v) = ((x - left as f64) as f32, (y - top as f64) as f32);
        let [a, b, c, d] =
            [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| pixels[y * width + x]);
        std::array::from_fn(|k| {
            let [a, b, c, d] = [a, b, c, d].map(|p| f32::from(p[k]));
            ((1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d)).round() as u8
        })
    };
    (0..width * height).map(pixel).collect()
}

/// The grey picture and two smaller ones, each of half the sides.
fn pyramid(sequence: &Sequence, k: usize) -> Vec<Grey> {
    let grey = |p: &Rgb| (f32::from(p[0]) + 2.0 * f32::from(p[1]) + f32::from(p[2])) * 0.25;
    let values = sequence.pictures[k].iter().map(grey).collect();
    let mut all = vec![Grey { width: sequence.width, height: sequence.height, values }];
    for _ in 0..2 {
        let last = &all[all.len() - 1];
        let (width, height) = ((last.width / 2).max(1), (last.height / 2).max(1));
        let at = |x: usize, y: usize| last.values[y.min(last.height - 1) * last.width + x.min(last.width - 1)];
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1))
        };
        all.push(Grey { width, height, values: (0..width * height).map(mean).collect() });
    }
    all
}

/// The places with the strongest gradients in each cell.
fn places(grey: &Grey) -> Vec<Place> {
    let Grey { width, height, values } = grey;
    let cell = (width.max(height) / CELLS).max(4);
    let mut found = Vec::new();
    let half = 0.5 * *width.max(height) as f64;
    for top in (1..height.saturating_sub(1)).step_by(cell) {
        for left in (1..width.saturating_sub(1)).step_by(cell) {
            let inside = (top..(top + cell).min(height - 1))
                .flat_map(|y| (left..(left + cell).min(width - 1)).map(move |x| y * width + x));
            let slope =
                |i: usize| [values[i + 1] - values[i - 1], values[i + width] - values[i - width]].map(|d| 0.5 * d);
            let mut strong: Vec<(f32, usize)> = inside
                .map(|i| {
                    let [x, y] = slope(i);
                    (x.hypot(y), i)
                })
                .filter(|(strength, _)| *strength >= LEAST_GRADIENT)
                .collect();
            strong.sort_by(|a, b| b.0.total_cmp(&a.0));
            for (_, i) in strong.into_iter().take(PER_CELL) {
                let at = [
                    ((i % width) as f64 + 0.5 - 0.5 * *width as f64) / half,
                    ((i / width) as f64 + 0.5 - 0.5 * *height as f64) / half,
                ];
                let [gx, gy] = slope(i).map(|d| d * half as f32);
                let [x, y] = at.map(|v| v as f32);
                let turn = gx * x + gy * y;
                found.push(Place {
                    at,
                    value: values[i],
                    slopes: [gx * x, gx * y, gx, gy * x, gy * y, gy, -x * turn, -y * turn],
                });
            }
        }
    }
    found
}

/// The map that aligns a picture with the reference, from a first guess, and the difference that it leaves.
fn aligned(pyramid: &[Grey], places: &[Vec<Place>], guess: Homography) -> (Homography, f64) {
    let fine = (&pyramid[0], &places[0]);
    let longer = fine.0.width.max(fine.0.height) as f64;
    let still = difference(fine.0, fine.1, &IDENTITY);
    // the simplest map that explains what is seen
    let (mut best, mut least) = (IDENTITY, HELPS.0 * still);
    let mut map = guess;
    for (level, parameters) in STAGES {
        let (grey, places) = (&pyramid[level], &places[level]);
        if places.len() < 4 * parameters.len() {
            continue;
        }
        for _ in 0..ROUNDS {
            let Some(step) = step(grey, places, &map, parameters) else { break };
            map = composed(&map, &inverse_of_step(&step));
            if step.iter().map(|v| v.abs()).fold(0.0, f64::max) < 1e-5 {
                break;
            }
        }
        let left = difference(fine.0, fine.1, &map);
        if left < least && displacement(&map, [fine.0.width, fine.0.height]) <= HELPS.1 * longer {
            (best, least) = (map, BETTER * left);
        }
    }
    (best, difference(fine.0, fine.1, &best))
}

/// A map of more parameters counts if it leaves at most this share of the difference.
const BETTER: f64 = 0.97;

/// Mean of the smaller half of the differences from the reference \[levels\], which what moves does not reach.
fn difference(grey: &Grey, places: &[Place], map: &Homography) -> f64 {
    let off = |place: &Place| Some(f64::from((value(grey, map, place.at)? - place.value).abs()));
    let mut all: Vec<f64> = places.iter().filter_map(off).collect();
    if 2 * all.len() < places.len() {
        return f64::INFINITY;
    }
    all.sort_by(f64::total_cmp);
    let half = all.len() / 2;
    all[..half].iter().sum::<f64>() / half.max(1) as f64 + LEAST_DIFFERENCE
}

/// Difference that noise and compression leave \[levels\].
const LEAST_DIFFERENCE: f64 = 0.5;

/// The value of a picture at a place of the reference; `None` outside.
fn value(grey: &Grey, map: &Homography, at: [f64; 2]) -> Option<f32> {
    let half = 0.5 * grey.width.max(grey.height) as f64;
    let [x, y] = mapped(map, at);
    let (x, y) = (x * half + 0.5 * grey.width as f64 - 0.5, y * half + 0.5 * grey.height as f64 - 0.5);
    if !(x >= 0.0 && y >= 0.0 && x <= (grey.width - 1) as f64 && y <= (grey.height - 1) as f64) {
        return None;
    }
    let (left, top) = (x as usize, y as usize);
    let (right, bottom) = ((left + 1).min(grey.width - 1), (top + 1).min(grey.height - 1));
    let (u, v) = ((x - left as f64) as f32, (y - top as f64) as f32);
    let at = |x: usize, y: usize| grey.values[y * grey.width + x];
    Some(
        (1.0 - v) * ((1.0 - u) * at(left, top) + u * at(right, top))
            + v * ((1.0 - u) * at(left, bottom) + u * at(right, bottom)),
    )
}

/// One robust Gauss–Newton step.
fn step(grey: &Grey, places: &[Place], map: &Homography, parameters: &[usize]) -> Option<[f64; 8]> {
    let seen: Vec<(f32, &Place)> =
        places.iter().filter_map(|place| Some((value(grey, map, place.at)? - place.value, place))).collect();
    if seen.len() < 4 * parameters.len() {
        return None;
    }
    // a change of the light moves all alike
    let middle = |mut values: Vec<f32>| {
        let at = values.len() / 2;
        *values.select_nth_unstable_by(at, f32::total_cmp).1
    };
    let bias = middle(seen.iter().map(|(off, _)| *off).collect());
    let scale = (1.4826 * middle(seen.iter().map(|(off, _)| (off - bias).abs()).collect())).max(1.0);
    let count = parameters.len();
    let (mut normal, mut right) = ([[0.0f64; 8]; 8], [0.0f64; 8]);
    for (off, place) in &seen {
        let residual = (off - bias) / (4.0 * scale);
        if residual.abs() >= 1.0 {
            continue;
        }
        let weight = f64::from((1.0 - residual * residual).powi(2));
        for (i, a) in parameters.iter().enumerate() {
            let slope = weight * f64::from(place.slopes[*a]);
            right[i] += slope * f64::from(off - bias);
            for (j, b) in parameters.iter().enumerate().take(i + 1) {
                normal[i][j] += slope * f64::from(place.slopes[*b]);
            }
        }
    }
    // without evidence the camera stands still
    let now = [map[0] - 1.0, map[1], map[2], map[3], map[4] - 1.0, map[5], map[6], map[7]];
    for (i, a) in parameters.iter().enumerate() {
        let strength = ALIKE * f64::from(scale * scale) / (USUAL[*a] * USUAL[*a]);
        normal[i][i] += strength;
        right[i] += strength * now[*a];
    }
    let solved = cholesky(&mut normal, &mut right, count)?;
    let mut step = [0.0; 8];
    parameters.iter().zip(solved).for_each(|(parameter, value)| step[*parameter] = value);
    Some(step)
}

/// Solves the lower triangle of a positive definite system in place, slightly damped.
fn cholesky(a: &mut [[f64; 8]; 8], b: &mut [f64; 8], count: usize) -> Option<[f64; 8]> {
    for i in 0..count {
        a[i][i] *= 1.0 + 1e-6;
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            let rest = a[i][j] - sum;
            if i == j {
                if rest <= 1e-9 * a[i][i].abs() || !rest.is_finite() || rest <= 0.0 {
                    return None;
                }
                a[i][i] = rest.sqrt();
            } else {
                a[i][j] = rest / a[j][j];
            }
        }
    }
    for i in 0..count {
        let sum: f64 = (0..i).map(|k| a[i][k] * b[k]).sum();
        b[i] = (b[i] - sum) / a[i][i];
    }
    for i in (0..count).rev() {
        let sum: f64 = (i + 1..count).map(|k| a[k][i] * b[k]).sum();
        b[i] = (b[i] - sum) / a[i][i];
    }
    Some(*b)
}

/// The inverse of the map `identity + step`.
fn inverse_of_step(h: &[f64; 8]) -> Homography {
    let m = [1.0 + h[0], h[1], h[2], h[3], 1.0 + h[4], h[5], h[6], h[7], 1.0];
    let minor = |a: usize, b: usize, c: usize, d: usize| m[a] * m[d] - m[b] * m[c];
    let adjoint = [
        minor(4, 5, 7, 8),
        -minor(1, 2, 7, 8),
        minor(1, 2, 4, 5),
        -minor(3, 5, 6, 8),
        minor(0, 2, 6, 8),
        -minor(0, 2, 3, 5),
        minor(3, 4, 6, 7),
        -minor(0, 1, 6, 7),
        minor(0, 1, 3, 4),
    ];
    adjoint.map(|v| v / adjoint[8])
}

/// First the second map, then the first.
fn composed(a: &Homography, b: &Homography) -> Homography {
    let product: Homography = std::array::from_fn(|i| (0..3).map(|k| a[3 * (i / 3) + k] * b[3 * k + i % 3]).sum());
    product.map(|v| v / product[8])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene of blobs, seen from a camera that is shifted, turned and brought nearer.
    fn seen(width: usize, height: usize, map: &Homography) -> Vec<Rgb> {
        let half = 0.5 * width.max(height) as f64;
        let pixel = |i: usize| {
            let at = [(i % width) as f64 + 0.5 - 0.5 * width as f64, (i / width) as f64 + 0.5 - 0.5 * height as f64];
            let [x, y] = mapped(map, at.map(|v| v / half));
            let wave = (9.0 * x + 2.0 * y).sin() + (7.0 * y - 3.0 * x * y).cos() + (23.0 * x * y + 5.0 * x).sin();
            [(128.0 + 35.0 * wave).round() as u8; 3]
        };
        (0..width * height).map(pixel).collect()
    }

    #[test]
    fn a_hand_held_camera_is_brought_to_rest() {
        let (width, height) = (160, 90);
        // where the scene is in each picture: shifts of some pixels, a degree of rotation, a percent of zoom
        let map = |k: usize| -> Homography {
            let t = k as f64;
            let (sine, cosine) = (0.02 * (1.3 * t).sin()).sin_cos();
            let zoom = 1.0 + 0.004 * t;
            let shift = [0.03 * (0.9 * t).sin(), 0.02 * (1.7 * t).cos()];
            [zoom * cosine, -zoom * sine, shift[0], zoom * sine, zoom * cosine, shift[1], 0.004 * t, 0.0, 1.0]
        };
        let mut sequence = Sequence { width, height, ..Sequence::default() };
        for k in 0..9 {
            sequence.numbers.push(k);
            sequence.times.push(0.04 * k as f64);
            sequence.pictures.push(seen(width, height, &map(k)));
        }
        let motion = Motion::of(&sequence).unwrap();
        assert!(motion.lost.is_empty() && (0.01..0.1).contains(&motion.most), "{motion:?}");
        motion.undo(&mut sequence);
        let reference = sequence.pictures[4].clone();
        let inner = |i: &usize| (16..width - 16).contains(&(i % width)) && (12..height - 12).contains(&(i / width));
        for (k, picture) in sequence.pictures.iter().enumerate() {
            let pixels: Vec<usize> = (0..width * height).filter(inner).collect();
            let off = |i: &usize| f64::from(picture[*i][0].abs_diff(reference[*i][0]));
            let mean = pixels.iter().map(off).sum::<f64>() / pixels.len() as f64;
            assert!(mean < 1.5, "picture {k}: {mean} levels");
        }
    }

    #[test]
    fn a_camera_at_rest_is_left_alone() {
        let mut sequence = Sequence { width: 160, height: 90, ..Sequence::default() };
        for k in 0..4 {
            let mut picture = seen(160, 90, &IDENTITY);
            // something moves before it
            (20..40).flat_map(|y| (0..20).map(move |x| y * 160 + 30 * k + x)).for_each(|i| picture[i] = [250; 3]);
            sequence.numbers.push(k);
            sequence.times.push(0.04 * k as f64);
            sequence.pictures.push(picture);
        }
        assert_eq!(Motion::of(&sequence), None);
        // a wall without edges tells nothing
        sequence.pictures.iter_mut().for_each(|picture| picture.fill([90; 3]));
        assert_eq!(Motion::of(&sequence), None);
    }
}
