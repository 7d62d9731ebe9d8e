//! The background of a film, estimated from the frames in which the object is elsewhere.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::median::median;
use crate::video::image::Image;

/// Maximum number of frames that are compared.
pub(super) const MOST_FRAMES: usize = 32;

/// Values closer than this in every channel count as the same surface.
const ALIKE: u8 = 26;

/// Bit set of the frames in which a pixel is assumed to show the background.
type Frames = u32;

/// The background behind a moving object.
///
/// A pixel that is constant in all frames shows the background. Any other pixel has several candidates: sets of
/// frames in which it looks the same. Neighbouring pixels are covered in the same frames unless the object's edge
/// passes between them, which is visible as an edge in the image. Starting from the known pixels, their neighbours
/// are decided in the order of agreement, each by the set that agrees best. A pixel needs to be uncovered only once
/// for its background to be found.
pub(super) fn of(images: &[Image]) -> Image {
    let step = images.len().div_ceil(MOST_FRAMES).max(1);
    let frames: Vec<&Image> = images.iter().step_by(step).collect();
    let (width, height) = (images[0].width, images[0].height);
    let all: Frames = if frames.len() == 32 { Frames::MAX } else { (1 << frames.len()) - 1 };
    let candidates: Vec<Vec<Frames>> = (0..width * height).into_par_iter().map(|i| alike(&frames, i)).collect();
    let mut free: Vec<Option<Frames>> = vec![None; width * height];
    let mut open = BinaryHeap::new();
    let near = |i: usize| {
        let (x, y) = (i % width, i / width);
        [
            (x > 0).then(|| i - 1),
            (x + 1 < width).then_some(i + 1),
            (y > 0).then(|| i - width),
            (y + 1 < height).then_some(i + width),
        ]
        .into_iter()
        .flatten()
    };
    // disagreement of a pixel with a neighbour that is uncovered in these frames: the frames in which an edge would
    // have to pass between them, but none is visible
    let best = |i: usize, neighbour: usize, free: Frames| {
        let smooth = frames.iter().enumerate().filter(|(_, f)| is_alike(f.pixels[i], f.pixels[neighbour]));
        let smooth = smooth.fold(0, |set: Frames, (k, _)| set | 1 << k);
        let apart = |set: Frames| (((set ^ free) & smooth).count_ones(), (set ^ free).count_ones());
        candidates[i]
            .iter()
            .map(|set| (apart(*set), *set))
            .min_by_key(|(apart, set)| (*apart, Reverse(set.count_ones())))
    };
    let still = candidates.iter().enumerate().filter(|(_, sets)| sets.contains(&all));
    open.extend(still.map(|(i, _)| (Reverse((0, 0)), Reverse(i), all)));
    if open.is_empty() {
        // no pixel is constant: take the most frequent appearance
        let most = |sets: &Vec<Frames>| sets.iter().copied().max_by_key(|set| set.count_ones()).unwrap_or(all);
        open.extend(candidates.iter().enumerate().map(|(i, sets)| (Reverse((0, 0)), Reverse(i), most(sets))));
    }
    while let Some((_, Reverse(i), set)) = open.pop() {
        if free[i].is_some() {
            continue;
        }
        free[i] = Some(set);
        for j in near(i).filter(|j| free[*j].is_none()) {
            if let Some((apart, like)) = best(j, i, set) {
                open.push((Reverse(apart), Reverse(j), like));
            }
        }
    }
    let middle = |i: usize| {
        let set = free[i].unwrap_or(all);
        let seen = || frames.iter().enumerate().filter(|(k, _)| set >> k & 1 == 1).map(|(_, f)| f.pixels[i]);
        let [r, g, b] = [0, 1, 2].map(|c| median(&mut seen().map(|p| p[c]).collect::<Vec<u8>>()));
        [r, g, b, 255]
    };
    Image { pixels: (0..width * height).into_par_iter().map(middle).collect(), ..images[0].clone() }
}

fn is_alike(a: [u8; 4], b: [u8; 4]) -> bool {
    (0..3).all(|c| a[c].abs_diff(b[c]) <= ALIKE)
}

/// The sets of frames in which a pixel looks the same as in one of them.
pub(super) fn alike(frames: &[&Image], i: usize) -> Vec<Frames> {
    let set = |like: &&Image| {
        let all = frames.iter().enumerate().filter(|(_, other)| is_alike(like.pixels[i], other.pixels[i]));
        all.fold(0, |set, (k, _)| set | 1 << k)
    };
    let mut sets: Vec<Frames> = frames.iter().map(set).collect();
    sets.sort_unstable();
    sets.dedup();
    sets
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A patterned square that falls onto a striped floor and rests there for most of the film.
    #[test]
    fn what_is_behind_an_object_that_stays_is_found() {
        let (side, square) = (60, 20);
        let floor = |i: usize| [((i % side) * 4) as u8, ((i / side) * 3) as u8, 90, 255];
        let frame = |k: usize| {
            let top = (8 * k).min(32);
            let at = |i: usize| {
                let (x, y) = (i % side, i / side);
                let inside = (20..20 + square).contains(&x) && (top..top + square).contains(&y);
                if inside { [200, 60 + 2 * (y - top) as u8, 10, 255] } else { floor(i) }
            };
            Image { width: side, height: side, pixels: (0..side * side).map(at).collect(), has_alpha: false }
        };
        let film: Vec<Image> = (0..16).map(frame).collect();
        let found = of(&film);
        let wrong = (0..side * side).filter(|&i| (0..3).any(|c| found.pixels[i][c].abs_diff(floor(i)[c]) > 2)).count();
        assert!(wrong < 20, "{wrong} pixels are not of the floor");
    }
}
