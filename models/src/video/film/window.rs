//! Mattes of the object in windows around its track.

use rayon::prelude::*;

use super::chosen::Chosen;
use super::survey::Survey;
use crate::video::image::Image;
use crate::video::matte::{self, Matte};

/// A rectangle of pixels: left, top, width and height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Window {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

/// Windows of one size around the object in all chosen pictures; the whole picture where it is not known.
pub(super) fn all(chosen: &Chosen, survey: &Survey, scale: f64) -> Vec<Window> {
    let (width, height) = (chosen.images[0].width, chosen.images[0].height);
    let whole = Window { left: 0, top: 0, width, height };
    let of = |number: &usize| match survey.window(*number) {
        None => whole,
        Some(rect) => {
            let [left, top, right, bottom] = rect.map(|v| v * scale);
            let inside = |v: f64, most: usize| (v.max(0.0) as usize).min(most);
            let (left, top) = (inside(left.floor(), width - 1), inside(top.floor(), height - 1));
            let (right, bottom) =
                (inside(right.ceil(), width).max(left + 1), inside(bottom.ceil(), height).max(top + 1));
            Window { left, top, width: right - left, height: bottom - top }
        }
    };
    chosen.numbers.iter().map(of).collect()
}

impl Window {
    /// The part of a picture in the window.
    pub fn of(&self, image: &Image) -> Image {
        let rows = (self.top..self.top + self.height).map(|y| y * image.width + self.left);
        let pixels = rows.flat_map(|start| image.pixels[start..start + self.width].iter().copied()).collect();
        Image { width: self.width, height: self.height, pixels, has_alpha: image.has_alpha }
    }

    /// A matte of the whole picture: nothing outside the window.
    pub fn into_whole(self, (rgb, alpha): Matte, width: usize, height: usize) -> Matte {
        let mut whole = (vec![[1.0; 3]; width * height], vec![0.0; width * height]);
        for row in 0..self.height {
            let (from, to) = (row * self.width, (self.top + row) * width + self.left);
            whole.0[to..to + self.width].copy_from_slice(&rgb[from..from + self.width]);
            whole.1[to..to + self.width].copy_from_slice(&alpha[from..from + self.width]);
        }
        whole
    }
}

/// Pixels around the object's survey component that can belong to it \[pixels of the survey\].
const NEAR: f64 = 1.5;

/// Leaves in each matte what belongs to the object: pieces that touch its component, without the pixels of other
/// moving things.
pub(super) fn alone(mattes: &mut [Matte], numbers: &[usize], survey: &Survey, scale: f64, [width, height]: [usize; 2]) {
    mattes.par_iter_mut().zip(numbers).for_each(|((rgb, alpha), number)| {
        let clear = |pixel: usize, rgb: &mut Vec<[f32; 3]>, alpha: &mut Vec<f32>| {
            (rgb[pixel], alpha[pixel]) = ([1.0; 3], 0.0);
        };
        let place = |pixel: usize| [(pixel % width) as f64 / scale, (pixel / width) as f64 / scale];
        let own = survey.component(*number);
        if let Some(own) = own {
            for other in survey.others(*number) {
                for [row, first, last] in &other.runs {
                    let scaled = |v: u16, most: usize| ((f64::from(v) * scale).round() as usize).min(most);
                    for y in scaled(*row, height)..scaled(row + 1, height) {
                        for x in scaled(*first, width)..scaled(*last, width) {
                            let pixel = y * width + x;
                            let [u, v] = place(pixel);
                            let off = (u - own.middle[0]).hypot(v - own.middle[1]);
                            if off > 0.5 * survey.width() && !own.covers([u, v]) {
                                clear(pixel, rgb, alpha);
                            }
                        }
                    }
                }
            }
        }
        let pieces = matte::pieces(alpha, width, height);
        let touches = |piece: &Vec<usize>| match own {
            Some(own) => piece.iter().any(|pixel| own.covers(place(*pixel))),
            None => false,
        };
        let largest = pieces.iter().map(Vec::len).max().unwrap_or(0);
        let any = pieces.iter().any(touches);
        let mut keep = vec![false; alpha.len()];
        for piece in &pieces {
            // without a component to go by, the largest
            if if any { touches(piece) } else { piece.len() == largest } {
                piece.iter().for_each(|pixel| keep[*pixel] = true);
            }
        }
        let near = matte::grown(&keep, width, height, (NEAR * scale).ceil() as usize);
        (0..alpha.len()).filter(|pixel| !near[*pixel]).for_each(|pixel| clear(pixel, rgb, alpha));
        for piece in pieces.iter().filter(|piece| !keep[piece[0]]) {
            piece.iter().for_each(|pixel| clear(*pixel, rgb, alpha));
        }
    });
}
