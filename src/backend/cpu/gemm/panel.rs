//! Where the factors of a product come from.

use std::ops::Range;

use crate::scalar::{Job, Lane, Path, Real};

/// One factor of a product, read as lines along the depth: a left factor's lines are its rows, a right factor's are its
/// columns, and both are summed over the depth.
///
/// The product asks for strips of a few lines, so that a factor need not exist as a matrix: a convolution packs its
/// patches straight from the image.
pub(crate) trait Panel<T>: Sync {
    /// Copies some lines over a range of the depth, so that the lines lie side by side:
    /// `into[(d − depth.start) · width + (l − lines.start)] = value(l, d)`.
    ///
    /// `into` holds `depth.len() · width` values and `lines.len() ≤ width`; what it puts at the places between
    /// `lines.len()` and `width` has no effect.
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]);

    /// The factor itself where it lies in memory at fixed distances, which may save packing it.
    fn strided(&self) -> Option<Strided<'_, T>> {
        None
    }
}

/// A matrix in memory: element `(l, d)` is `values[l · line + d · depth]`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Strided<'a, T> {
    /// The numbers, from element `(0, 0)` on.
    pub(crate) values: &'a [T],
    /// The distance between lines.
    pub(crate) line: usize,
    /// The distance between neighbours along the depth.
    pub(crate) depth: usize,
}

impl<'a, T: Real> Strided<'a, T> {
    /// A factor whose lines each lie together, `length` values apart: the left factor `[m, k]` with `length = k`, or a
    /// right factor that is kept transposed, `[n, k]`.
    pub(crate) fn lines(values: &'a [T], length: usize) -> Self {
        Self { values, line: length, depth: 1 }
    }

    /// A factor whose neighbouring lines lie side by side, `count` of them: the right factor `[k, n]` with `count = n`,
    /// or a left factor that is kept transposed, `[k, m]`.
    pub(crate) fn side_by_side(values: &'a [T], count: usize) -> Self {
        Self { values, line: 1, depth: count }
    }
}

impl<T: Real> Panel<T> for Strided<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        if self.line == 1 {
            // SAFETY: the best path is available, and the job checks its bounds.
            unsafe { T::dispatch(Path::best(), CopyRows { from: *self, lines, depth, width, into }) }
        } else {
            for (row, d) in into.chunks_exact_mut(width).zip(depth) {
                let from = &self.values[d * self.depth + lines.start * self.line..];
                for (to, value) in row[..lines.len()].iter_mut().zip(from.iter().step_by(self.line)) {
                    *to = *value;
                }
            }
        }
    }

    fn strided(&self) -> Option<Strided<'_, T>> {
        Some(*self)
    }
}

/// Packs lines that lie side by side: one short copy for each place along the depth, by whole vectors. A vector may
/// reach beyond its row, where the next row is written afterwards.
struct CopyRows<'a, 'b, T> {
    from: Strided<'a, T>,
    lines: Range<usize>,
    depth: Range<usize>,
    width: usize,
    into: &'b mut [T],
}

impl<T: Real> Job<T> for CopyRows<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { from, lines, depth, width, into } = self;
        let reach = lines.len().next_multiple_of(V::WIDTH);
        for (row, d) in depth.enumerate() {
            let (at, to) = (d * from.depth + lines.start, row * width);
            if at + reach <= from.values.len() && to + reach <= into.len() {
                for i in (0..reach).step_by(V::WIDTH) {
                    // SAFETY: both ends were checked on the line above.
                    unsafe { V::load(from.values.as_ptr().add(at + i)).store(into.as_mut_ptr().add(to + i)) };
                }
            } else {
                for i in 0..lines.len() {
                    into[to + i] = from.values[at + i];
                }
            }
        }
    }
}
