//! The loops around the tiles: which part of the factors is in which cache when.
//!
//! One block of the right factor, packed, stays in the second-level cache; one strip of the left factor at a time, packed
//! or in place, stays in the first-level cache and meets every strip of that block. The depth is cut so that a strip
//! fits, and the cuts depend on nothing but its length: however the product is divided among threads, each of its
//! elements is the same sum in the same order.

use std::ops::Range;

use super::scratch;
use super::tile::{Extent, Strip};
use super::{Out, Task};
use crate::scalar::{Path, Real};

/// Bytes of one line of a factor within a block of the depth.
const LINE: usize = 1536;
/// Columns of a block of the right factor: 480 KiB.
pub(super) const COLUMNS: usize = 320;
/// Rows that go through the whole depth before the next ones begin, so that what is summed up stays near.
const ROWS: usize = 2048;
/// Strips of the right factor from which on packing a strip of the left one pays, where it could be read in place.
const STRIPS: usize = 12;
/// The same where neighbouring rows are this many bytes apart or more: they then compete for the same places of the
/// first-level cache.
const FEW_STRIPS: usize = 3;
const FAR: usize = 2048;

/// Cuts `0..length` into even pieces of at most `most`, at least one.
pub(super) fn pieces(length: usize, most: usize) -> impl Iterator<Item = Range<usize>> + Clone {
    let count = length.div_ceil(most).max(1);
    (0..count).map(move |i| length * i / count..length * (i + 1) / count)
}

/// Terms of a sum that a strip is packed for at a time.
pub(super) const fn depth_block<T>() -> usize {
    LINE / size_of::<T>()
}

/// Makes the part `rows × columns` of a product, on the calling thread.
pub(super) fn run<T: Real>(task: &Task<'_, T>, rows: Range<usize>, columns: Range<usize>, out: Out<'_, T>) {
    let Extent { rows: tile_rows, columns: tile_columns, .. } = task.tile;
    let depth_most = depth_block::<T>().min(task.depth.len());
    let block_columns = columns.len().min(COLUMNS).next_multiple_of(tile_columns);
    let one_block = columns.len() <= COLUMNS;
    let block_rows = rows.len().min(ROWS);
    let left_rows = if one_block { tile_rows } else { block_rows };
    scratch::with([depth_most * left_rows, depth_most * block_columns], |[left, right]| {
        let mut part = Part { task, out, left, right, one_block };
        for block in pieces(rows.len(), ROWS) {
            part.rows(rows.start + block.start..rows.start + block.end, columns.clone());
        }
    });
}

struct Part<'a, T> {
    task: &'a Task<'a, T>,
    out: Out<'a, T>,
    left: &'a mut [T],
    right: &'a mut [T],
    /// Whether every strip of the left factor is used for one block of the right one only.
    one_block: bool,
}

impl<T: Real> Part<'_, T> {
    fn rows(&mut self, rows: Range<usize>, columns: Range<usize>) {
        let Extent { rows: tile_rows, rows_in_place, columns: tile_columns, .. } = self.task.tile;
        let in_place = self.task.left.strided().filter(|left| {
            let far = left.line * size_of::<T>() >= FAR;
            let reused = columns.len().div_ceil(tile_columns) >= if far { FEW_STRIPS } else { STRIPS };
            left.line == 1 && left.depth == 1
                || (left.depth == 1 || left.line == 1 && rows.len() <= tile_rows) && !reused
        });
        let height = if in_place.is_some_and(|left| left.line != 1) { rows_in_place } else { tile_rows };
        for depth in pieces(self.task.depth.len(), depth_block::<T>()) {
            let first = depth.start == 0;
            let last = depth.end == self.task.depth.len();
            let depth = self.task.depth.start + depth.start..self.task.depth.start + depth.end;
            if in_place.is_none() && !self.one_block {
                for strip in pieces(rows.len(), tile_rows) {
                    let packed = &mut self.left[strip.start * depth.len()..strip.end * depth.len()];
                    let lines = rows.start + strip.start..rows.start + strip.end;
                    self.task.left.pack(lines, depth.clone(), strip.len(), packed);
                }
            }
            for block in pieces(columns.len().div_ceil(tile_columns), COLUMNS / tile_columns) {
                let end = columns.len().min(block.end * tile_columns);
                let block = columns.start + block.start * tile_columns..columns.start + end;
                let right = match self.task.right.packed(&block, &depth) {
                    Some(strips) => strips.as_ptr(),
                    None => self.pack_right(block.clone(), depth.clone()),
                };
                for strip in pieces(rows.len(), height) {
                    let lines = rows.start + strip.start..rows.start + strip.end;
                    let (left, left_row, left_depth) = match in_place {
                        Some(left) => {
                            let from = &left.values[lines.start * left.line + depth.start * left.depth..];
                            (from.as_ptr(), left.line, left.depth)
                        }
                        None if self.one_block => {
                            let packed = &mut self.left[..strip.len() * depth.len()];
                            self.task.left.pack(lines.clone(), depth.clone(), strip.len(), packed);
                            (packed.as_ptr(), 1, strip.len())
                        }
                        None => (self.left[strip.start * depth.len()..].as_ptr(), 1, strip.len()),
                    };
                    let job = Strip {
                        rows: lines.len(),
                        first_row: lines.start,
                        depth: depth.len(),
                        left,
                        left_row,
                        left_depth,
                        right,
                        columns: block.len(),
                        first_column: block.start,
                        out: self.out.at(lines.start, block.start),
                        out_row: self.out.row,
                        out_column: self.out.column,
                        scale: self.task.scale,
                        accumulate: self.task.accumulate || !first,
                        epilogue: Some(&self.task.epilogue).filter(|epilogue| last && !epilogue.is_none()),
                    };
                    // SAFETY: the best path is available. The packed factors hold whole strips; one in place was checked
                    // against the sizes of the product, like the output, whose parts are made by one thread each.
                    unsafe { job.run(Path::best(), self.task.tile) };
                }
            }
        }
    }

    fn pack_right(&mut self, block: Range<usize>, depth: Range<usize>) -> *const T {
        let Extent { columns: tile_columns, vector, .. } = self.task.tile;
        // the last strip is as wide as the vectors that its columns fill
        let last = block.len() / tile_columns * tile_columns;
        let width = (block.len() - last).next_multiple_of(vector);
        if last + width > block.len() {
            self.right[last * depth.len()..][..width * depth.len()].fill(T::ZERO);
        }
        let packed = &mut self.right[..(last + width) * depth.len()];
        self.task.right.pack_strips(block, depth, [tile_columns, vector], packed);
        self.right.as_ptr()
    }
}
