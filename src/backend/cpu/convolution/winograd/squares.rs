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
    /// Transforms a row of squares of a slice. It goes to the squares from number `at` on of the `tiles` that begin at `start`.
    fn row(&self, [slice, row]: [usize; 2], into: &Shared<T>, start: usize, [tiles, at]: [usize; 2]) {
        let Self { step, pixels, extent, channels, across, by_blocks } = *self;
        let line = extent[1] * channels;
        let side = if step == Step::Input { 4 } else { 2 };
        let place = tiles * channels;
        let to_next = if by_blocks { BLOCK } else { channels };
        let to_block = if by_blocks { tiles * BLOCK } else { BLOCK };
        let reach = (channels / BLOCK - 1) * to_block + (across - 1) * to_next + BLOCK;
        let first = slice * extent[0] * line + row * 2 * line;
        let pixels = &pixels[first..first + side * line];
        let transform = Transform {
            step,
            from: Square { at: pixels.as_ptr(), row: line, column: channels },
            to: Square {
                at: into.at(start + at * to_next, (PLACES - 1) * place + reach),
                row: 4 * place,
                column: place,
            },
            channels,
            to_block,
            count: across,
            from_next: 2 * channels,
            to_next,
        };
        // SAFETY: the best path is available. `side` lines of pixels and the last place were checked to be there, and each row
        // of squares is written by one thread.
        unsafe { T::dispatch(Path::best(), transform) };
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

    /// Transforms, all at once, those slices that are not there yet, in place of ones that are not needed any more.
    pub(super) fn fill(&mut self, squares: &Squares<'_, T>, slices: impl Iterator<Item = usize>, rows: &Range<usize>) {
        let (parts, length) = (self.kept.len(), self.values.len() / self.kept.len());
        let kept = &mut self.kept;
        let missing = |slice: &usize| kept[slice % parts].replace((*slice, rows.start)) != Some((*slice, rows.start));
        let missing: Vec<_> = slices.filter(missing).collect();
        let (into, tiles) = (Shared::new(&mut self.values), rows.len() * squares.across);
        (0..missing.len() * rows.len()).into_par_iter().with_min_len(2).for_each(|number| {
            let (slice, row) = (missing[number / rows.len()], number % rows.len());
            let start = slice % parts * length;
            squares.row([slice, rows.start + row], &into, start, [tiles, row * squares.across]);
        });
    }

    /// Transforms slices that do not depend on others, all at once; the ring has one part, the slice 0.
    pub(super) fn fill_all(&mut self, squares: &Squares<'_, T>, slices: &Range<usize>, rows: &Range<usize>) {
        let into = Shared::new(&mut self.values);
        let count = slices.len() * rows.len();
        (0..count).into_par_iter().with_min_len(2).for_each(|number| {
            let row = [slices.start + number / rows.len(), rows.start + number % rows.len()];
            squares.row(row, &into, 0, [count * squares.across, number * squares.across]);
        });
    }

    /// A slice that is there.
    pub(super) fn slice(&self, slice: usize) -> &[T] {
        let length = self.values.len() / self.kept.len();
        &self.values[slice % self.kept.len() * length..][..length]
    }
}
