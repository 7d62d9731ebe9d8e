//! Images with their channels side by side, so that a vector holds neighbouring channels of one pixel.

use rayon::prelude::*;

use crate::backend::cpu::Temporary;
use crate::scalar::Real;

/// Channels that are read together while a row is turned.
const BLOCK: usize = 16;

/// What part of some planes is wanted: `extent` places along each axis, the first of which lies `before` places in front of
/// the image. Places outside the image are 0.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    pub(super) size: [usize; 3],
    pub(super) before: [isize; 3],
    pub(super) extent: [usize; 3],
}

impl Window {
    /// The place in the image, if it is inside.
    fn inside(&self, axis: usize, place: usize) -> Option<usize> {
        place.checked_add_signed(-self.before[axis]).filter(|&at| at < self.size[axis])
    }
}

/// `[images, channels, planes]` turned into `[images, extent, pixel]`, where a pixel holds its channels and zeros up to its
/// length.
pub(super) fn channels_last<T: Real>(planes: &[T], channels: usize, window: &Window, pixel: usize) -> Temporary<T> {
    let Window { size: [_, height, width], extent, .. } = *window;
    let plane: usize = window.size.iter().product();
    let images = planes.len() / (channels * plane);
    let mut turned = Temporary::new(images * extent.iter().product::<usize>() * pixel);
    let columns: Vec<_> = (0..extent[2]).filter_map(|w| Some((w, window.inside(2, w)?))).collect();
    turned.par_chunks_mut(extent[2] * pixel).enumerate().for_each(|(number, row)| {
        let (image, rest) = (number / (extent[0] * extent[1]), number % (extent[0] * extent[1]));
        let (d, h) = (window.inside(0, rest / extent[1]), window.inside(1, rest % extent[1]));
        let Some(((d, h), &(to, from))) = d.zip(h).zip(columns.first()) else {
            row.fill(T::ZERO);
            return;
        };
        row[..to * pixel].fill(T::ZERO);
        row[(to + columns.len()) * pixel..].fill(T::ZERO);
        let row = &mut row[to * pixel..(to + columns.len()) * pixel];
        let start = image * channels * plane + (d * height + h) * width + from;
        for first in (0..channels).step_by(BLOCK) {
            let last = channels.min(first + BLOCK);
            for (w, to) in row.chunks_exact_mut(pixel).enumerate() {
                for c in first..last {
                    to[c] = planes[start + c * plane + w];
                }
            }
        }
        if pixel > channels {
            row.chunks_exact_mut(pixel).for_each(|pixel| pixel[channels..].fill(T::ZERO));
        }
    });
    turned
}
