//! Convolutions of few channels, row by row: a group is not worth a product of matrices, least of all a depth-wise one.

use rayon::prelude::*;

use super::walk::Walk;
use crate::backend::cpu::{buffer, vectorised};
use crate::ops::Geometry;
use crate::scalar::{Job, Lane, Real};

/// Vectors of a row that are kept in registers while all taps are added up.
const VECTORS: usize = 4;

/// Writes `start + Σ weight · source[offset + i]`, over all terms, to `out[i · every]`.
struct Row<'a, T> {
    out: &'a mut [T],
    every: usize,
    source: &'a [T],
    start: T,
    terms: &'a [(T, usize)],
}

impl<T: Real> Job<T> for Row<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { out, every, source, start, terms } = self;
        let count = out.len().div_ceil(every);
        let mut i = 0;
        if every == 1 {
            while i + VECTORS * V::WIDTH <= count {
                // SAFETY: the instruction set is enabled, and the slices hold the vectors.
                unsafe {
                    let mut sums = [V::splat(start); VECTORS];
                    for term in 0..terms.len() {
                        let (weight, offset) = terms[term];
                        let (weight, part) = (V::splat(weight), &source[offset + i..][..VECTORS * V::WIDTH]);
                        for v in 0..VECTORS {
                            sums[v] = weight.mul_add(V::load(part.as_ptr().add(v * V::WIDTH)), sums[v]);
                        }
                    }
                    let to = &mut out[i..][..VECTORS * V::WIDTH];
                    for v in 0..VECTORS {
                        sums[v].store(to.as_mut_ptr().add(v * V::WIDTH));
                    }
                }
                i += VECTORS * V::WIDTH;
            }
            while i + V::WIDTH <= count {
                // SAFETY: as above.
                unsafe {
                    let mut sum = V::splat(start);
                    for term in 0..terms.len() {
                        let (weight, offset) = terms[term];
                        let part = &source[offset + i..][..V::WIDTH];
                        sum = V::splat(weight).mul_add(V::load(part.as_ptr()), sum);
                    }
                    sum.store(out[i..][..V::WIDTH].as_mut_ptr());
                }
                i += V::WIDTH;
            }
        }
        while i < count {
            let mut sum = start;
            for term in 0..terms.len() {
                let (weight, offset) = terms[term];
                sum += weight * source[offset + i];
            }
            out[i * every] = sum;
            i += 1;
        }
    }
}

/// `Σ a[i] · b[i]` over rows of `len` that begin at the given places of `a` and `b`.
struct RowProducts<'a, T> {
    a: &'a [T],
    b: &'a [T],
    len: usize,
    rows: &'a [(usize, usize)],
}

