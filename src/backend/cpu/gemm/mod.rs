//! Matrix products: `out = activation(scale · left · right + biases)`, or added to what is there.
//!
//! ```text
//! mod        a product and its settings, and how it is divided among threads
//! panel      where the factors come from: anything that can pack a few lines
//! packed     a factor that was packed before
//! block      the loops over blocks that fit the caches
//! tile       the innermost loop in registers, generic over the vector
//! epilogue   biases and activation, while the tile is in the first-level cache
//! split      sums so long that they are cut, for products with few elements
//! scratch    memory for packed strips, kept by each thread
//! ```
//!
//! The result does not depend on the number of threads: only rows and columns are divided among them, and a long sum is
//! cut by the shape of the product alone.

mod block;
mod epilogue;
mod packed;
mod panel;
pub(crate) mod scratch;
mod split;
#[cfg(test)]
mod tests;
mod tile;

use std::marker::PhantomData;
use std::ops::Range;

use rayon::prelude::*;

pub use epilogue::Activation;
use epilogue::Epilogue;
pub(crate) use packed::Packed;
pub(crate) use panel::{Panel, Strided};

use crate::scalar::{Path, Real};
use tile::{Extent, Measure};

/// Multiply-adds below which a product is made by one thread.
const SMALL: usize = 1 << 20;

/// How much better columns must fill the vectors than rows, for the product to be made transposed.
const TURN: f64 = 1.15;

/// Who works on a product.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Par {
    /// The calling thread alone, because the caller has divided its own work among the threads already.
    Sequential,
    /// Rayon's threads, where the product is large enough.
    Threads,
}

/// A product `[m, k] · [k, n]` with its settings; [`Gemm::run`] makes it.
///
/// ```text
/// Gemm::new([m, k, n]).column_bias(&bias).activation(Activation::Relu)
///     .run(&Strided::lines(x, k), &Strided::lines(weight, k), Out::rows(&mut y, n), Par::Threads);
/// ```
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gemm<'a, T> {
    sizes: [usize; 3],
    scale: T,
    accumulate: bool,
    epilogue: Epilogue<'a, T>,
}

/// Where a product goes: element `(i, j)` at `i · row + j · column`.
pub(crate) struct Out<'a, T> {
    start: *mut T,
    len: usize,
    row: usize,
    column: usize,
    values: PhantomData<&'a mut [T]>,
}

// SAFETY: stands for a `&mut [T]`; threads write distinct elements of it.
unsafe impl<T: Send> Send for Out<'_, T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for Out<'_, T> {}

impl<'a, T> Out<'a, T> {
    /// A row-major matrix whose rows begin `length` elements apart.
    pub(crate) fn rows(values: &'a mut [T], length: usize) -> Self {
        Self::strided(values, length, 1)
    }

    /// A matrix with these distances between neighbouring rows and neighbouring columns.
    pub(crate) fn strided(values: &'a mut [T], row: usize, column: usize) -> Self {
        Self { start: values.as_mut_ptr(), len: values.len(), row, column, values: PhantomData }
    }

    fn transposed(self) -> Self {
        Self { row: self.column, column: self.row, ..self }
    }

    /// The same place, for another thread's elements.
    fn again(&self) -> Self {
        Self { ..*self }
    }

    fn at(&self, row: usize, column: usize) -> *mut T {
        self.start.wrapping_add(row * self.row + column * self.column)
    }

    /// # Panics
    /// When the matrix does not fit, or two of its elements are one.
    #[track_caller]
    fn check(&self, m: usize, n: usize) {
        let last = (m - 1) * self.row + (n - 1) * self.column;
        assert!(last < self.len, "a product {m}×{n} does not fit its output of {} elements", self.len);
        let by_rows = n == 1 || (self.column > 0 && (m == 1 || self.row > (n - 1) * self.column));
        let by_columns = m == 1 || (self.row > 0 && (n == 1 || self.column > (m - 1) * self.row));
        assert!(by_rows || by_columns, "elements of the output of a product overlap");
    }
}

/// A product as the loops see it: oriented so that a row of the output is contiguous if anything is.
struct Task<'a, T> {
    left: &'a dyn Panel<T>,
    right: &'a dyn Panel<T>,
    depth: Range<usize>,
    scale: T,
    accumulate: bool,
    epilogue: Epilogue<'a, T>,
    tile: Extent,
}

impl<'a, T: Real> Gemm<'a, T> {
    /// `out = left · right` of the sizes `[m, k, n]`.
    pub(crate) fn new(sizes: [usize; 3]) -> Self {
        Self { sizes, scale: T::ONE, accumulate: false, epilogue: Epilogue::NONE }
    }

