//! Attention over the depth samples of each pixel: vectors run along pixels, keys and values stream through once.
//!
//! A work item is a strip of pixels of one head. Its scores, one row for each depth, stay in the cache; they are a
//! fraction `1 / channels` of the keys, and the weights made of them are kept for the backward pass.

// plain loops: iterator adaptors would lose the instruction set
#![allow(clippy::needless_range_loop)]

use rayon::prelude::*;

use super::{Places, buffer, prefetch, vectorised};
use crate::scalar::{Job, Lane, Real};

/// Pixels of a strip at most.
const STRIP: usize = 1024;
/// Pixels of a strip where there are too few heads to keep the threads busy.
const NARROW: usize = 256;
/// Channels, or depths, that one pass over a row of scores takes in.
const GROUP: usize = 4;
/// Values by which volumes are asked for ahead of their use: the processor's own guesses end with a page of 4 KiB.
const READ_AHEAD: usize = 1024;
const WRITTEN_AHEAD: usize = 192;

/// Sizes: queries are `[heads, channels, pixels]`, keys and values `[heads / shared_by, channels, depths, pixels]`, where
/// `heads` counts those of all images.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sizes {
    pub heads: usize,
    /// Heads of queries for each head of keys and values.
    pub shared_by: usize,
    pub channels: usize,
    pub depths: usize,
    pub pixels: usize,
}

/// The result `[heads, channels, pixels]` and the weights `[heads, depths, pixels]`.
///
/// # Panics
/// When an operand is not of these sizes.
pub(crate) fn forward<T: Real>(sizes: Sizes, [q, k, v]: [&[T]; 3], scale: f64) -> (Vec<T>, Vec<T>) {
    sizes.check([q.len()], [k.len(), v.len()]);
    let scale = T::from_f64(scale);
    let mut result = buffer::<T>(sizes.heads * sizes.channels * sizes.pixels);
    let mut weights = buffer::<T>(sizes.heads * sizes.depths * sizes.pixels);
    let to = [Places::of(&mut result), Places::of(&mut weights)];
    strips(sizes, sizes.heads, |strip, scratch| {
        // SAFETY: operands and results are of these sizes; the scratch has a row for each depth; strips do not overlap.
        unsafe { vectorised(Forward { sizes, strip, operands: [q, k, v], scale, to, scratch }) };
    });
    (result, weights)
}

/// Cotangents of queries, keys and values from that of the result, `g`, and the weights of the forward pass.
///
/// # Panics
/// When an operand is not of these sizes.
pub(crate) fn backward<T: Real>(sizes: Sizes, [q, k, v]: [&[T]; 3], weights: &[T], g: &[T], scale: f64) -> [Vec<T>; 3] {
    sizes.check([q.len(), g.len()], [k.len(), v.len()]);
    assert_eq!(weights.len(), sizes.heads * sizes.depths * sizes.pixels, "depth attention: the weights do not fit");
    let scale = T::from_f64(scale);
    let (mut dq, mut dk, mut dv) = (buffer::<T>(q.len()), buffer::<T>(k.len()), buffer::<T>(v.len()));
    let to = [Places::of(&mut dq), Places::of(&mut dk), Places::of(&mut dv)];
    strips(sizes, sizes.heads / sizes.shared_by, |strip, scratch| {
        for head in 0..sizes.shared_by {
            let strip = Strip { head: strip.head * sizes.shared_by + head, ..strip };
            let job = Backward { sizes, strip, first: head == 0, operands: [q, k, v, weights, g], scale, to, scratch };
            // SAFETY: as in `forward`; heads that share keys and values are one thread's.
            unsafe { vectorised(job) };
        }
    });
    [dq, dk, dv]
}

/// Some pixels of a head.
#[derive(Clone, Copy)]
struct Strip {
    head: usize,
    first: usize,
    width: usize,
}

/// Runs all strips of some heads in parallel; each gets rows of scratch, one for each depth.
fn strips<T: Real>(sizes: Sizes, heads: usize, run: impl Fn(Strip, &mut [T]) + Sync) {
    // pixels do not meet, so the width of a strip changes no bit
    let few = heads * sizes.pixels.div_ceil(STRIP) < rayon::current_num_threads();
    let widest = if few { NARROW } else { STRIP };
    let across = sizes.pixels.div_ceil(widest);
    let scratch = || vec![T::ZERO; sizes.depths * STRIP];
    (0..heads * across).into_par_iter().for_each_init(scratch, |scratch, item| {
        let first = item % across * widest;
        run(Strip { head: item / across, first, width: widest.min(sizes.pixels - first) }, scratch);
    });
}

