//! Matting: position, coverage and colour of the object without the background.
//!
//! Against a background plate, three kinds of pixels must be distinguished: unchanged ones, those changed by the
//! object's *shadow* or reflected light, and those of the object. Colour alone is not sufficient: part of the
//! object may have the floor's hue, and light reflected by a bright object tints the floor beside it. But the
//! shadow of an extended light fades in over many pixels, whereas an edge is sharp. Hence:
//!
//! 1. [`change`] compares image and plate in linear light and discounts shadows, given the [`light`] of the
//!    camera's images;
//! 2. [`walk`] spreads this evidence to neighbouring pixels except across sharp edges of the change;
//! 3. [`silhouette`] thresholds the result at the level with the sharpest contour and removes specks and pinholes;
//! 4. [`edge`] estimates coverage along the contour and removes the background from the colour there.
//!
//! In images of few colours, parts of the object may share the background's hue: [`hueless`] finds them by their
//! contour.

mod change;
mod edge;
mod hueless;
mod light;
mod silhouette;
mod walk;

use self::change::Change;
pub(super) use self::light::Light;
use super::image::Image;

/// Colour on white (sRGB) and alpha of every pixel.
pub(crate) type Matte = (Vec<[f32; 3]>, Vec<f32>);

/// A map of booleans over an image, row by row.
pub(super) struct Mask {
    pub width: usize,
    pub height: usize,
    pub inside: Vec<bool>,
}

impl Mask {
    /// Neighbours of a pixel above, left, right and below, as indices.
    pub fn neighbours(&self, pixel: usize) -> impl Iterator<Item = usize> + use<> {
        neighbours(pixel, self.width, self.height)
    }
}

/// Neighbours of a pixel of an image above, left, right and below, as indices.
pub(super) fn neighbours(pixel: usize, width: usize, height: usize) -> impl Iterator<Item = usize> + use<> {
    let (x, y) = (pixel % width, pixel / width);
    [
        (y > 0).then(|| pixel - width),
        (x > 0).then(|| pixel - 1),
        (x + 1 < width).then_some(pixel + 1),
        (y + 1 < height).then_some(pixel + width),
    ]
    .into_iter()
    .flatten()
}

/// Matte of an image by difference against its plate; pixels of weight 0 contribute no evidence.
pub(super) fn against_plate(image: &Image, plate: &Image, weight: &[f32], light: &Light) -> Matte {
    let difference = Difference::between(image, plate, light);
    difference.matte(image, &difference.mask(image, weight))
}

/// Matte of an image of few colours by difference against its plate, and the same with those parts of the object
/// that share the background's hue.
pub(super) fn of_few_colours(image: &Image, plate: &Image) -> (Matte, Matte) {
    let difference = Difference::between(image, plate, &Light::default());
    let mut mask = difference.mask(image, &vec![1.0; image.pixels.len()]);
    let without = difference.matte(image, &mask);
    hueless::add(&mut mask, &difference.change);
    (without, difference.matte(image, &mask))
}

/// An image and its plate in linear light.
struct Difference {
    seen: Vec<[f32; 3]>,
    empty: Vec<[f32; 3]>,
    change: Change,
    /// Evidence at which object and background are equally likely.
    even: f32,
}

impl Difference {
    fn between(image: &Image, plate: &Image, light: &Light) -> Self {
        let table: Vec<f32> = (0..=255).map(linear_from_srgb).collect();
        let linear = |image: &Image| image.pixels.iter().map(|p| [0, 1, 2].map(|c| table[usize::from(p[c])])).collect();
        let (seen, empty): (Vec<[f32; 3]>, Vec<[f32; 3]>) = (linear(image), linear(plate));
        Self { change: Change::between(&seen, &empty, light.tint), even: light.even, seen, empty }
    }

    /// Mask of the object.
    fn mask(&self, image: &Image, weight: &[f32]) -> Mask {
        let belief = walk::spread(&self.change, self.even, weight, image.width, image.height);
        silhouette::cut(&belief, image.width, image.height)
    }

    fn matte(&self, image: &Image, mask: &Mask) -> Matte {
        let (colour, alpha) = edge::refine(mask, &self.seen, &self.empty);
        let rgb = image.pixels.iter().zip(colour).zip(&alpha).map(|((pixel, colour), &a)| {
            let srgb = match colour {
                Some(linear) => linear.map(srgb_from_linear),
                None => [pixel[0], pixel[1], pixel[2]].map(|v| f32::from(v) / 255.0),
            };
            srgb.map(|v| a * v + (1.0 - a))
        });
        (rgb.collect(), alpha)
    }
}

/// Matte of an image that shows the object on white: coverage is the distance from white. Small enclosed white
/// regions (highlights) belong to the object.
pub(crate) fn from_white(image: &Image) -> Matte {
    let darkness = |p: &[u8; 4]| 255 - p[0].min(p[1]).min(p[2]);
    let mut alpha: Vec<f32> =
        image.pixels.iter().map(|p| ((f32::from(darkness(p)) - 2.0) / 10.0).clamp(0.0, 1.0)).collect();
    let inside = alpha.iter().map(|&a| a > 0.0).collect();
    let mut mask = Mask { width: image.width, height: image.height, inside };
    let area = mask.inside.iter().filter(|i| **i).count();
    for pixel in silhouette::fill_holes(&mut mask, area / 100) {
        alpha[pixel] = 1.0;
    }
    let rgb = image.pixels.iter().map(|p| [p[0], p[1], p[2]].map(|v| f32::from(v) / 255.0)).collect();
    (rgb, alpha)
}

/// Connected pieces of a matte, as lists of pixels.
pub(super) fn pieces(alpha: &[f32], width: usize, height: usize) -> Vec<Vec<usize>> {
    silhouette::pieces(&Mask { width, height, inside: alpha.iter().map(|a| *a > 0.5).collect() }, true)
}

/// The largest connected piece of a matte.
pub(super) fn largest_piece(alpha: &[f32], width: usize, height: usize) -> Vec<bool> {
    let largest = pieces(alpha, width, height).into_iter().max_by_key(Vec::len).unwrap_or_default();
    let mut inside = vec![false; alpha.len()];
    largest.into_iter().for_each(|pixel| inside[pixel] = true);
    inside
}

/// Dilates a map by a square of this margin.
pub(super) fn grown(inside: &[bool], width: usize, height: usize, margin: usize) -> Vec<bool> {
    // along lines of this length with this pixel stride
    let along = |inside: &[bool], length: usize, step: usize| {
        let mut near = inside.to_vec();
        for i in (0..inside.len()).filter(|&i| inside[i]) {
            let place = i / step % length;
            let (before, after) = (margin.min(place), margin.min(length - 1 - place));
            (i - before * step..=i + after * step).step_by(step).for_each(|other| near[other] = true);
        }
        near
    };
    along(&along(inside, width, 1), height, width)
}

/// Linear light of an 8-bit sRGB value.
fn linear_from_srgb(value: u8) -> f32 {
    let v = f32::from(value) / 255.0;
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// sRGB value of linear light, both 0…1.
fn srgb_from_linear(v: f32) -> f32 {
    let v = v.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}
