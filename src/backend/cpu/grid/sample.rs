//! Values of a grid at points.

use rayon::prelude::*;

use super::{Cells, TILE, by_blocks};
use crate::backend::cpu::{Places, Work, buffer, prefetch, widest};
use crate::ops::grid::Extent;
use crate::scalar::Real;

/// Points whose nodes are asked for together.
const GROUP: usize = 16;

/// Samples at points `[batch, count, D]` of values `[batch, nodes, channels]`: `[batch, count, channels]`, or `[batch,
/// channels, count]` where `columns` says so.
pub(super) fn run<T: Real, const D: usize, const K: usize>(
    cells: &Cells<T, D, K>,
    extent: Extent,
    values: &[T],
    points: &[T],
    columns: bool,
) -> Vec<T> {
    let Extent { batch, channels, nodes, count } = extent;
    let mut samples = buffer(batch * count * channels);
    if samples.is_empty() {
        return samples;
    }
    let columns = columns && channels > 1;
    let out = Places::of(&mut samples);
    // whole tiles, some 16k numbers
    let part = TILE * (16384 / (TILE * channels)).max(1);
    let parts = count.div_ceil(part);
    let work = |scratch: &mut Vec<T>, item: usize| {
        let (b, first) = (item / parts, item % parts * part);
        let end = count.min(first + part);
        widest(Sample {
            cells,
            values: &values[b * nodes * channels..][..nodes * channels],
            points: &points[(b * count + first) * D..(b * count + end) * D],
            channels,
            out: Target { all: out, start: b * count * channels, first, count, columns },
            scratch,
        });
    };
    let scratch = || vec![T::ZERO; if columns { TILE * channels } else { 0 }];
    if batch * parts == 1 {
        work(&mut scratch(), 0);
    } else {
        (0..batch * parts).into_par_iter().for_each_init(scratch, work);
    }
    samples
}

/// Where the samples of some points go.
struct Target<T> {
    all: Places<T>,
    /// Place of the batch entry.
    start: usize,
    /// Number of the first point.
    first: usize,
    /// Points of the batch entry.
    count: usize,
    columns: bool,
}

struct Sample<'a, T, const D: usize, const K: usize> {
    cells: &'a Cells<T, D, K>,
    values: &'a [T],
    points: &'a [T],
    channels: usize,
    out: Target<T>,
    scratch: &'a mut [T],
}

impl<T: Real, const D: usize, const K: usize> Work for Sample<'_, T, D, K> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { cells, values, points, channels, out, scratch } = self;
        let count = points.len() / D;
        if !out.columns {
            // SAFETY: the rows of these points, which no other work item has.
            let samples = unsafe { out.all.part(out.start + out.first * channels, count * channels) };
            rows(cells, values, points, channels, samples);
            return;
        }
        for tile in 0..count.div_ceil(TILE) {
            let first = tile * TILE;
            let len = if first + TILE < count { TILE } else { count - first };
            rows(cells, values, &points[first * D..(first + len) * D], channels, scratch);
            for c in 0..channels {
                // SAFETY: these columns of the batch entry, which no other work item has.
                let column = unsafe { out.all.part(out.start + c * out.count + out.first + first, len) };
                for p in 0..len {
                    column[p] = scratch[p * channels + c];
                }
            }
        }
    }
}

/// All channels at some points, one after the other.
///
/// Nodes of points anywhere in a large grid are far away in memory: all those of a group are asked for before the first is
/// used.
#[inline(always)]
fn rows<T: Real, const D: usize, const K: usize>(
    cells: &Cells<T, D, K>,
    values: &[T],
    points: &[T],
    channels: usize,
    out: &mut [T],
) {
    let count = points.len() / D;
    let mut first = 0;
    while first < count {
        let len = if first + GROUP < count { GROUP } else { count - first };
        let mut found = [None; GROUP];
        for p in 0..len {
            let Some((mut offsets, weights)) = cells.weights(&points[(first + p) * D..][..D]) else { continue };
            for offset in &mut offsets {
                *offset *= channels;
                assert!(*offset + channels <= values.len(), "the nodes of a cell lie in the grid");
                prefetch::to_read::<true, _>(values.as_ptr().wrapping_add(*offset));
            }
            found[p] = Some((offsets, weights));
        }
        for p in 0..len {
            let out = &mut out[(first + p) * channels..][..channels];
            let Some((offsets, weights)) = found[p] else {
                out.fill(T::ZERO);
                continue;
            };
            let (values, out) = (values.as_ptr(), out.as_mut_ptr());
            // SAFETY: `channels` numbers can be read from each node and written to the row.
            unsafe { by_blocks!(channels, i => block(values.add(i), &offsets, &weights, out.add(i))) }
        }
        first += len;
    }
}

/// `W` channels at one point.
///
/// # Safety
/// `W` numbers must be readable at every offset and writable at `out`.
#[inline(always)]
unsafe fn block<T: Real, const W: usize, const K: usize>(
    values: *const T,
    offsets: &[usize; K],
    weights: &[T; K],
    out: *mut T,
) {
    let mut sum = [T::ZERO; W];
    for corner in 0..K {
        // SAFETY: the caller's promise.
        let node = unsafe { values.add(offsets[corner]).cast::<[T; W]>().read_unaligned() };
        for i in 0..W {
            sum[i] += weights[corner] * node[i];
        }
    }
    // SAFETY: as above.
    unsafe { out.cast::<[T; W]>().write_unaligned(sum) };
}
