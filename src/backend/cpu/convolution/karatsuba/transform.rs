//! One channel of an image turned into the forms or products of its pairs, and products back into the large image.

use std::ops::Range;

use super::axis::{Axis, Image, PARTS};
use crate::backend::cpu::prefetch;
use crate::scalar::{Job, Lane, Real};

/// The widest vector. What a row of pairs stores beyond its end is written over by the next row, or is slack.
pub(super) const SLACK: usize = 16;

/// How the places of an image are linked to the slots of its pairs; a slot is a form of the small image or a product of the
/// large one.
pub(super) struct Links {
    image: Image,
    axes: [Axis; 3],
    /// For each slot and pair along depth and height: the places that it is the sum of.
    by_slot: [Vec<Vec<(usize, f64)>>; 2],
    /// For each place along depth and height: the slots and pairs that it is the sum of.
    by_place: [Vec<Vec<(usize, usize, f64)>>; 2],
    /// Where each combination of three slots is kept, the last axis innermost.
    ranks: Vec<usize>,
}

impl Links {
    pub(super) fn new(image: Image, axes: [Axis; 3], ranks: Vec<usize>) -> Self {
        let by_slot = [0, 1].map(|a: usize| {
            let mut sums = vec![Vec::new(); image.slots() * axes[a].pairs];
            let links = axes[a].links(image);
            links.for_each(|link| sums[link.slot * axes[a].pairs + link.pair].push((link.place, link.sign)));
            sums
        });
        let by_place = [0, 1].map(|a: usize| {
            let mut sums = vec![Vec::new(); axes[a].places(image)];
            axes[a].links(image).for_each(|link| sums[link.place].push((link.slot, link.pair, link.sign)));
            sums
        });
        Self { image, axes, by_slot, by_place, ranks }
    }

    /// Combinations of slots.
    pub(super) fn count(&self) -> usize {
        self.ranks.len()
    }

    fn rank(&self, d: usize, h: usize, w: usize) -> usize {
        self.ranks[(d * self.image.slots() + h) * self.image.slots() + w]
    }

    /// Pairs of a layer.
    pub(super) fn layer(&self) -> usize {
        self.axes[1].pairs * self.axes[2].pairs
    }

    /// Places of a channel.
    pub(super) fn volume(&self) -> usize {
        self.axes.iter().map(|axis| axis.places(self.image)).product()
    }

    /// The length of a padded row, and the zeros in front of the image in it.
    fn line(&self) -> (usize, usize) {
        let (width, before) = (&self.axes[2], self.axes[2].before(self.image));
        let reach = self.image.step() * width.pairs + 1;
        (reach.max(before + width.places(self.image)), before)
    }

    /// Places along the depth from the first one of a slab to the first one of the next, and `further`.
    fn reach(&self, slab: &Range<usize>, further: usize) -> Range<usize> {
        let (step, before) = (self.image.step(), self.axes[0].before(self.image));
        let at = |place: usize| place.saturating_sub(before).min(self.axes[0].places(self.image));
        at(step * slab.start)..at(step * slab.end + further)
    }

    /// Places along the depth that are complete with a slab of pairs.
    fn complete(&self, slab: &Range<usize>) -> Range<usize> {
        let Range { start, end } = self.reach(slab, 0);
        start..if slab.end == self.axes[0].pairs { self.axes[0].places(self.image) } else { end }
    }
}

/// Makes the forms or products of a slab of pairs from a channel: along the height, the width and the depth.
pub(super) struct Spread<'a, T> {
    pub(super) links: &'a Links,
    pub(super) channel: &'a [T],
    /// Pairs along the depth.
    pub(super) slab: Range<usize>,
    /// Where the first combination of slots goes, and the distance to the next; each is `[pairs…]`, and slack behind them.
    pub(super) to: *mut T,
    pub(super) rank: usize,
    pub(super) scratch: &'a mut Vec<T>,
}

