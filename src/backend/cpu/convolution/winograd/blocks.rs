//! Factors that lie in memory by blocks of lines, so that packing them reads memory in order.

use std::ops::Range;

use super::transform::BLOCK;
use crate::backend::cpu::gemm::Panel;
use crate::scalar::{Job, Lane, Path, Real};

/// A factor `[blocks, depth, 16]`: value `(l, d)` is at `(l / 16 · depth + d) · 16 + l % 16`.
pub(super) struct Blocks<'a, T> {
    pub(super) values: &'a [T],
    pub(super) depth: usize,
}

impl<T: Real> Panel<T> for Blocks<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        let mut line = lines.start;
        while line < lines.end {
            let end = lines.end.min((line / BLOCK + 1) * BLOCK);
            let start = (line / BLOCK * self.depth + depth.start) * BLOCK + line % BLOCK;
            let from = &self.values[start..];
            let copy = Copy { from, rows: depth.len(), len: end - line, width, into: &mut into[line - lines.start..] };
            // SAFETY: the best path is available, and the job checks its bounds.
            unsafe { T::dispatch(Path::best(), copy) };
            line = end;
        }
    }
}

/// Copies a few lines of one block. What follows them in their row is written over where the row has room: lines further on
/// are copied later, and places between lines and width have no effect.
struct Copy<'a, 'b, T> {
    from: &'a [T],
    rows: usize,
    len: usize,
    width: usize,
    into: &'b mut [T],
}

impl<T: Real> Job<T> for Copy<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { from, rows, len, width, into } = self;
        let whole = len.next_multiple_of(V::WIDTH);
        for row in 0..rows {
            let (at, to) = (row * BLOCK, row * width);
            if at + whole <= from.len() && to + whole <= into.len() {
                for i in (0..whole).step_by(V::WIDTH) {
                    // SAFETY: both ends were checked on the line above.
                    unsafe { V::load(from.as_ptr().add(at + i)).store(into.as_mut_ptr().add(to + i)) };
                }
            } else {
                for i in 0..len {
                    into[to + i] = from[at + i];
                }
            }
        }
    }
}
