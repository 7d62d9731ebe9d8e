//! Products with few elements and long sums, such as the gradient of a weight: the depth is cut into pieces that are
//! multiplied apart and added in their order. The cuts depend on the shape alone, so the result does as well.

use rayon::prelude::*;

use super::block::{self, depth_block};
use super::epilogue::{Epilogue, Finish};
use super::{Out, Par, Task};
use crate::backend::cpu::buffer;
use crate::scalar::{Job, Lane, Path, Real};

/// Elements of a product up to which its depth is cut.
const ELEMENTS: usize = 1 << 16;
/// The shortest piece, and the most pieces.
const SHORTEST: usize = 2048;
const MOST: usize = 16;
/// Rows that are summed at a time.
const ROWS: usize = 16;

/// How many pieces the depth of such a product is cut into; `None` where it stays whole.
pub(super) fn chunks(m: usize, k: usize, n: usize) -> Option<usize> {
    let count = (k / SHORTEST).min(MOST);
    (m * n <= ELEMENTS && count > 1).then_some(count)
}

/// Makes a product by pieces of its depth.
pub(super) fn run<T: Real>(task: &Task<'_, T>, [m, n]: [usize; 2], count: usize, out: Out<'_, T>, par: Par) {
    let k = task.depth.len();
    let length = k.div_ceil(count).next_multiple_of(depth_block::<T>());
    let count = k.div_ceil(length);
    // rows of the partial products are whole vectors
    let row = n.next_multiple_of(16);
    let mut partial = buffer::<T>(count * m * row);
    let piece = |(i, values): (usize, &mut [T])| {
        let depth = task.depth.start + i * length..task.depth.start + k.min((i + 1) * length);
        let piece = Task { depth, scale: T::ONE, accumulate: false, epilogue: Epilogue::NONE, ..*task };
        block::run(&piece, 0..m, 0..n, Out::rows(values, row));
    };
    match par {
        Par::Sequential => partial.chunks_mut(m * row).enumerate().for_each(piece),
        Par::Threads => partial.par_chunks_mut(m * row).with_max_len(1).enumerate().for_each(piece),
    }
    let bias = task.epilogue.column_bias.map(|bias| {
        let mut padded = bias[..n].to_vec();
        padded.resize(row, T::ZERO);
        padded
    });
    let (sums, rest) = partial.split_at_mut(m * row);
    let (rest, bias) = (&*rest, bias.as_deref());
    let sum = |(i, sums): (usize, &mut [T])| {
        let job = Sum { task, extent: [n, row, m * row], first_row: i * ROWS, sums, rest, bias, out: out.again() };
        // SAFETY: the best path is available.
        unsafe { T::dispatch(Path::best(), job) };
    };
    match par {
        Par::Sequential => sums.chunks_mut(ROWS * row).enumerate().for_each(sum),
        Par::Threads => sums.par_chunks_mut(ROWS * row).enumerate().for_each(sum),
    }
}

/// Adds up some rows of the partial products and finishes them.
struct Sum<'a, 'b, T> {
    task: &'a Task<'a, T>,
    /// Columns, the length of a row (whole vectors), and the length of a piece's product.
    extent: [usize; 3],
    first_row: usize,
    /// Rows of the first piece's product, which are overwritten, and all of the other pieces'.
    sums: &'b mut [T],
    rest: &'a [T],
    /// The column bias, as long as a row.
    bias: Option<&'a [T]>,
    out: Out<'a, T>,
}

impl<T: Real> Job<T> for Sum<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { task, extent: [columns, row, piece], first_row, sums, rest, bias, out } = self;
        for r in 0..sums.len() / row {
            let (values, from) = (&mut sums[r * row..][..row], (first_row + r) * row);
            // SAFETY: rows are whole vectors; the output's size was checked, and its rows are one thread's each.
            unsafe {
                for at in (0..row).step_by(V::WIDTH) {
                    let to = values.as_mut_ptr().add(at);
                    let mut sum = V::load(to);
                    let mut other = from + at;
                    while other < rest.len() {
                        sum = sum.add(V::load(rest.as_ptr().add(other)));
                        other += piece;
                    }
                    V::splat(task.scale).mul(sum).store(to);
                }
                if task.accumulate {
                    for c in 0..columns {
                        values[c] += *out.at(first_row + r, c);
                    }
                }
                let bias = bias.map(<[T]>::as_ptr);
                let tile = values.as_mut_ptr();
                let shape = [1, row / V::WIDTH];
                Finish { epilogue: &task.epilogue, tile, row, first_row: first_row + r, shape, column_bias: bias }
                    .run::<V>();
                for c in 0..columns {
                    *out.at(first_row + r, c) = values[c];
                }
            }
        }
    }
}
