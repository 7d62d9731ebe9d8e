//! Images turned into the forms or products of their pairs, and products back into the large image. A vector holds neighbouring
//! channels of one place, so that sums of places are sums of rows.

use std::ops::Range;

use super::axis::{Axis, Image, Link};
use crate::backend::cpu::convolution::layout::{Turn, Window};
use crate::backend::cpu::prefetch;
use crate::scalar::{Job, Lane, Real};

/// Values that rows of channels are rounded up to: the widest vector.
pub(super) const WIDEST: usize = 16;

/// Pairs by which products are asked for ahead of their use.
const AHEAD: usize = 2;

/// The slots of an image's pairs along three axes: forms of the small image, or products of the large one.
pub(super) struct Slots<T> {
    image: Image,
    axes: [Axis; 3],
    /// The values of a row of channels.
    pub(super) row: usize,
    /// For each slot, the values that it is the sum of, counted from a pair's first one in a window, and their signs.
    sums: Vec<Vec<(usize, T)>>,
    /// Where each slot of the first pair lies, and the distance from one pair to the next.
    at: Vec<[usize; 2]>,
    /// Layers of pairs in front of those of a slab.
    front: usize,
}

impl<T: Real> Slots<T> {
    pub(super) fn new(image: Image, axes: [Axis; 3], row: usize, at: Vec<[usize; 2]>, front: usize) -> Self {
        let n = image.slots();
        let mut sums = vec![Vec::new(); n * n * n];
        let [_, high, wide] = axes.map(|axis| image.covered(axis.pairs));
        for d in image.shares() {
            for h in image.shares() {
                for w in image.shares() {
                    let place = (d.place * high + h.place) * wide + w.place;
                    sums[(d.slot * n + h.slot) * n + w.slot].push((place * row, T::from_f64(d.sign * h.sign * w.sign)));
                }
            }
        }
        Self { image, axes, row, sums, at, front }
    }

    /// Pairs of a layer.
    pub(super) fn layer(&self) -> usize {
        self.axes[1].pairs * self.axes[2].pairs
    }

    /// Rows of pairs in a layer.
    pub(super) fn rows(&self) -> usize {
        self.axes[1].pairs
    }

    /// Places of a channel of the image.
    pub(super) fn volume(&self) -> usize {
        self.axes.iter().map(|axis| axis.places(self.image)).product()
    }

    /// Places along the depth that are complete with a slab of pairs.
    pub(super) fn complete(&self, slab: &Range<usize>) -> Range<usize> {
        let (places, before) = (self.axes[0].places(self.image), self.axes[0].before(self.image));
        let at = |pair: usize| (self.image.step() * pair).saturating_sub(before).min(places);
        at(slab.start)..if slab.end == self.axes[0].pairs { places } else { at(slab.end) }
    }

    /// The places of an image that a slab of pairs along the depth covers.
    pub(super) fn window(&self, slab: &Range<usize>) -> Window {
        let pairs = [slab.len(), self.axes[1].pairs, self.axes[2].pairs];
        let mut before = self.axes.map(|axis| axis.before(self.image).cast_signed());
        before[0] -= (self.image.step() * slab.start).cast_signed();
        Window {
            size: self.axes.map(|axis| axis.places(self.image)),
            before,
            extent: pairs.map(|pairs| self.image.covered(pairs)),
        }
    }

    /// Values of the window's first place of a row of pairs.
    fn first(&self, [layer, row]: [usize; 2]) -> usize {
        let [_, high, wide] = self.axes.map(|axis| self.image.covered(axis.pairs));
        self.image.step() * (layer * high + row) * wide * self.row
    }

    /// The number of a row's first pair in a slab.
    fn number(&self, [layer, row]: [usize; 2]) -> usize {
        ((layer + self.front) * self.axes[1].pairs + row) * self.axes[2].pairs
    }
}

/// Makes all slots of a row of pairs from a window of the image.
pub(super) struct Spread<'a, T> {
    pub(super) slots: &'a Slots<T>,
    /// The window, with its channels last.
    pub(super) image: &'a [T],
    /// The layer of the slab, and the row in it.
    pub(super) row: [usize; 2],
    /// Where the slots are.
    pub(super) to: *mut T,
}

