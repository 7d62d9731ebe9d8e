//! A right factor that meets many left ones: packed once.

use std::ops::Range;

use super::block::{COLUMNS, depth_block};
use super::panel::Panel;
use super::tile::{Extent, Measure};
use crate::backend::cpu::{Temporary, vectorised};
use crate::scalar::Real;

/// All strips of a factor `lines × depth`, side by side.
pub(crate) struct Packed<T: Real> {
    strips: Temporary<T>,
    lines: usize,
    depth: usize,
    /// Lines of a strip.
    width: usize,
}

impl<T: Real> Packed<T> {
    /// Packs a factor, if it is one block whose lines fill their vectors: others would be packed again anyway.
    pub(crate) fn new(factor: &dyn Panel<T>, lines: usize, depth: usize) -> Option<Self> {
        let Extent { columns: width, vector, .. } = vectorised::<T, _>(Measure);
        if lines == 0 || depth == 0 || lines > COLUMNS || depth > depth_block::<T>() || !lines.is_multiple_of(vector) {
            return None;
        }
        let mut strips = Temporary::new(lines * depth);
        factor.pack_strips(0..lines, 0..depth, [width, vector], &mut strips);
        Some(Self { strips, lines, depth, width })
    }
}

impl<T: Real> Panel<T> for Packed<T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        for (i, line) in lines.enumerate() {
            let first = line / self.width * self.width;
            let (strip, reach) = (&self.strips[first * self.depth..], self.width.min(self.lines - first));
            for (row, d) in into.chunks_exact_mut(width).zip(depth.clone()) {
                row[i] = strip[d * reach + line - first];
            }
        }
    }

    fn packed(&self, lines: &Range<usize>, depth: &Range<usize>) -> Option<&[T]> {
        (*lines == (0..self.lines) && *depth == (0..self.depth)).then_some(&self.strips)
    }
}
