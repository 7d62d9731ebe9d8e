//! Refinement of a film's background, given the object's position.

use rayon::prelude::*;

use super::backdrop::{MOST_FRAMES, alike};
use crate::video::image::Image;
use crate::video::matte::{self, Matte};

/// Margin around the object in which a pixel is not trusted to show the background \[pixels\].
const DISTANCE: usize = 3;

/// Minimum share of a pixel's uncovered frames in which it must look the same …
const COMMON: f64 = 0.2;

/// … and quantiles of these by brightness that show it unshadowed.
const LIT: [f64; 2] = [0.6, 0.9];

/// Maximum factor between the channel ratios of a shadowed and an unshadowed pixel.
const SAME_HUE: f64 = 1.1;

/// Refines a first estimate `empty` of the background, against which the object was segmented: each pixel takes its
/// unshadowed colour from frames in which the object, the largest piece of each matte, is elsewhere.
///
/// An error in the estimate appears as a static object in every frame in which the real object is elsewhere; a
/// shadow in the estimate appears as a light without a source. Both are removed.
pub(super) fn of(images: &[Image], mattes: &[Matte], empty: &Image) -> Image {
    let step = images.len().div_ceil(MOST_FRAMES).max(1);
    let (width, height) = (empty.width, empty.height);
    let frames: Vec<(&Image, Vec<bool>)> = images
        .par_iter()
        .zip(mattes)
        .step_by(step)
        .map(|(image, (_, alpha))| {
            (image, matte::grown(&matte::largest_piece(alpha, width, height), width, height, DISTANCE))
        })
        .collect();
    let pixel = |i: usize| {
        let free = frames.iter().filter(|(_, covered)| !covered[i]).map(|(image, _)| *image).collect::<Vec<_>>();
        unshadowed(&free, i).unwrap_or(empty.pixels[i])
    };
    Image { pixels: (0..width * height).into_par_iter().map(pixel).collect(), ..empty.clone() }
}

/// Colour of a pixel in most of the given frames, or in enough frames that are unshadowed; `None` without frames.
fn unshadowed(frames: &[&Image], i: usize) -> Option<[u8; 4]> {
    let sets: Vec<Vec<[u8; 3]>> = alike(frames, i)
        .into_iter()
        .map(|set| {
            let members = frames.iter().enumerate().filter(|(k, _)| set >> k & 1 == 1);
            members.map(|(_, frame)| [0, 1, 2].map(|c| frame.pixels[i][c])).collect()
        })
        .collect();
    let most = sets.iter().max_by_key(|set| set.len())?;
    let enough = |set: &&Vec<[u8; 3]>| set.len() as f64 >= COMMON * frames.len() as f64;
    let usual = mean(most);
    let lit = sets
        .iter()
        .filter(enough)
        .filter(|set| is_lit(mean(set), usual))
        .max_by_key(|set| mean(set).iter().sum::<usize>());
    let mut values = lit.unwrap_or(most).clone();
    values.sort_by_key(|v| v.iter().map(|v| usize::from(*v)).sum::<usize>());
    let [from, to] = LIT.map(|share| share * values.len() as f64);
    let [r, g, b] = mean(&values[from as usize..to.ceil() as usize]).map(|v| v as u8);
    Some([r, g, b, 255])
}

/// Whether a colour is brighter than another by similar factors in all channels: the same surface without shadow.
fn is_lit(colour: [usize; 3], shadowed: [usize; 3]) -> bool {
    let ratio = [0, 1, 2].map(|c| (colour[c] + 1) as f64 / (shadowed[c] + 1) as f64);
    let [low, high] = [f64::min, f64::max].map(|of| ratio.into_iter().reduce(of).expect("three"));
    low >= 1.0 && high <= SAME_HUE * low
}

/// The rounded mean of some colours.
fn mean(colours: &[[u8; 3]]) -> [usize; 3] {
    let count = colours.len().max(1);
    [0, 1, 2].map(|c| (colours.iter().map(|v| usize::from(v[c])).sum::<usize>() + count / 2) / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A moving square; the first estimate contains a static error and the shadow's most frequent position.
    #[test]
    fn what_stands_still_or_is_shadowed_is_corrected() {
        let (side, square) = (40, 8);
        let thing = |x: usize, y: usize| (28..34).contains(&x) && (4..8).contains(&y);
        let shadow = |x: usize, y: usize, k: usize| (28..36).contains(&x) && (28..36).contains(&y) && k < 6;
        let object =
            |x: usize, y: usize, k: usize| (3 * k..3 * k + square).contains(&x) && (16..16 + square).contains(&y);
        let picture = |colour: &dyn Fn(usize, usize) -> [u8; 4]| Image {
            width: side,
            height: side,
            pixels: (0..side * side).map(|i| colour(i % side, i / side)).collect(),
            has_alpha: false,
        };
        let floor = |x: usize| [100 + x as u8, 120, 90, 255];
        let lit_in = |x: usize, y: usize, k: usize| match floor(x) {
            [r, g, b, a] if shadow(x, y, k) => [r / 2, g / 2, b / 2, a],
            colour => colour,
        };
        let frame = |k: usize| picture(&|x, y| if object(x, y, k) { [200, 20, 20, 255] } else { lit_in(x, y, k) });
        let film: Vec<Image> = (0..10).map(frame).collect();
        let matte = |k: usize| {
            let inside = (0..side * side).map(|i| object(i % side, i / side, k) || thing(i % side, i / side));
            (vec![[1.0; 3]; side * side], inside.map(|inside| if inside { 1.0 } else { 0.0 }).collect())
        };
        let mattes: Vec<Matte> = (0..10).map(matte).collect();
        let wrong = picture(&|x, y| if thing(x, y) { [10, 10, 200, 255] } else { lit_in(x, y, 0) });
        let found = of(&film, &mattes, &wrong);
        for (i, pixel) in found.pixels.iter().enumerate() {
            assert_eq!(*pixel, floor(i % side), "column {} of row {}", i % side, i / side);
        }
    }
}
