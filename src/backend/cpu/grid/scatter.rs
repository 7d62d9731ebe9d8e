//! What points spread to the nodes around them.

use rayon::prelude::*;

use super::{Cells, by_blocks};
use crate::backend::cpu::{Bins, Work, buffer, partition, widest};
use crate::ops::grid::Extent;
use crate::scalar::Real;

/// Work items that the grid is cut into at least, where it has as many planes.
const SLABS: usize = 32;

/// The sums at all nodes, `[batch, nodes, channels]`, of weighted samples `[batch, count, channels]`.
///
/// Points are sorted by the lower of the two planes between which they lie; a work item has some neighbouring planes of the
/// grid and visits the points that reach them. Every node adds up its points in the order of planes and then of the list,
/// so the sums depend neither on the number of threads nor on how planes are shared out.
pub(super) fn run<T: Real, const D: usize, const K: usize>(
    cells: &Cells<T, D, K>,
    extent: Extent,
    samples: &[T],
    points: &[T],
) -> Vec<T> {
    let Extent { batch, channels, nodes, count } = extent;
    let mut sums: Vec<T> = buffer(batch * nodes * channels);
    if sums.is_empty() {
        return sums;
    }
    let (planes, plane) = (cells.planes(), cells.plane() * channels);
    let keys = planes + 1;
    let far = batch * keys;
    let mut bins = vec![0u32; batch * count];
    bins.par_chunks_mut(4096).enumerate().for_each(|(i, part)| {
        for (p, bin) in (i * 4096..).zip(part) {
            *bin = cells.key(&points[p * D..][..D]).map_or(far, |key| p / count * keys + key) as u32;
        }
    });
    let bins = partition(&bins, far + 1);
    let mut slabs = Vec::new();
    let mut rest = &mut sums[..];
    for b in 0..batch {
        let mut first = 0;
        for end in shares(&bins, b * keys, planes, (batch * count).div_ceil(SLABS)) {
            let (slab, others) = rest.split_at_mut((end - first) * plane);
            slabs.push((b, first, end, slab));
            (first, rest) = (end, others);
        }
    }
    slabs.into_par_iter().for_each(|(b, first, end, sums)| {
        widest(Scatter { cells, bins: &bins, keys: b * keys, samples, points, channels, first, end, sums });
    });
    sums
}

/// Where to cut planes so that about `share` points reach each part.
fn shares(bins: &Bins, keys: usize, planes: usize, share: usize) -> Vec<usize> {
    let (mut ends, mut first) = (Vec::new(), 0);
    for end in 1..=planes {
        let reached = bins.positions(keys + first, keys + end + 1).len();
        if end == planes || reached >= share.max(1) {
            ends.push(end);
            first = end;
        }
    }
    ends
}

struct Scatter<'a, T, const D: usize, const K: usize> {
    cells: &'a Cells<T, D, K>,
    bins: &'a Bins,
    /// Number of the batch entry's first bin.
    keys: usize,
    samples: &'a [T],
    points: &'a [T],
    channels: usize,
    /// The planes from here …
    first: usize,
    /// … to before here.
    end: usize,
    sums: &'a mut [T],
}

impl<T: Real, const D: usize, const K: usize> Work for Scatter<'_, T, D, K> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { cells, bins, keys, samples, points, channels, first, end, sums } = self;
        sums.fill(T::ZERO);
        let start = first * cells.plane();
        // key k: the lower plane is k − 1 and the upper one k
        for key in first..=end {
            let mut corners = [true; K];
            for corner in 0..K {
                let upper = corner >= K.div_ceil(2);
                corners[corner] = if upper { key < end } else { key > first };
            }
            for &p in bins.positions(keys + key, keys + key + 1) {
                let p = p as usize;
                let Some((offsets, weights)) = cells.weights(&points[p * D..][..D]) else { continue };
                let sample = samples[p * channels..][..channels].as_ptr();
                for corner in 0..K {
                    // a node outside has weight 0, and 0 times infinity must not become NaN in its neighbour
                    if !corners[corner] || weights[corner] == T::ZERO {
                        continue;
                    }
                    let node = &mut sums[(offsets[corner] - start) * channels..][..channels];
                    let node = node.as_mut_ptr();
                    // SAFETY: `channels` numbers can be read from the sample and written to the node.
                    unsafe { by_blocks!(channels, i => block(node.add(i), sample.add(i), weights[corner])) }
                }
            }
        }
    }
}

/// Adds a weight times `W` channels of a sample to a node.
///
/// # Safety
/// `W` numbers must be readable at `sample` and writable at `node`.
#[inline(always)]
unsafe fn block<T: Real, const W: usize, const K: usize>(node: *mut T, sample: *const T, weight: T) {
    // SAFETY: the caller's promise.
    let mut sum = unsafe { node.cast::<[T; W]>().read_unaligned() };
    // SAFETY: as above.
    let sample = unsafe { sample.cast::<[T; W]>().read_unaligned() };
    for i in 0..W {
        sum[i] += weight * sample[i];
    }
    // SAFETY: as above.
    unsafe { node.cast::<[T; W]>().write_unaligned(sum) };
}