impl<T: Real> Job<T> for Spread<'_, T> {
    type Output = ();

    /// # Safety
    /// All combinations of slots must have room for the slab and the slack.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { links, channel, slab, to, rank, scratch } = self;
        let [depth, height, width] = &links.axes;
        let (slots, high, wide) = (links.image.slots(), height.places(links.image), width.places(links.image));
        let (layer, places) = (links.layer(), links.reach(&slab, 1));
        let (line, before) = links.line();
        let slices = places.len() * slots * slots * layer;
        scratch.clear();
        scratch.resize(slices + SLACK + line, T::ZERO);
        let (sums, line) = scratch.split_at_mut(slices + SLACK);
        for d in 0..places.len() {
            for h in 0..slots {
                let sums = &mut sums[(d * slots + h) * slots * layer..][..slots * layer];
                for j in 0..height.pairs {
                    let mut sum = Sum::new(T::ZERO);
                    for (place, sign) in &links.by_slot[1][h * height.pairs + j] {
                        sum.add(channel[((places.start + d) * high + place) * wide..][..wide].as_ptr(), *sign);
                    }
                    // SAFETY: the rows and the line are as long as the image is wide.
                    unsafe { sum.run::<V, true>(line[before..before + wide].as_mut_ptr(), wide) };
                    spread_row(links.image, width.pairs, line, &mut sums[j * width.pairs..], layer);
                }
            }
        }
        for d in 0..slots {
            for h in 0..slots {
                for w in 0..slots {
                    let to = to.wrapping_add(links.rank(d, h, w) * rank);
                    for i in slab.clone() {
                        let mut sum = Sum::new(T::ZERO);
                        for (place, sign) in &links.by_slot[0][d * depth.pairs + i] {
                            let at = (((place - places.start) * slots + h) * slots + w) * layer;
                            sum.add(sums[at..].as_ptr(), *sign);
                        }
                        let to = to.wrapping_add((i - slab.start) * layer);
                        // SAFETY: there is slack behind the sums; the rest is the caller's promise.
                        unsafe { sum.run::<V, false>(to, layer) };
                    }
                }
            }
        }
    }
}

/// Makes the places of a channel of the large image that a slab of pairs completes: along the depth, the width and the height.
pub(super) struct Gather<'a, T> {
    pub(super) links: &'a Links,
    pub(super) slab: Range<usize>,
    /// As for [`Spread`], with a layer of pairs in front: the last one of the slab before, whose products reach into this one.
    pub(super) from: *mut T,
    pub(super) rank: usize,
    pub(super) bias: T,
    pub(super) channel: &'a mut [T],
    pub(super) scratch: &'a mut Vec<T>,
}

impl<T: Real> Job<T> for Gather<'_, T> {
    type Output = ();

    /// # Safety
    /// All products must be there for the slab and the layer in front, with slack behind them.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { links, slab, from, rank, bias, channel, scratch } = self;
        let [_, height, width] = &links.axes;
        let (high, wide) = (height.places(links.image), width.places(links.image));
        let (layer, (line, before)) = (links.layer(), links.line());
        let row = layer.next_multiple_of(SLACK);
        scratch.clear();
        scratch.resize(PARTS * PARTS * row + PARTS * height.pairs * line, T::ZERO);
        let (sums, lines) = scratch.split_at_mut(PARTS * PARTS * row);
        for place in links.complete(&slab) {
            for h in 0..PARTS {
                let sums = &mut sums[h * PARTS * row..][..PARTS * row];
                for w in 0..PARTS {
                    let mut sum = Sum { ahead: layer, ..Sum::new(T::ZERO) };
                    for (d, i, sign) in &links.by_place[0][place] {
                        sum.add(from.wrapping_add(links.rank(*d, h, w) * rank + (i + 1 - slab.start) * layer), *sign);
                    }
                    // SAFETY: rows of sums are whole vectors; the rest is the caller's promise.
                    unsafe { sum.run::<V, false>(sums[w * row..].as_mut_ptr(), layer) };
                }
                for j in 0..height.pairs {
                    let line = &mut lines[(h * height.pairs + j) * line..][..line];
                    gather_row(width.pairs, &sums[j * width.pairs..], row, line);
                }
            }
            for y in 0..high {
                let mut sum = Sum::new(bias);
                for (h, j, sign) in &links.by_place[1][y] {
                    sum.add(lines[(h * height.pairs + j) * line + before..][..wide].as_ptr(), *sign);
                }
                let to = &mut channel[(place * high + y) * wide..][..wide];
                // SAFETY: the lines and the row are as long as the image is wide.
                unsafe { sum.run::<V, true>(to.as_mut_ptr(), wide) };
            }
        }
        for h in 0..PARTS {
            for w in 0..PARTS {
                let at = from.wrapping_add(links.rank(PARTS - 1, h, w) * rank);
                // SAFETY: the layer in front and the last one are there, and do not overlap.
                unsafe { std::ptr::copy_nonoverlapping(at.add(slab.len() * layer), at, layer) };
            }
        }
    }
}

