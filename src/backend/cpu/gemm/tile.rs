//! The innermost loop: a tile of the product in registers.
//!
//! A tile is a few rows by one or two vectors. For each step along the depth the vectors of the right factor are
//! loaded, each element of the left factor is spread over a vector, and every pair is multiplied and added. The sizes
//! are chosen so that all sums, the right vectors and one left element fill the registers of the processor.

use std::mem::MaybeUninit;

use super::epilogue::{Epilogue, Finish};
use super::prefetch;
use crate::scalar::{Job, Lane, Path, Real};

/// The most rows that a tile has on any processor, and the most values in one of its rows.
pub(super) const MOST_ROWS: usize = 14;
const MOST_COLUMNS: usize = 32;

/// Steps along the depth by which the right factor is asked for ahead of its use.
const AHEAD: usize = 8;

/// Vectors in a row of a full tile.
pub(super) const fn vectors<V: Lane>() -> usize {
    if V::REGISTERS >= 16 { 2 } else { 1 }
}

/// Rows of a full tile: one register is for the left element, and one for each right vector.
pub(super) const fn rows<V: Lane>() -> usize {
    let rows = (V::REGISTERS - vectors::<V>() - 1) / vectors::<V>();
    if rows > MOST_ROWS { MOST_ROWS } else { rows }
}

/// Rows and columns of a full tile, and the width of a vector.
pub(super) struct Extent;

impl<T: Real> Job<T> for Extent {
    type Output = [usize; 3];

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) -> [usize; 3] {
        const { assert!(vectors::<V>() * V::WIDTH <= MOST_COLUMNS) };
        [rows::<V>(), vectors::<V>() * V::WIDTH, V::WIDTH]
    }
}

/// A row of tiles: one strip of the left factor times every strip of a packed block of the right one.
pub(super) struct Strip<'a, T> {
    /// Rows of the strip, not more than a tile has, and its place in the product.
    pub(super) rows: usize,
    pub(super) first_row: usize,
    /// Terms of each sum.
    pub(super) depth: usize,
    /// Element `(r, d)` of the left factor is `left[r · left_row + d · left_depth]`.
    pub(super) left: *const T,
    pub(super) left_row: usize,
    pub(super) left_depth: usize,
    /// Strips of a tile's columns, each `[depth, columns of a tile]`; the last one is as wide as its vectors.
    pub(super) right: *const T,
    /// Columns of the block, and the first one's place in the product.
    pub(super) columns: usize,
    pub(super) first_column: usize,
    /// Where the block's element `(0, 0)` of the product goes, and the distances there.
    pub(super) out: *mut T,
    pub(super) out_row: usize,
    pub(super) out_column: usize,
    /// `out = scale · product`, or `out += scale · product`.
    pub(super) scale: T,
    pub(super) accumulate: bool,
    /// Set where the sums are complete.
    pub(super) epilogue: Option<&'a Epilogue<'a, T>>,
}

impl<T: Real> Strip<'_, T> {
    /// Makes the tiles of the strip.
    ///
    /// # Safety
    /// The path must be available, the pointers valid for the sizes, and the output's elements distinct and nobody
    /// else's.
    pub(super) unsafe fn run(&self, path: Path, [_, full, vector]: [usize; 3]) {
        for column in (0..self.columns).step_by(full) {
            let width = full.min(self.columns - column);
            // SAFETY: the caller's promise; a whole strip of the right factor takes `depth · full` values.
            unsafe { self.tile(path, column, width, width.next_multiple_of(vector), vector) }
        }
    }

    /// Makes one tile where it belongs, or, where its rows are no whole vectors in memory, beside it.
    unsafe fn tile(&self, path: Path, column: usize, width: usize, whole: usize, vector: usize) {
        let in_place = self.out_column == 1 && width == whole;
        let out = self.out.wrapping_add(column * self.out_column);
        let first_column = self.first_column + column;
        let mut beside = MaybeUninit::<[T; MOST_ROWS * MOST_COLUMNS]>::uninit();
        let (tile, row) = if in_place { (out, self.out_row) } else { (beside.as_mut_ptr().cast(), whole) };
        // SAFETY: the caller's promise; a tile beside the output has room for its rows, and is written before it is read.
        unsafe {
            if !in_place && self.accumulate {
                for r in 0..self.rows {
                    for c in 0..whole {
                        let from = out.wrapping_add(r * self.out_row + c * self.out_column);
                        *tile.add(r * row + c) = if c < width { *from } else { T::ZERO };
                    }
                }
            }
            let right = self.right.add(column * self.depth);
            let Self { depth, left, left_row, left_depth, scale, accumulate, .. } = *self;
            let sums = Sums { depth, left, left_row, left_depth, right, out: tile, out_row: row, scale, accumulate };
            sums.dispatch(path, self.rows, whole / vector);
            if let Some(epilogue) = self.epilogue {
                let mut padded = [T::ZERO; MOST_COLUMNS];
                let bias = epilogue.column_bias.map(|bias| {
                    let bias = &bias[first_column..first_column + width];
                    if width == whole {
                        return bias.as_ptr();
                    }
                    padded[..width].copy_from_slice(bias);
                    padded.as_ptr()
                });
                let shape = [self.rows, whole / vector];
                T::dispatch(path, Finish { epilogue, tile, row, first_row: self.first_row, shape, column_bias: bias });
            }
            if !in_place {
                for r in 0..self.rows {
                    for c in 0..width {
                        *out.wrapping_add(r * self.out_row + c * self.out_column) = *tile.add(r * row + c);
                    }
                }
            }
        }
    }
}