    /// Adds to what the output holds instead of writing over it.
    pub(crate) fn accumulate(self) -> Self {
        Self { accumulate: true, ..self }
    }

    /// Adds `bias[i]` to row `i`.
    pub(crate) fn row_bias(mut self, bias: Option<&'a [T]>) -> Self {
        self.epilogue.row_bias = bias;
        self
    }

    /// Adds `bias[j]` to column `j`.
    pub(crate) fn column_bias(mut self, bias: Option<&'a [T]>) -> Self {
        self.epilogue.column_bias = bias;
        self
    }

    /// Applies a function to each element at the end.
    pub(crate) fn activation(mut self, activation: Activation) -> Self {
        self.epilogue.activation = activation;
        self
    }

    /// Makes the product.
    ///
    /// # Panics
    /// When the output or a bias is too short, or elements of the output overlap.
    #[track_caller]
    pub(crate) fn run(&self, left: &dyn Panel<T>, right: &dyn Panel<T>, out: Out<'_, T>, par: Par) {
        let [m, k, n] = self.sizes;
        if m == 0 || n == 0 {
            return;
        }
        out.check(m, n);
        let check = |factor: &dyn Panel<T>, lines: usize| match factor.strided() {
            Some(f) if k > 0 => {
                assert!((lines - 1) * f.line + (k - 1) * f.depth < f.values.len(), "a factor is too short")
            }
            _ => {}
        };
        check(left, m);
        check(right, n);
        let Self { scale, accumulate, epilogue, .. } = *self;
        let biases = [(epilogue.row_bias, m), (epilogue.column_bias, n)];
        assert!(biases.iter().all(|(bias, len)| bias.is_none_or(|bias| bias.len() >= *len)), "a bias is too short");
        // SAFETY: the best path is available.
        let tile = unsafe { T::dispatch(Path::best(), Measure) };
        let task = |left, right, epilogue| Task { left, right, depth: 0..k, scale, accumulate, epilogue, tile };
        // rows of the product are vectors: those that fill them better, and lie together if both do alike; lines that each lie
        // together would have to be transposed to become vectors, which costs more than it saves
        let filled = |lines: usize| lines as f64 / lines.next_multiple_of(tile.vector) as f64;
        let apart =
            |factor: &dyn Panel<T>| factor.strided().is_some_and(|factor| factor.line != 1 && factor.depth == 1);
        let turn = match (filled(m) / filled(n), k) {
            (ratio, 8..) if ratio > TURN && !apart(left) => true,
            (ratio, 8..) if ratio < 1.0 / TURN && !apart(right) => false,
            _ => out.column != 1 && out.row == 1,
        };
        if turn {
            task(right, left, epilogue.transposed()).run([n, m], out.transposed(), par);
        } else {
            task(left, right, epilogue).run([m, n], out, par);
        }
    }
}

impl<T: Real> Task<'_, T> {
    fn run(&self, [m, n]: [usize; 2], out: Out<'_, T>, par: Par) {
        let k = self.depth.len();
        if let Some(chunks) = split::chunks(m, k, n) {
            return split::run(self, [m, n], chunks, out, par);
        }
        let threads = if par == Par::Sequential || m * n * k < SMALL { 1 } else { rayon::current_num_threads() };
        let [rows, columns] = self.grid(m, n, k, threads);
        let parts = [m.div_ceil(rows), n.div_ceil(columns)];
        let part = |i: usize| {
            let (row, column) = (i / parts[1] * rows, i % parts[1] * columns);
            block::run(self, row..m.min(row + rows), column..n.min(column + columns), out.again());
        };
        match parts[0] * parts[1] {
            1 => part(0),
            count => (0..count).into_par_iter().with_max_len(1).for_each(part),
        }
    }

    /// Rows and columns of the parts that the threads take, whole tiles, as square as the product allows.
    fn grid(&self, m: usize, n: usize, k: usize, threads: usize) -> [usize; 2] {
        let Extent { rows: tile_rows, columns: tile_columns, .. } = self.tile;
        let mut part = [m, n];
        if threads == 1 {
            return part;
        }
        // two parts for each thread, where they are large, so that none waits long for the other; each packs its own factors
        let wanted = threads * (m * n * k / (threads << 25)).clamp(1, 2);
        let mut count = 1;
        while count < wanted {
            let axis = if part[0] >= part[1] { 0 } else { 1 };
            let tile = [tile_rows, tile_columns][axis];
            let half = part[axis].div_ceil(2).next_multiple_of(tile);
            if half < 2 * tile || half >= part[axis] {
                break;
            }
            part[axis] = half;
            count = m.div_ceil(part[0]) * n.div_ceil(part[1]);
        }
        part
    }
}
