//! The innermost loop: a tile of the product in registers.
//!
//! A tile is a few rows by one or two vectors. For each step along the depth the vectors of the right factor are
//! loaded, each element of the left factor is spread over a vector, and every pair is multiplied and added. The sizes
//! are chosen so that all sums, the right vectors and one left element fill the registers of the processor.

use std::mem::MaybeUninit;

use super::epilogue::{Activation, Epilogue, Finish};
use crate::backend::cpu::prefetch;
use crate::scalar::{Job, Lane, Path, Real};

/// The most rows that a tile has on any processor, and the most values in one of its rows.
pub(super) const MOST_ROWS: usize = 14;
const MOST_COLUMNS: usize = 32;

/// Steps along the depth by which the right factor is asked for ahead of its use.
const AHEAD: usize = 8;

/// Pairs of steps along the depth for each line of the cache.
const fn turns<T>() -> usize {
    64 / (2 * size_of::<T>())
}

/// Vectors in a row of a full tile.
pub(super) const fn vectors<V: Lane>() -> usize {
    if V::REGISTERS >= 16 { 2 } else { 1 }
}

/// Rows of a full tile: one register is for the left element, and one for each right vector.
pub(super) const fn rows<V: Lane>() -> usize {
    let rows = (V::REGISTERS - vectors::<V>() - 1) / vectors::<V>();
    if rows > MOST_ROWS { MOST_ROWS } else { rows }
}

/// Rows of a full tile whose left factor is read in place: two steps along the depth at a time, so that an address serves
/// twice, take more registers for the right factor.
const fn rows_in_place<V: Lane>() -> usize {
    let rows = (V::REGISTERS - 2 * vectors::<V>() - 1) / vectors::<V>();
    if rows > MOST_ROWS { MOST_ROWS } else { rows }
}

/// The sizes of a full tile.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    pub(super) rows: usize,
    pub(super) rows_in_place: usize,
    pub(super) columns: usize,
    /// The width of a vector.
    pub(super) vector: usize,
}

/// Asks for the sizes of a tile.
pub(super) struct Measure;