/// The sums of one tile, stored as rows of whole vectors; the fields are those of [`Strip`].
#[derive(Clone, Copy)]
struct Sums<T> {
    depth: usize,
    left: *const T,
    left_row: usize,
    left_depth: usize,
    right: *const T,
    out: *mut T,
    out_row: usize,
    scale: T,
    accumulate: bool,
}

impl<T: Real> Sums<T> {
    /// Runs the loop that is compiled for this number of rows and vectors.
    unsafe fn dispatch(self, path: Path, rows: usize, vectors: usize) {
        macro_rules! sizes {
            ($($rows:literal)*) => {
                match (rows, vectors, self.left_row == 1) {
                    $(
                        ($rows, 1, true) => T::dispatch(path, Sized::<T, $rows, 1, true>(self)),
                        ($rows, 1, false) => T::dispatch(path, Sized::<T, $rows, 1, false>(self)),
                        ($rows, 2, true) => T::dispatch(path, Sized::<T, $rows, 2, true>(self)),
                        ($rows, 2, false) => T::dispatch(path, Sized::<T, $rows, 2, false>(self)),
                    )*
                    _ => unreachable!("a strip is not higher than a tile"),
                }
            };
        }
        // SAFETY: the caller's promise.
        unsafe { sizes!(1 2 3 4 5 6 7 8 9 10 11 12 13 14) }
    }
}

/// [`Sums`] of `ROWS` rows and `VECTORS` vectors; `SIDE_BY_SIDE` where the rows of the left factor are.
struct Sized<T, const ROWS: usize, const VECTORS: usize, const SIDE_BY_SIDE: bool>(Sums<T>);

impl<T: Real, const ROWS: usize, const VECTORS: usize, const SIDE_BY_SIDE: bool> Job<T>
    for Sized<T, ROWS, VECTORS, SIDE_BY_SIDE>
{
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        if ROWS > rows::<V>() || VECTORS > vectors::<V>() {
            unreachable!("no tile of this processor is as large");
        }
        let Sums { depth, mut left, left_row, left_depth, mut right, out, out_row, scale, accumulate } = self.0;
        let left_row = if SIDE_BY_SIDE { 1 } else { left_row };
        let left_depth = if SIDE_BY_SIDE { left_depth } else { 1 };
        // SAFETY: the caller's promise.
        unsafe {
            let mut sums = [[V::splat(T::ZERO); VECTORS]; ROWS];
            for r in 0..ROWS {
                for v in 0..VECTORS {
                    prefetch::<false, T>(out.wrapping_add(r * out_row + v * V::WIDTH));
                }
            }
            for _ in 0..depth {
                for v in 0..VECTORS {
                    prefetch::<true, T>(right.wrapping_add((AHEAD * VECTORS + v) * V::WIDTH));
                }
                let mut b = [V::splat(T::ZERO); VECTORS];
                for v in 0..VECTORS {
                    b[v] = V::load(right.add(v * V::WIDTH));
                }
                for r in 0..ROWS {
                    let a = V::splat(*left.add(r * left_row));
                    for v in 0..VECTORS {
                        sums[r][v] = a.mul_add(b[v], sums[r][v]);
                    }
                }
                left = left.wrapping_add(left_depth);
                right = right.wrapping_add(VECTORS * V::WIDTH);
            }
            let scale = V::splat(scale);
            for r in 0..ROWS {
                for v in 0..VECTORS {
                    let at = out.add(r * out_row + v * V::WIDTH);
                    if accumulate {
                        scale.mul_add(sums[r][v], V::load(at)).store(at);
                    } else {
                        scale.mul(sums[r][v]).store(at);
                    }
                }
            }
        }
    }
}