/// A sum of up to three rows with signs.
struct Sum<T> {
    rows: [*const T; 3],
    signs: [f64; 3],
    count: usize,
    start: T,
    /// Values by which rows are asked for ahead of their use, if at all.
    ahead: usize,
}

impl<T: Real> Sum<T> {
    fn new(start: T) -> Self {
        Self { rows: [std::ptr::null(); 3], signs: [0.0; 3], count: 0, start, ahead: 0 }
    }

    fn add(&mut self, row: *const T, sign: f64) {
        (self.rows[self.count], self.signs[self.count]) = (row, sign);
        self.count += 1;
    }

    /// `to = start + Σ sign · row` over `len` values; what it stores beyond them, up to a vector, has no effect, unless `EXACT`
    /// says that there is nothing.
    ///
    /// # Safety
    /// The instruction set of `V` must be enabled, and the rows and the destination must be as long as that.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>, const EXACT: bool>(&self, to: *mut T, len: usize) {
        // SAFETY: the caller's promise.
        unsafe {
            match self.count {
                0 => self.of::<V, 0, EXACT>(to, len),
                1 => self.of::<V, 1, EXACT>(to, len),
                2 => self.of::<V, 2, EXACT>(to, len),
                _ => self.of::<V, 3, EXACT>(to, len),
            }
        }
    }

    /// # Safety
    /// As [`Sum::run`].
    #[inline(always)]
    unsafe fn of<V: Lane<Element = T>, const N: usize, const EXACT: bool>(&self, to: *mut T, len: usize) {
        // SAFETY: the caller's promise.
        unsafe {
            let start = V::splat(self.start);
            let mut signs = [start; N];
            for t in 0..N {
                signs[t] = V::splat(T::from_f64(self.signs[t]));
            }
            let mut x = 0;
            while x < len {
                let left = if EXACT { len - x } else { V::WIDTH };
                let mut sum = start;
                for t in 0..N {
                    let row = self.rows[t].add(x);
                    if self.ahead > 0 {
                        prefetch::to_read::<true, T>(row.wrapping_add(self.ahead));
                    }
                    sum = signs[t].mul_add(V::load_part(row, left), sum);
                }
                sum.store_part(to.add(x), left);
                x += V::WIDTH;
            }
        }
    }
}

/// The slots of the last axis for a padded row of `count` pairs, `slot` values apart.
#[inline(always)]
fn spread_row<T: Real>(image: Image, count: usize, line: &[T], to: &mut [T], slot: usize) {
    let (first, rest) = to.split_at_mut(slot);
    let (second, rest) = rest.split_at_mut(slot);
    let (first, second) = (&mut first[..count], &mut second[..count]);
    match image {
        Image::Small => {
            let (pairs, third) = (&line.as_chunks::<2>().0[..count], &mut rest[..count]);
            for i in 0..count {
                let [a, b] = pairs[i];
                (first[i], second[i], third[i]) = (a, a + b, b);
            }
        }
        Image::Large => {
            let (fours, next) = (&line.as_chunks::<4>().0[..count], &line[4..][..4 * count - 3]);
            let (third, rest) = rest.split_at_mut(slot);
            let (fourth, fifth) = rest.split_at_mut(slot);
            let (third, fourth, fifth) = (&mut third[..count], &mut fourth[..count], &mut fifth[..count]);
            for i in 0..count {
                let [a, b, c, d] = fours[i];
                (first[i], second[i], third[i], fourth[i], fifth[i]) = (a - c, b, c, d, next[4 * i] - c);
            }
        }
    }
}

/// The padded row of the large image from the products of the last axis, `count` pairs, which begin `slot` values apart.
#[inline(always)]
fn gather_row<T: Real>(count: usize, products: &[T], slot: usize, line: &mut [T]) {
    let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|number| &products[number * slot..][..count]);
    let fours = &mut line.as_chunks_mut::<4>().0[..count];
    fours[0] = [a[0], b[0], c[0] - a[0] - e[0], d[0]];
    for i in 1..count {
        fours[i] = [a[i] + e[i - 1], b[i], c[i] - a[i] - e[i], d[i]];
    }
    line[4 * count] = e[count - 1];
}
