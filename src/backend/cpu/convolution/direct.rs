//! Convolutions of few channels, row by row: a group is not worth a product of matrices, least of all a depth-wise one.

use rayon::prelude::*;

use super::walk::Walk;
use crate::backend::cpu::widest::{fused, widest};
use crate::ops::Geometry;
use crate::scalar::Real;

/// Places of a row that are kept in registers while all taps are added up.
const BLOCK: usize = 32;

widest! {
    /// Adds `Σ weight · source[offset + i · step]` to `out[i · every]`, for all terms.
    fn add_row(out: &mut [T], every: usize, source: &[T], step: usize, terms: &[(T, usize)]) = add_row_with
}

#[inline(always)]
fn add_row_with<T: Real, const FUSED: bool>(
    out: &mut [T],
    every: usize,
    source: &[T],
    step: usize,
    terms: &[(T, usize)],
) {
    let count = out.len().div_ceil(every);
    let mut start = 0;
    while start < count {
        let len = BLOCK.min(count - start);
        let mut sums = [T::ZERO; BLOCK];
        if len == BLOCK && step == 1 {
            for &(weight, offset) in terms {
                let part = &source[offset + start..][..BLOCK];
                for i in 0..BLOCK {
                    sums[i] = fused::<T, FUSED>(weight, part[i], sums[i]);
                }
            }
        } else {
            for &(weight, offset) in terms {
                let part = &source[offset + start * step..];
                for i in 0..len {
                    sums[i] = fused::<T, FUSED>(weight, part[i * step], sums[i]);
                }
            }
        }
        for i in 0..len {
            out[(start + i) * every] += sums[i];
        }
        start += len;
    }
}

/// The rows of one plane of the result: for each the row in a padded plane and the range of the result.
fn rows(walk: &Walk) -> Vec<(usize, std::ops::Range<usize>)> {
    let [depth, height, width] = &walk.axes;
    let reach = (width.count - 1) * width.every + 1;
    let each = |d: usize| {
        (0..height.count).map(move |h| {
            let (from, to) = walk.row(d, h);
            (from, to..to + reach)
        })
    };
    (0..depth.count).flat_map(each).collect()
}

/// Walks over all planes of the result, whose values it adds to. `from` are the channels of one group of the source, and
/// `weight(plane, channel, tap)` gives the number of the weight of a plane (of all groups).
pub(super) fn add<T: Real>(
    g: &Geometry,
    walk: &Walk,
    out: &mut [T],
    planes: usize,
    source: (&[T], usize),
    weight: impl Fn(usize, usize, usize) -> T + Sync,
) {
    let (source, from) = source;
    let (plane, taps, rows) = (walk.plane().0, walk.taps(g.kernel), rows(walk));
    let size: usize = walk.result.iter().product();
    out.par_chunks_mut(size).enumerate().for_each(|(number, out)| {
        let (image, channel) = (number / planes, number % planes);
        let group = channel / (planes / g.groups);
        let mut terms = Vec::with_capacity(from * taps.len());
        for c in 0..from {
            terms.extend(taps.iter().map(|tap| (weight(channel, c, tap.number), c * plane + tap.offset)));
        }
        let source = &source[(image * g.groups + group) * from * plane..][..from * plane];
        for (at, to) in &rows {
            add_row(&mut out[to.clone()], walk.axes[2].every, &source[*at..], walk.axes[2].step, &terms);
        }
    });
}

widest! {
    /// `Σ a[i] · b[i · step]` over rows of `len` that begin at the given places of `a` and `b`.
    fn row_products(a: &[T], b: &[T], len: usize, step: usize, rows: &[(usize, usize)]) -> T = row_products_with
}

#[inline(always)]
fn row_products_with<T: Real, const FUSED: bool>(
    a: &[T],
    b: &[T],
    len: usize,
    step: usize,
    rows: &[(usize, usize)],
) -> T {
    let (mut sums, mut rest) = ([T::ZERO; BLOCK], T::ZERO);
    for &(at_a, at_b) in rows {
        let (a, b) = (&a[at_a..at_a + len], &b[at_b..]);
        let mut i = 0;
        if step == 1 {
            while i + BLOCK <= len {
                let (left, right) = (&a[i..][..BLOCK], &b[i..][..BLOCK]);
                for j in 0..BLOCK {
                    sums[j] = fused::<T, FUSED>(left[j], right[j], sums[j]);
                }
                i += BLOCK;
            }
        }
        while i < len {
            rest = fused::<T, FUSED>(a[i], b[i * step], rest);
            i += 1;
        }
    }
    let mut total = rest;
    for sum in sums {
        total += sum;
    }
    total
}

/// The weight of padded image and result.
pub(super) fn weights<T: Real>(g: &Geometry, walk: &Walk, image: &[T], result: &[T]) -> Vec<T> {
    let (plane, taps) = (walk.plane().0, walk.taps(g.kernel));
    let [_, places, volume] = g.volumes();
    let rows: Vec<_> = rows(walk).into_iter().map(|(from, to)| (to.start, from)).collect();
    let mut weight = crate::backend::cpu::buffer(g.groups * g.outputs * g.inputs * volume);
    weight.par_chunks_mut(volume).enumerate().for_each(|(number, weight)| {
        let (channel, input) = (number / g.inputs, number % g.inputs);
        let group = channel / g.outputs;
        weight.fill(T::ZERO);
        for n in 0..g.batch {
            let y = &result[(n * g.groups * g.outputs + channel) * places..][..places];
            let x = &image[((n * g.groups + group) * g.inputs + input) * plane..][..plane];
            for (tap, weight) in taps.iter().zip(weight.iter_mut()) {
                *weight += row_products(y, &x[tap.offset..], walk.axes[2].count, walk.axes[2].step, &rows);
            }
        }
    });
    weight
}