impl<T: Real> Job<T> for Measure {
    type Output = Extent;

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) -> Extent {
        const { assert!(vectors::<V>() * V::WIDTH <= MOST_COLUMNS) };
        let columns = vectors::<V>() * V::WIDTH;
        Extent { rows: rows::<V>(), rows_in_place: rows_in_place::<V>(), columns, vector: V::WIDTH }
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
    pub(super) unsafe fn run(&self, path: Path, extent: Extent) {
        let Extent { columns: full, vector, .. } = extent;
        // rows of whole vectors are made where they belong
        let whole = if self.out_column == 1 { self.columns / full } else { 0 };
        // SAFETY: the caller's promise; a whole strip of the right factor takes `depth · full` values.
        unsafe {
            if whole > 0 {
                let bias = self.column_bias(0, whole * full);
                self.make(path, self.right, self.out, self.out_row, [whole, full / vector], bias);
            }
            for column in (whole * full..self.columns).step_by(full) {
                self.beside(path, column, full.min(self.columns - column), vector);
            }
        }
    }

    /// The bias of some columns of the strip, where there is one to be added now.
    fn column_bias(&self, column: usize, width: usize) -> Option<&[T]> {
        let bias = self.epilogue?.column_bias?;
        Some(&bias[self.first_column + column..][..width])
    }

    /// Makes a tile whose rows are no whole vectors in memory, in memory of its own.
    unsafe fn beside(&self, path: Path, column: usize, width: usize, vector: usize) {
        let row = width.next_multiple_of(vector);
        let out = self.out.wrapping_add(column * self.out_column);
        let mut memory = MaybeUninit::<[T; MOST_ROWS * MOST_COLUMNS]>::uninit();
        let tile: *mut T = memory.as_mut_ptr().cast();
        let mut padded = [T::ZERO; MOST_COLUMNS];
        let bias = self.column_bias(column, width).map(|bias| {
            padded[..width].copy_from_slice(bias);
            &padded[..row]
        });
        // SAFETY: the caller's promise; the tile has room for its rows, and is written before it is read.
        unsafe {
            if self.accumulate {
                for r in 0..self.rows {
                    for c in 0..row {
                        let from = out.wrapping_add(r * self.out_row + c * self.out_column);
                        *tile.add(r * row + c) = if c < width { *from } else { T::ZERO };
                    }
                }
            }
            self.make(path, self.right.add(column * self.depth), tile, row, [1, row / vector], bias);
            let put = |r: usize, c: usize| {
                *out.wrapping_add(r * self.out_row + c * self.out_column) = *tile.add(r * row + c);
            };
            // neighbours in the output one after another
            if self.out_row < self.out_column {
                (0..width).for_each(|c| (0..self.rows).for_each(|r| put(r, c)));
            } else {
                (0..self.rows).for_each(|r| (0..width).for_each(|c| put(r, c)));
            }
        }
    }

    /// Makes `tiles` tiles side by side, of `vectors` vectors each.
    unsafe fn make(
        &self,
        path: Path,
        right: *const T,
        out: *mut T,
        out_row: usize,
        [tiles, vectors]: [usize; 2],
        column_bias: Option<&[T]>,
    ) {
        let Self { rows, depth, left, left_row, left_depth, scale, accumulate, .. } = *self;
        // what is cheap happens in the registers, everything else afterwards
        let simple = self.epilogue.is_none_or(Epilogue::is_simple);
        let ending = self.epilogue.filter(|_| simple).map(|epilogue| Ending {
            bias: column_bias.map_or(std::ptr::null(), <[T]>::as_ptr),
            least: if epilogue.activation == Activation::Relu { T::ZERO } else { -T::INFINITY },
        });
        // SAFETY: the caller's promise.
        unsafe {
            Sums { tiles, depth, left, left_row, left_depth, right, out, out_row, scale, accumulate, ending }
                .dispatch(path, rows, vectors);
            if let Some(epilogue) = self.epilogue.filter(|_| !simple) {
                let column_bias = column_bias.map(<[T]>::as_ptr);
                let (shape, row, first_row) = ([rows, tiles * vectors], out_row, self.first_row);
                T::dispatch(path, Finish { epilogue, tile: out, row, first_row, shape, column_bias });
            }
        }
    }
}

/// The sums of tiles side by side, stored as rows of whole vectors; most fields are those of [`Strip`].
#[derive(Clone, Copy)]
struct Sums<T> {
    tiles: usize,
    depth: usize,
    left: *const T,
    left_row: usize,
    left_depth: usize,
    right: *const T,
    out: *mut T,
    out_row: usize,
    scale: T,
    accumulate: bool,
    ending: Option<Ending<T>>,
}

/// What happens to complete sums in the registers: `max(least, sum + bias)`.
#[derive(Clone, Copy)]
struct Ending<T> {
    /// One for each column, or null.
    bias: *const T,
    /// 0 for relu, else −∞.
    least: T,
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
        let most = if SIDE_BY_SIDE { rows::<V>() } else { rows_in_place::<V>() };
        if ROWS > most || VECTORS > vectors::<V>() {
            unreachable!("no tile of this processor is as large");
        }
        let sums = self.0;
        for tile in 0..sums.tiles {
            let column = tile * VECTORS * V::WIDTH;
            // SAFETY: the caller's promise.
            unsafe { self.tile::<V>(sums.right.add(column * sums.depth), sums.out.add(column), column) }
        }
    }
}

