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

impl<T: Real> Panel<T> for Blocks<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        let mut at = lines.start;
        while at < lines.end {
            let (part, line) = (self.parts[at / self.lines], at % self.lines);
            let len = (BLOCK - line % BLOCK).min(self.lines - line).min(lines.end - at);
            let from = &part[(line / BLOCK * self.depth + depth.start) * BLOCK + line % BLOCK..];
            vectorised(Copy { from, rows: depth.len(), len, width, into: &mut into[at - lines.start..] });
            at += len;
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
                into[to..to + len].copy_from_slice(&from[at..at + len]);
            }
        }
    }
}