impl Sizes {
    /// # Panics
    /// When the lengths of some maps or volumes are others, or heads are shared unevenly.
    fn check<const N: usize>(self, maps: [usize; N], volumes: [usize; 2]) {
        let Self { heads, shared_by, channels, depths, pixels } = self;
        let fits = shared_by > 0
            && heads.is_multiple_of(shared_by)
            && maps.iter().all(|len| *len == heads * channels * pixels)
            && volumes.iter().all(|len| *len == heads / shared_by * channels * depths * pixels);
        assert!(fits, "depth attention: maps of {maps:?} and volumes of {volumes:?} numbers are not of {self:?}");
    }

    /// Where a strip begins in a map `[heads, channels, pixels]`.
    #[inline(always)]
    fn map(self, strip: Strip, channel: usize) -> usize {
        (strip.head * self.channels + channel) * self.pixels + strip.first
    }

    /// Where it begins in a volume `[heads / shared_by, channels, depths, pixels]`.
    #[inline(always)]
    fn volume(self, strip: Strip, channel: usize, depth: usize) -> usize {
        let head = strip.head / self.shared_by;
        ((head * self.channels + channel) * self.depths + depth) * self.pixels + strip.first
    }

    /// Where it begins in weights `[heads, depths, pixels]`.
    #[inline(always)]
    fn weight(self, strip: Strip, depth: usize) -> usize {
        (strip.head * self.depths + depth) * self.pixels + strip.first
    }
}

struct Forward<'a, T> {
    sizes: Sizes,
    strip: Strip,
    operands: [&'a [T]; 3],
    scale: T,
    to: [Places<T>; 2],
    scratch: &'a mut [T],
}

impl<T: Real> Job<T> for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { sizes, strip, operands: [q, k, v], to: [result, weights], scratch, .. } = self;
        let (width, scores) = (strip.width, scratch.as_mut_ptr());
        // SAFETY: strips lie within the operands, and do not overlap in the results.
        unsafe {
            let mut channel = 0;
            while channel < sizes.channels {
                if sizes.channels - channel >= GROUP {
                    add_products::<V, GROUP>(sizes, strip, channel, q, k, scores);
                    channel += GROUP;
                } else {
                    add_products::<V, 1>(sizes, strip, channel, q, k, scores);
                    channel += 1;
                }
            }
            let scale = V::splat(self.scale);
            let mut x = 0;
            while x < width {
                let mut largest = V::splat(-T::INFINITY);
                for depth in 0..sizes.depths {
                    let score = scores.add(depth * STRIP + x);
                    let scaled = V::load(score).mul(scale);
                    scaled.store(score);
                    largest = scaled.larger(largest);
                }
                let shift = largest.le(V::splat(-T::INFINITY)).choose(V::splat(T::ZERO), largest);
                let mut sum = V::splat(T::ZERO);
                for depth in 0..sizes.depths {
                    let score = scores.add(depth * STRIP + x);
                    let weight = V::load(score).sub(shift).exp_of_negative();
                    weight.store(score);
                    sum = sum.add(weight);
                }
                let empty = sum.le(V::splat(T::ZERO));
                let inverse = empty.choose(V::splat(T::ZERO), V::splat(T::ONE).div(sum));
                for depth in 0..sizes.depths {
                    let score = scores.add(depth * STRIP + x);
                    let weight = V::load(score).mul(inverse);
                    weight.store(score);
                    weight.store_part(weights.at(sizes.weight(strip, depth) + x), width - x);
                }
                x += V::WIDTH;
            }
            for channel in 0..sizes.channels {
                let to = result.at(sizes.map(strip, channel));
                mix::<V>(sizes, strip, channel, v, scores, to);
            }
        }
    }
}

struct Backward<'a, T> {
    sizes: Sizes,
    strip: Strip,
    /// Whether it is the first of the heads that share keys and values; the others add to the gradients of these.
    first: bool,
    operands: [&'a [T]; 5],
    scale: T,
    to: [Places<T>; 3],
    scratch: &'a mut [T],
}