impl<T: Real, const ROWS: usize, const VECTORS: usize, const SIDE_BY_SIDE: bool> Sized<T, ROWS, VECTORS, SIDE_BY_SIDE> {
    #[inline(always)]
    unsafe fn tile<V: Lane<Element = T>>(&self, mut right: *const T, out: *mut T, column: usize) {
        let Sums { depth, mut left, left_row, left_depth, out_row, scale, accumulate, ending, .. } = self.0;
        let step = VECTORS * V::WIDTH;
        // SAFETY: the caller's promise.
        unsafe {
            let mut sums = [[V::splat(T::ZERO); VECTORS]; ROWS];
            for r in 0..ROWS {
                for v in 0..VECTORS {
                    prefetch::to_read::<false, T>(out.wrapping_add(r * out_row + v * V::WIDTH));
                }
            }
            let mut rest = depth;
            if !SIDE_BY_SIDE {
                // the rows of the next strip, a line of each in turn: what lies in many places the processor does not see coming
                let next = if column == 0 { ROWS * left_row } else { 0 };
                while rest >= 2 {
                    for k in 0..ROWS.div_ceil(turns::<T>()) {
                        let row = k * turns::<T>() + rest / 2 % turns::<T>();
                        prefetch::to_read::<false, T>(left.wrapping_add(next + row * left_row));
                    }
                    let mut b = [[V::splat(T::ZERO); VECTORS]; 2];
                    for v in 0..VECTORS {
                        prefetch::to_read::<true, T>(right.wrapping_add(AHEAD * step + v * V::WIDTH));
                        prefetch::to_read::<true, T>(right.wrapping_add((AHEAD + 1) * step + v * V::WIDTH));
                        b[0][v] = V::load(right.add(v * V::WIDTH));
                        b[1][v] = V::load(right.add(step + v * V::WIDTH));
                    }
                    for r in 0..ROWS {
                        let at = left.add(r * left_row);
                        let a = V::splat(*at);
                        for v in 0..VECTORS {
                            sums[r][v] = a.mul_add(b[0][v], sums[r][v]);
                        }
                        let a = V::splat(*at.add(1));
                        for v in 0..VECTORS {
                            sums[r][v] = a.mul_add(b[1][v], sums[r][v]);
                        }
                    }
                    left = left.wrapping_add(2);
                    right = right.wrapping_add(2 * step);
                    rest -= 2;
                }
            }
            let left_row = if SIDE_BY_SIDE { 1 } else { left_row };
            let left_depth = if SIDE_BY_SIDE { left_depth } else { 1 };
            for _ in 0..rest {
                let mut b = [V::splat(T::ZERO); VECTORS];
                for v in 0..VECTORS {
                    prefetch::to_read::<true, T>(right.wrapping_add(AHEAD * step + v * V::WIDTH));
                    b[v] = V::load(right.add(v * V::WIDTH));
                }
                for r in 0..ROWS {
                    let a = V::splat(*left.add(r * left_row));
                    for v in 0..VECTORS {
                        sums[r][v] = a.mul_add(b[v], sums[r][v]);
                    }
                }
                left = left.wrapping_add(left_depth);
                right = right.wrapping_add(step);
            }
            // the cases are told apart outside the loops, which are unrolled
            let scale = V::splat(scale);
            macro_rules! store {
                (|$sum:ident, $at:ident, $v:ident| $value:expr) => {
                    for r in 0..ROWS {
                        for $v in 0..VECTORS {
                            let ($sum, $at) = (sums[r][$v], out.add(r * out_row + $v * V::WIDTH));
                            $value.store($at);
                        }
                    }
                };
            }
            let Some(Ending { bias, least }) = ending else {
                if accumulate {
                    store!(|sum, at, v| scale.mul_add(sum, V::load(at)));
                } else {
                    store!(|sum, at, v| scale.mul(sum));
                }
                return;
            };
            let mut biases = [V::splat(T::ZERO); VECTORS];
            if !bias.is_null() {
                for v in 0..VECTORS {
                    biases[v] = V::load(bias.add(column + v * V::WIDTH));
                }
            }
            // the larger of a pair is the second where either is NaN
            let least = V::splat(least);
            if accumulate {
                store!(|sum, at, v| least.larger(scale.mul_add(sum, V::load(at)).add(biases[v])));
            } else {
                store!(|sum, at, v| least.larger(scale.mul(sum).add(biases[v])));
            }
        }
    }
}