impl<T: Real> Job<T> for RowProducts<'_, T> {
    type Output = T;

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) -> T {
        let Self { a, b, len, rows } = self;
        let mut total = T::ZERO;
        // SAFETY: the instruction set is enabled, and the slices hold the vectors; no vector is wider than 16.
        unsafe {
            let mut sums = [V::splat(T::ZERO); 2];
            for row in 0..rows.len() {
                let (a, b) = (&a[rows[row].0..][..len], &b[rows[row].1..][..len]);
                let mut i = 0;
                while i + V::WIDTH <= len {
                    let sum = &mut sums[i / V::WIDTH % 2];
                    *sum = V::load(a.as_ptr().add(i)).mul_add(V::load(b.as_ptr().add(i)), *sum);
                    i += V::WIDTH;
                }
                while i < len {
                    total += a[i] * b[i];
                    i += 1;
                }
            }
            let mut parts = [T::ZERO; 16];
            sums[0].add(sums[1]).store(parts.as_mut_ptr());
            for i in 0..V::WIDTH {
                total += parts[i];
            }
        }
        total
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

/// Walks over all planes of `out`. `from` are the channels of one group of the padded source, and `weight(plane, channel, tap)`
/// gives the weight of a plane (of all groups).
fn walk_planes<T: Real>(
    g: &Geometry,
    walk: &Walk,
    out: &mut [T],
    bias: Option<&[T]>,
    (source, from): (&[T], usize),
    weight: impl Fn(usize, usize, usize) -> T + Sync,
) {
    let (plane, taps, rows) = (walk.plane().0, walk.taps(g.kernel), rows(walk));
    let size: usize = walk.result.iter().product();
    let planes = out.len() / size / g.batch.max(1);
    out.par_chunks_mut(size).enumerate().for_each(|(number, out)| {
        let (image, channel) = (number / planes, number % planes);
        let group = channel / (planes / g.groups);
        let mut terms = Vec::with_capacity(from * taps.len());
        for c in 0..from {
            terms.extend(taps.iter().map(|tap| (weight(channel, c, tap.number), c * plane + tap.offset)));
        }
        let source = &source[(image * g.groups + group) * from * plane..][..from * plane];
        let start = bias.map_or(T::ZERO, |bias| bias[channel]);
        let [.., width] = &walk.axes;
        for (at, to) in &rows {
            let (out, source) = (&mut out[to.clone()], &source[*at..]);
            // SAFETY: the job checks its slices.
            unsafe { vectorised(Row { out, every: width.every, source, start, terms: &terms }) };
        }
    });
}

/// The result of image, weight and bias.
pub(super) fn forward<T: Real>(g: &Geometry, walk: &Walk, image: &[T], weight: &[T], bias: Option<&[T]>) -> Vec<T> {
    let [_, places, volume] = g.volumes();
    let mut result = buffer(g.batch * g.groups * g.outputs * places);
    let at = |output: usize, input: usize, tap: usize| weight[(output * g.inputs + input) * volume + tap];
    walk_planes(g, walk, &mut result, bias, (&walk.pad(image), g.inputs), at);
    result
}

/// The image of result, weight and bias.
pub(super) fn transposed<T: Real>(
    g: &Geometry,
    walks: &[Walk],
    result: &[T],
    weight: &[T],
    bias: Option<&[T]>,
) -> Vec<T> {
    let [pixels, _, volume] = g.volumes();
    let mut image = buffer(g.batch * g.groups * g.inputs * pixels);
    let at = |channel: usize, output: usize, tap: usize| {
        let (group, input) = (channel / g.inputs, channel % g.inputs);
        weight[((group * g.outputs + output) * g.inputs + input) * volume + tap]
    };
    for walk in walks {
        walk_planes(g, walk, &mut image, bias, (&walk.pad(result), g.outputs), at);
    }
    image
}

/// The weight of padded image and result.
pub(super) fn weights<T: Real>(g: &Geometry, walk: &Walk, image: &[T], result: &[T]) -> Vec<T> {
    let (plane, taps) = (walk.plane().0, walk.taps(g.kernel));
    let [_, places, volume] = g.volumes();
    let rows: Vec<_> = rows(walk).into_iter().map(|(from, to)| (to.start, from)).collect();
    let mut weight = buffer(g.groups * g.outputs * g.inputs * volume);
    weight.par_chunks_mut(volume).enumerate().for_each(|(number, weight)| {
        let (channel, input) = (number / g.inputs, number % g.inputs);
        let group = channel / g.outputs;
        weight.fill(T::ZERO);
        for n in 0..g.batch {
            let a = &result[(n * g.groups * g.outputs + channel) * places..][..places];
            let x = &image[((n * g.groups + group) * g.inputs + input) * plane..][..plane];
            for (tap, weight) in taps.iter().zip(weight.iter_mut()) {
                let [.., width] = &walk.axes;
                // SAFETY: the job checks its slices.
                *weight += unsafe { vectorised(RowProducts { a, b: &x[tap.offset..], len: width.count, rows: &rows }) };
            }
        }
    });
    weight
}
