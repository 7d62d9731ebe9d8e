//! A right factor that meets many left ones: packed once.

use std::ops::Range;

use super::block::{COLUMNS, depth_block};
use super::panel::{Panel, Strided};
use super::tile::{Extent, Measure};
use crate::backend::cpu::{Temporary, vectorised};
use crate::scalar::Real;

/// A factor `lines × depth`, and all its strips side by side, where they were packed before.
pub(crate) struct Packed<'a, T: Real> {
    factor: Strided<'a, T>,
    lines: usize,
    depth: usize,
    strips: Option<Temporary<T>>,
}

impl<'a, T: Real> Packed<'a, T> {
    /// A factor that is packed when it is asked for.
    pub(crate) fn later(factor: Strided<'a, T>, [lines, depth]: [usize; 2]) -> Self {
        Self { factor, lines, depth, strips: None }
    }

    /// Packs a factor now, if it is one block whose lines fill their vectors: others would be packed again anyway.
    pub(crate) fn now(factor: Strided<'a, T>, [lines, depth]: [usize; 2]) -> Self {
        // SAFETY: measuring asks for nothing.
        let Extent { columns: width, vector, .. } = unsafe { vectorised::<T, _>(Measure) };
        let one_block = (1..=COLUMNS).contains(&lines) && (1..=depth_block::<T>()).contains(&depth);
        let strips = (one_block && lines.is_multiple_of(vector)).then(|| {
            let mut strips = Temporary::new(lines * depth);
            factor.pack_strips(0..lines, 0..depth, [width, vector], &mut strips);
            strips
        });
        Self { strips, ..Self::later(factor, [lines, depth]) }
    }
}

impl<T: Real> Panel<T> for Packed<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        self.factor.pack(lines, depth, width, into);
    }

    fn pack_strips(&self, lines: Range<usize>, depth: Range<usize>, size: [usize; 2], into: &mut [T]) {
        self.factor.pack_strips(lines, depth, size, into);
    }

    fn packed(&self, lines: &Range<usize>, depth: &Range<usize>) -> Option<&[T]> {
        self.strips.as_deref().filter(|_| *lines == (0..self.lines) && *depth == (0..self.depth))
    }

    fn strided(&self) -> Option<Strided<'_, T>> {
        self.factor.strided()
    }
}
