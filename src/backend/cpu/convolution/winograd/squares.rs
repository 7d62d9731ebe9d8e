//! Slices of an image turned into transformed squares, and the ring of those that are still needed.

use std::ops::Range;

use rayon::prelude::*;

use super::transform::{BLOCK, Square, Step, Transform};
use super::{PLACES, Shared};
use crate::backend::cpu::Temporary;
use crate::scalar::{Path, Real};

/// An image with its channels last whose squares are transformed, slice by slice, by neighbouring rows of squares.
pub(super) struct Squares<'a, T> {
    pub(super) step: Step,
    pub(super) pixels: &'a [T],
    /// Rows and columns of a slice, and its channels.
    pub(super) extent: [usize; 2],
    pub(super) channels: usize,
    /// Squares in a row.
    pub(super) across: usize,
    /// Whether the channels are laid out by blocks, `[places, blocks, tiles, 16]`, or not, `[places, tiles, channels]`.
    pub(super) by_blocks: bool,
}

impl<T: Real> Squares<'_, T> {
    /// Transforms some rows of squares of some slices.
    pub(super) fn transform(&self, slices: Range<usize>, rows: Range<usize>, into: &mut [T]) {
        let Self { step, pixels, extent, channels, across, by_blocks } = *self;
        let tiles = slices.len() * rows.len() * across;
        let line = extent[1] * channels;
        let side = if step == Step::Input { 4 } else { 2 };
        let place = tiles * channels;
        let to_next = if by_blocks { BLOCK } else { channels };
        let to_block = if by_blocks { tiles * BLOCK } else { BLOCK };
        let reach = (channels / BLOCK - 1) * to_block + (across - 1) * to_next + BLOCK;
        let into = Shared::new(into);
        (0..slices.len() * rows.len()).into_par_iter().with_min_len(2).for_each(|number| {
            let slice = slices.start + number / rows.len();
            let first = slice * extent[0] * line + (rows.start + number % rows.len()) * 2 * line;
            let pixels = &pixels[first..first + side * line];
            let to = into.at(number * across * to_next, (PLACES - 1) * place + reach);
            let transform = Transform {
                step,
                from: Square { at: pixels.as_ptr(), row: line, column: channels },
                to: Square { at: to, row: 4 * place, column: place },
                channels,
                to_block,
                count: across,
                from_next: 2 * channels,
                to_next,
            };
            // SAFETY: the best path is available. `side` lines of pixels and the last place were checked to be there, and
            // each row of squares is written by one thread.
            unsafe { T::dispatch(Path::best(), transform) };
        });
    }
}

/// Transformed slices, as many as are needed at a time.
pub(super) struct Ring<T: Real> {
    values: Temporary<T>,
    /// The slice and the first row of squares that each part holds.
    kept: Vec<Option<(usize, usize)>>,
}

impl<T: Real> Ring<T> {
    /// A ring of `slices` with room for `tiles` squares each.
    pub(super) fn new(slices: usize, tiles: usize, channels: usize) -> Self {
        Self { values: Temporary::new(slices * PLACES * tiles * channels), kept: vec![None; slices] }
    }

    /// Transforms a slice that is not there yet, in place of one that is not needed any more.
    pub(super) fn fill(&mut self, squares: &Squares<'_, T>, slice: usize, rows: &Range<usize>) {
        let (place, length) = (slice % self.kept.len(), self.values.len() / self.kept.len());
        if self.kept[place] != Some((slice, rows.start)) {
            self.kept[place] = Some((slice, rows.start));
            squares.transform(slice..slice + 1, rows.clone(), &mut self.values[place * length..][..length]);
        }
    }

    /// Transforms slices that do not depend on others, all at once; the ring has one part, the slice 0.
    pub(super) fn fill_all(&mut self, squares: &Squares<'_, T>, slices: &Range<usize>, rows: &Range<usize>) {
        squares.transform(slices.clone(), rows.clone(), &mut self.values);
    }

    /// A slice that is there.
    pub(super) fn slice(&self, slice: usize) -> &[T] {
        let length = self.values.len() / self.kept.len();
        &self.values[slice % self.kept.len() * length..][..length]
    }
}
