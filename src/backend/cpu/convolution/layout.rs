//! Images with their channels side by side, so that a vector holds neighbouring channels of one pixel.

use rayon::prelude::*;

use crate::backend::cpu::Temporary;
use crate::scalar::{Job, Lane, Path, Real};

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
        let extent = [channels, columns.len()];
        assert!(start + (channels - 1) * plane + columns.len() <= planes.len(), "within the planes");
        let from = planes[start..].as_ptr();
        let turn = Turn { from, from_row: plane, to: row.as_mut_ptr(), to_row: pixel, extent };
        // SAFETY: the best path is available; the planes were checked on the lines above, and the row is this thread's.
        unsafe { T::dispatch(Path::best(), turn) };
        if pixel > channels {
            row.chunks_exact_mut(pixel).for_each(|pixel| pixel[channels..].fill(T::ZERO));
        }
    });
    turned
}

/// Rows become columns: `to[c · to_row + r] = from[r · from_row + c]` for the rows and columns of `extent`. Both ends must be
/// there, and nobody else may write to the one.
pub(super) struct Turn<T> {
    pub(super) from: *const T,
    pub(super) from_row: usize,
    pub(super) to: *mut T,
    pub(super) to_row: usize,
    pub(super) extent: [usize; 2],
}

impl<T: Real> Job<T> for Turn<T> {
    type Output = ();

    /// # Safety
    /// Both ends must be there.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { from, from_row, to, to_row, extent: [rows, columns] } = self;
        let whole = [rows, columns].map(|count| count / V::SIDE * V::SIDE);
        let [down, across] = whole.map(|count| count / V::SIDE);
        // along what lies far apart in memory last, so that its lines of the cache are done with one after another
        let far = from_row >= to_row;
        // SAFETY: all of it lies within the extent, both ends of which the caller promises.
        unsafe {
            for number in 0..down * across {
                let (r, c) = if far { (number / across, number % across) } else { (number % down, number / down) };
                let (r, c) = (r * V::SIDE, c * V::SIDE);
                let mut square = [from; 8];
                for i in 0..V::SIDE {
                    square[i] = from.add((r + i) * from_row + c);
                }
                V::transpose(&square, to.add(c * to_row + r), to_row);
            }
            for r in 0..rows {
                for c in if r < whole[0] { whole[1] } else { 0 }..columns {
                    *to.add(c * to_row + r) = *from.add(r * from_row + c);
                }
            }
        }
    }
}