impl<T: Real> Job<T> for Spread<'_, T> {
    type Output = ();

    /// # Safety
    /// The image must be as long as its window, all slots must have room, and nobody else may write to this row's.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { slots, image, row, to } = self;
        let (first, number) = (slots.first(row), slots.number(row));
        for pair in 0..slots.axes[2].pairs {
            let from = image[first + slots.image.step() * pair * slots.row..].as_ptr();
            for (sum, [at, step]) in slots.sums.iter().zip(&slots.at) {
                let to = to.wrapping_add(at + (number + pair) * step);
                // SAFETY: the caller's promise.
                unsafe { add::<V>(from, sum, std::ptr::null(), to, slots.row) };
            }
        }
    }
}

/// Makes a row of the large image along its width, in all channels.
pub(super) struct Gather<'a, T> {
    pub(super) slots: &'a Slots<T>,
    /// The products, and the first pair along the depth.
    pub(super) from: &'a [T],
    pub(super) start: usize,
    /// What the places of the row are sums of: along depth and height, and for each place along the width.
    pub(super) links: [&'a [Link]; 2],
    pub(super) width: &'a [Vec<Link>],
    /// What is added, a row of channels.
    pub(super) bias: &'a [T],
    /// Memory for the row with its channels last.
    pub(super) line: &'a mut [T],
    /// Where the row of the first channel goes, the distance to the next one, and their number.
    pub(super) to: *mut T,
    pub(super) volume: usize,
    pub(super) channels: usize,
}

impl<T: Real> Job<T> for Gather<'_, T> {
    type Output = ();

    /// # Safety
    /// The products must be there for the slab and the layer in front, the image must have room, and nobody else may write to
    /// this row of it.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { slots, from, start, links: [depth, height], width, bias, line, to, volume, channels } = self;
        let n = slots.image.slots();
        for (links, place) in width.iter().zip(line.chunks_exact_mut(slots.row)) {
            let (mut terms, mut count) = ([(0, T::ZERO); 27], 0);
            for d in depth {
                for h in height {
                    // the layer in front makes room for the pair before the slab's first one
                    let number = ((d.pair + slots.front - start) * slots.axes[1].pairs + h.pair) * slots.axes[2].pairs;
                    for w in links {
                        let [at, step] = slots.at[(d.slot * n + h.slot) * n + w.slot];
                        let next = from.as_ptr().wrapping_add(at + (number + w.pair + AHEAD) * step);
                        for x in (0..slots.row).step_by(64 / size_of::<T>()) {
                            prefetch::to_read::<true, T>(next.wrapping_add(x));
                        }
                        terms[count] = (at + (number + w.pair) * step, T::from_f64(d.sign * h.sign * w.sign));
                        count += 1;
                    }
                }
            }
            // SAFETY: the caller's promise.
            unsafe { add::<V>(from.as_ptr(), &terms[..count], bias.as_ptr(), place.as_mut_ptr(), slots.row) };
        }
        let turn =
            Turn { from: line.as_ptr(), from_row: slots.row, to, to_row: volume, extent: [width.len(), channels] };
        // SAFETY: the line holds a row for each place; the rest is the caller's promise.
        unsafe { turn.run::<V>() };
    }
}

/// `to = start + Σ sign · from[at..]` over a row of whole vectors; a null start is 0.
///
/// # Safety
/// The instruction set of `V` must be enabled, and all rows must be there.
#[inline(always)]
unsafe fn add<V: Lane>(
    from: *const V::Element,
    terms: &[(usize, V::Element)],
    start: *const V::Element,
    to: *mut V::Element,
    row: usize,
) {
    const TOGETHER: usize = 4;
    macro_rules! vectors {
        ($count:expr, $x:expr) => {{
            let mut sums = [V::splat(V::Element::ZERO); $count];
            if !start.is_null() {
                for v in 0..$count {
                    sums[v] = V::load(start.add($x + v * V::WIDTH));
                }
            }
            for &(at, sign) in terms {
                let (from, sign) = (from.add(at + $x), V::splat(sign));
                for v in 0..$count {
                    sums[v] = sign.mul_add(V::load(from.add(v * V::WIDTH)), sums[v]);
                }
            }
            for v in 0..$count {
                sums[v].store(to.add($x + v * V::WIDTH));
            }
        }};
    }
    let mut x = 0;
    // SAFETY: the caller's promise.
    unsafe {
        while x + TOGETHER * V::WIDTH <= row {
            vectors!(TOGETHER, x);
            x += TOGETHER * V::WIDTH;
        }
        while x < row {
            vectors!(1, x);
            x += V::WIDTH;
        }
    }
}