impl<T: Real> Job<T> for Backward<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { sizes, strip, first, operands: [q, k, v, weights, g], to: [dq, dk, dv], scratch, .. } = self;
        let (width, slopes) = (strip.width, scratch.as_mut_ptr());
        // SAFETY: strips lie within the operands, and do not overlap in the results.
        unsafe {
            let mut channel = 0;
            while channel < sizes.channels {
                if sizes.channels - channel >= GROUP {
                    add_products::<V, GROUP>(sizes, strip, channel, g, v, slopes);
                    channel += GROUP;
                } else {
                    add_products::<V, 1>(sizes, strip, channel, g, v, slopes);
                    channel += 1;
                }
            }
            for channel in 0..sizes.channels {
                let g = g.as_ptr().add(sizes.map(strip, channel));
                for depth in 0..sizes.depths {
                    let weight = weights.as_ptr().add(sizes.weight(strip, depth));
                    let to = dv.at(sizes.volume(strip, channel, depth));
                    let mut x = 0;
                    while x < width {
                        let left = width - x;
                        prefetch::to_write(to.wrapping_add(x + WRITTEN_AHEAD));
                        let before = if first { V::splat(T::ZERO) } else { V::load_part(to.add(x), left) };
                        let sum = V::load_part(weight.add(x), left).mul_add(V::load_part(g.add(x), left), before);
                        sum.store_part(to.add(x), left);
                        x += V::WIDTH;
                    }
                }
            }
            let scale = V::splat(self.scale);
            let mut x = 0;
            while x < width {
                let mut mean = V::splat(T::ZERO);
                for depth in 0..sizes.depths {
                    let weight = V::load_part(weights.as_ptr().add(sizes.weight(strip, depth) + x), width - x);
                    mean = weight.mul_add(V::load(slopes.add(depth * STRIP + x)), mean);
                }
                for depth in 0..sizes.depths {
                    let weight = V::load_part(weights.as_ptr().add(sizes.weight(strip, depth) + x), width - x);
                    let slope = slopes.add(depth * STRIP + x);
                    weight.mul(V::load(slope).sub(mean)).mul(scale).store(slope);
                }
                x += V::WIDTH;
            }
            for channel in 0..sizes.channels {
                let query = q.as_ptr().add(sizes.map(strip, channel));
                for depth in 0..sizes.depths {
                    let to = dk.at(sizes.volume(strip, channel, depth));
                    let mut x = 0;
                    while x < width {
                        let left = width - x;
                        prefetch::to_write(to.wrapping_add(x + WRITTEN_AHEAD));
                        let before = if first { V::splat(T::ZERO) } else { V::load_part(to.add(x), left) };
                        let slope = V::load(slopes.add(depth * STRIP + x));
                        slope.mul_add(V::load_part(query.add(x), left), before).store_part(to.add(x), left);
                        x += V::WIDTH;
                    }
                }
                mix::<V>(sizes, strip, channel, k, slopes, dq.at(sizes.map(strip, channel)));
            }
        }
    }
}

/// `scores[depth] += Σ map[channel] · volume[channel][depth]` over `N` channels; the first ones begin at 0.
#[inline(always)]
unsafe fn add_products<V: Lane, const N: usize>(
    sizes: Sizes,
    strip: Strip,
    channel: usize,
    map: &[V::Element],
    volume: &[V::Element],
    scores: *mut V::Element,
) {
    // SAFETY: as the caller.
    unsafe {
        let mut factors = [map.as_ptr(); N];
        for n in 0..N {
            factors[n] = map.as_ptr().add(sizes.map(strip, channel + n));
        }
        for depth in 0..sizes.depths {
            let mut rows = [volume.as_ptr(); N];
            for n in 0..N {
                rows[n] = volume.as_ptr().add(sizes.volume(strip, channel + n, depth));
            }
            let scores = scores.add(depth * STRIP);
            let mut x = 0;
            while x < strip.width {
                let left = strip.width - x;
                let mut sum = if channel == 0 { V::splat(V::Element::ZERO) } else { V::load(scores.add(x)) };
                for n in 0..N {
                    prefetch::to_read::<true, _>(rows[n].wrapping_add(x + READ_AHEAD));
                    sum = V::load_part(factors[n].add(x), left).mul_add(V::load_part(rows[n].add(x), left), sum);
                }
                sum.store(scores.add(x));
                x += V::WIDTH;
            }
        }
    }
}

/// `to = Σ_depth weights[depth] · volume[channel][depth]`
#[inline(always)]
unsafe fn mix<V: Lane>(
    sizes: Sizes,
    strip: Strip,
    channel: usize,
    volume: &[V::Element],
    weights: *const V::Element,
    to: *mut V::Element,
) {
    // SAFETY: as the caller.
    unsafe {
        let mut depth = 0;
        while depth < sizes.depths || depth == 0 {
            let row = volume.as_ptr().wrapping_add(sizes.volume(strip, channel, depth));
            let count = GROUP.min(sizes.depths - depth);
            let mut x = 0;
            while x < strip.width {
                let left = strip.width - x;
                let mut sum = if depth == 0 { V::splat(V::Element::ZERO) } else { V::load_part(to.add(x), left) };
                if count == GROUP {
                    for n in 0..GROUP {
                        prefetch::to_read::<true, _>(row.wrapping_add(n * sizes.pixels + x + READ_AHEAD));
                        let weight = V::load(weights.add((depth + n) * STRIP + x));
                        sum = weight.mul_add(V::load_part(row.add(n * sizes.pixels + x), left), sum);
                    }
                } else {
                    for n in 0..count {
                        let weight = V::load(weights.add((depth + n) * STRIP + x));
                        sum = weight.mul_add(V::load_part(row.add(n * sizes.pixels + x), left), sum);
                    }
                }
                sum.store_part(to.add(x), left);
                x += V::WIDTH;
            }
            depth += GROUP;
        }
    }
}
