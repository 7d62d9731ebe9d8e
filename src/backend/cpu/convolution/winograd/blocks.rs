//! Factors that lie in memory by blocks of lines, so that packing them reads memory in order.

use std::ops::Range;

use super::transform::BLOCK;
use crate::backend::cpu::gemm::Panel;
use crate::backend::cpu::vectorised;
use crate::scalar::{Job, Lane, Real};

/// A factor of some parts below each other, each `[blocks, depth, 16]` with `lines` lines: value `(l, d)` of a part is at
/// `(l / 16 · depth + d) · 16 + l % 16`.
pub(super) struct Blocks<'a, T> {
    pub(super) parts: &'a [&'a [T]],
    pub(super) lines: usize,
    pub(super) depth: usize,
}

/// Most runs of lines, within one block and part, that a strip consists of: one for each of its lines.
const RUNS: usize = 64;

impl<T: Real> Panel<T> for Blocks<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        let mut runs: [(&[T], usize); RUNS] = [(&[], 0); RUNS];
        let (mut at, mut count) = (lines.start, 0);
        while at < lines.end {
            let (part, line) = (self.parts[at / self.lines], at % self.lines);
            let len = (BLOCK - line % BLOCK).min(self.lines - line).min(lines.end - at);
            runs[count] = (&part[(line / BLOCK * self.depth + depth.start) * BLOCK + line % BLOCK..], len);
            (at, count) = (at + len, count + 1);
        }
        // SAFETY: the job checks its slices.
        unsafe { vectorised(Copy { runs: &runs[..count], rows: depth.len(), width, into }) };
    }
}

/// Copies rows of a few runs by whole vectors. What a vector writes beyond its run is written over by the next one, in this
/// row or in the row that follows.
struct Copy<'a, 'b, T> {
    runs: &'a [(&'a [T], usize)],
    rows: usize,
    width: usize,
    into: &'b mut [T],
}

impl<T: Real> Job<T> for Copy<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { runs, rows, width, into } = self;
        for row in 0..rows {
            let (at, mut to) = (row * BLOCK, row * width);
            for run in 0..runs.len() {
                let (from, len) = runs[run];
                let whole = len.next_multiple_of(V::WIDTH);
                if at + whole <= from.len() && to + whole <= into.len() {
                    for i in (0..whole).step_by(V::WIDTH) {
                        // SAFETY: both ends were checked on the line above.
                        unsafe { V::load(from.as_ptr().add(at + i)).store(into.as_mut_ptr().add(to + i)) };
                    }
                } else {
                    into[to..to + len].copy_from_slice(&from[at..at + len]);
                }
                to += len;
            }
        }
    }
}
