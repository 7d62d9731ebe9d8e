//! Transposed convolutions in space whose stride is 2 and whose kernel is 3×3×3, with 125 products where there were 216
//! (Karatsuba's trick along each axis: Karatsuba and Ofman 1962; as a minimal filter F(2, 2): Winograd 1980), and gradients in
//! the weight likewise.
//!
//! ```text
//! axis        pairs of places along one axis, and their five products instead of six
//! transform   images to what is multiplied, and back, with their channels side by side
//! weights     weights likewise
//! ```
//!
//! The small image's pairs come in 27 forms, and each form meets the factors of up to eight products: 27 products of matrices
//! `[pairs, small channels] · [small channels, products · large channels]` make the large image. The gradient in the weight goes
//! through the same steps transposed. The small image of the large one would as well, but is no faster than its patches.

mod axis;
mod transform;
mod weights;

use std::ops::Range;

use rayon::prelude::*;

use super::layout::channels_last;
use crate::backend::cpu::gemm::{Gemm, Out, Par, Strided};
use crate::backend::cpu::{Places, Temporary, buffer, vectorised};
use crate::ops::Geometry;
use crate::scalar::Real;
use axis::{Axis, FORM, Image, Link};
use transform::{Gather, Slots, Spread, WIDEST};

/// Values of forms and products that are in work at a time: 16 MiB of `f32`; and the most that may have to be.
const IN_WORK: usize = 4 << 20;
const MOST_IN_WORK: usize = 16 << 20;
/// Fewest pairs of a product, and fewest channels, for which the transforms pay.
const FEWEST_PAIRS: usize = 128;
const FEWEST_CHANNELS: usize = 32;
/// The share of the multiplications that must be left.
const LEFT: f64 = 0.75;

/// How a convolution is cut into pairs of places and slabs of them.
pub(super) struct Plan<T> {
    batch: usize,
    /// Channels of the small and of the large image.
    channels: [usize; 2],
    /// The products, by the form that they take, and where those of each form begin.
    parts: Vec<[usize; 3]>,
    starts: Vec<usize>,
    /// `[pairs, small channels]` for each form, and for each form `[pairs, its products, large channels]`, a layer in front: the
    /// last one of the slab before, whose products reach into this one. Channels are rounded up to whole vectors.
    forms: Slots<T>,
    products: Slots<T>,
    /// For each form `[small channels, its products, large channels]`: where each product's factors for the first small channel
    /// are, and the distance to those for the next one.
    factors: Vec<[usize; 2]>,
    /// For each place of the large image along each axis, the products that it is the sum of.
    links: [Vec<Vec<Link>>; 3],
    /// Pairs along the depth, and layers of them that are in work at a time.
    pairs: usize,
    layers: usize,
}

impl<T: Real> Plan<T> {
    /// The plan for a geometry, if it is one of those that pay.
    pub(super) fn new(g: &Geometry) -> Option<Self> {
        if g.groups != 1 || g.kernel != [3; 3] || g.stride != [2; 3] || g.dilation != [1; 3] {
            return None;
        }
        let axes = [0, 1, 2].map(|axis| Axis::new([g.y[axis], g.x[axis]], g.padding[axis]));
        let [pairs, high, wide] = axes.map(|axis| axis.pairs);
        let left: f64 = (0..3).map(|axis| 5.0 / 6.0 * (2 * axes[axis].pairs) as f64 / g.y[axis] as f64).product();
        let channels = [g.outputs, g.inputs];
        let few = channels.iter().any(|&count| count < FEWEST_CHANNELS);
        if few || pairs * high * wide < FEWEST_PAIRS || left > LEFT {
            return None;
        }
        let all = |image: Image| {
            let n = image.slots();
            (0..n * n * n).map(move |i| [i / (n * n), i / n % n, i % n])
        };
        let form = |part: &[usize; 3]| part.iter().fold(0, |form, &slot| form * Image::Small.slots() + FORM[slot]);
        let mut parts: Vec<_> = all(Image::Large).collect();
        parts.sort_by_key(form);
        let forms = all(Image::Small).count();
        let starts: Vec<_> = (0..=forms).map(|number| parts.partition_point(|part| form(part) < number)).collect();

        let rows = channels.map(|count| count.next_multiple_of(WIDEST));
        let each = high * wide * (forms * rows[0] + parts.len() * rows[1]);
        let layers = pairs.div_ceil(pairs.div_ceil((IN_WORK / each).max(1)));
        if each > MOST_IN_WORK {
            return None;
        }
        // where each product of a form is, if that many rows are kept for each of a form's products
        let places = |rows_of_each: usize| -> Vec<[usize; 2]> {
            let of = |(i, part): (usize, &[usize; 3])| {
                let [start, end] = [0, 1].map(|next| starts[form(part) + next]);
                [(start * rows_of_each + i - start) * rows[1], (end - start) * rows[1]]
            };
            parts.iter().enumerate().map(of).collect()
        };
        let by_rank = places((layers + 1) * high * wide);
        let rank = |part: [usize; 3]| parts.iter().position(|other| *other == part).expect("one of the products");
        let at_products = all(Image::Large).map(|part| by_rank[rank(part)]).collect();
        let at_forms = (0..forms).map(|form| [form * layers * high * wide * rows[0], rows[0]]).collect();
        Some(Self {
            batch: g.batch,
            channels,
            forms: Slots::new(Image::Small, axes, rows[0], at_forms, 0),
            products: Slots::new(Image::Large, axes, rows[1], at_products, 1),
            factors: places(channels[0]),
            links: axes.map(|axis| axis.links()),
            parts,
            starts,
            pairs,
            layers,
        })
    }

    /// Slabs of pairs along the depth.
    fn slabs(&self) -> impl Iterator<Item = Range<usize>> + use<T> {
        let (layers, pairs) = (self.layers, self.pairs);
        (0..pairs).step_by(layers).map(move |start| start..pairs.min(start + layers))
    }

    /// Memory for the forms, and for the products.
    fn memory(&self) -> [Temporary<T>; 2] {
        let (layers, layer) = (self.layers, self.forms.layer());
        let forms = (self.starts.len() - 1) * layers * layer * self.forms.row;
        [forms, self.parts.len() * (layers + 1) * layer * self.products.row].map(Temporary::new)
    }

    /// Fills the slots of a slab from an image.
    fn spread(&self, slots: &Slots<T>, image: &[T], slab: &Range<usize>, to: &mut [T]) {
        let window = channels_last(image, image.len() / slots.volume(), &slots.window(slab), slots.row);
        let to = Places::of(to);
        let rows = slots.rows();
        (0..slab.len() * rows).into_par_iter().for_each(|number| {
            // SAFETY: the slots of a row lie within the memory, and are one thread's.
            let to = unsafe { to.at(0) };
            // SAFETY: the window is that of the slab, and the memory has room for all slots of its layers.
            unsafe { vectorised(Spread { slots, image: &window, row: [number / rows, number % rows], to }) };
        });
    }

    /// Makes what a slab completes of the large image, and leaves its last layer in front of the next one.
    fn gather(&self, slab: &Range<usize>, from: &mut [T], bias: &[T], image: &mut [T]) {
        let slots = &self.products;
        let [depth, height, width] = &self.links;
        let complete = slots.complete(slab);
        let (volume, channels) = (slots.volume(), self.channels[1]);
        let to = Places::of(image);
        let products = &*from;
        (0..complete.len() * height.len()).into_par_iter().for_each_init(Vec::new, |line, number| {
            let (d, h) = (complete.start + number / height.len(), number % height.len());
            line.resize(width.len() * slots.row, T::ZERO);
            // SAFETY: a row of the image lies within it in each channel, and is one thread's.
            let to = unsafe { to.at((d * height.len() + h) * width.len()) };
            let links = [&depth[d][..], &height[h][..]];
            let start = slab.start;
            // SAFETY: the products are those of the slab and the layer in front; bias and line have whole rows.
            unsafe {
                vectorised(Gather { slots, from: products, start, links, width, bias, line, to, volume, channels })
            };
        });
        for form in self.starts.windows(2) {
            let layer = (form[1] - form[0]) * slots.layer() * slots.row;
            let first = form[0] * (self.layers + 1) * slots.layer() * slots.row;
            from.copy_within(first + slab.len() * layer..first + (slab.len() + 1) * layer, first);
        }
    }

    /// The forms, their products' range, and these products' part of some memory, the largest first.
    fn each_form<'m>(&self, memory: &'m mut [T]) -> Vec<(usize, Range<usize>, &'m mut [T])> {
        let (each, mut rest) = (memory.len() / self.parts.len(), memory);
        let mut forms = Vec::new();
        for form in 0..self.starts.len() - 1 {
            let parts = self.starts[form]..self.starts[form + 1];
            let (own, after) = rest.split_at_mut(each * parts.len());
            rest = after;
            forms.push((form, parts, own));
        }
        forms.sort_by_key(|(_, parts, _)| std::cmp::Reverse(parts.len()));
        forms
    }

    /// The large image of the small one.
    pub(super) fn enlarge(&self, image: &[T], weight: &[T], bias: Option<&[T]>) -> Vec<T> {
        let ([small, large], [small_row, row]) = (self.channels, [self.forms.row, self.products.row]);
        let factors = self.factors_of(weight);
        let mut padded = bias.map_or_else(Vec::new, <[T]>::to_vec);
        padded.resize(row, T::ZERO);
        let [mut forms, mut products] = self.memory();
        let mut result = buffer(self.batch * large * self.products.volume());
        let images = image.chunks_exact(small * self.forms.volume());
        for (image, result) in images.zip(result.chunks_exact_mut(large * self.products.volume())) {
            for slab in self.slabs() {
                self.spread(&self.forms, image, &slab, &mut forms);
                let layer = self.forms.layer();
                let work = self.each_form(&mut products);
                work.into_par_iter().with_max_len(1).for_each(|(form, parts, products)| {
                    let columns = parts.len() * row;
                    let left = Strided::lines(&forms[form * self.layers * layer * small_row..], small_row);
                    let right = Strided::side_by_side(&factors[parts.start * small * row..], columns);
                    let out = Out::rows(&mut products[layer * columns..], columns);
                    Gemm::new([slab.len() * layer, small, columns]).run(&left, &right, out, Par::Sequential);
                });
                self.gather(&slab, &mut products, &padded, result);
            }
        }
        result
    }

    /// The weight of both images.
    pub(super) fn weights(&self, large_image: &[T], small_image: &[T]) -> Vec<T> {
        let ([small, large], [small_row, row]) = (self.channels, [self.forms.row, self.products.row]);
        let [mut forms, mut products] = self.memory();
        let mut slopes = Temporary::<T>::new(self.parts.len() * small * row);
        slopes.par_chunks_mut(small * row).for_each(|slopes| slopes.fill(T::ZERO));
        let images = large_image.chunks_exact(large * self.products.volume());
        for (large_image, small_image) in images.zip(small_image.chunks_exact(small * self.forms.volume())) {
            for slab in self.slabs() {
                self.spread(&self.forms, small_image, &slab, &mut forms);
                self.spread(&self.products, large_image, &slab, &mut products);
                let layer = self.forms.layer();
                let work = self.each_form(&mut slopes);
                work.into_par_iter().with_max_len(1).for_each(|(form, parts, slopes)| {
                    let columns = parts.len() * row;
                    let left = Strided::side_by_side(&forms[form * self.layers * layer * small_row..], small_row);
                    let products = &products[parts.start * (self.layers + 1) * layer * row..];
                    let right = Strided::side_by_side(&products[layer * columns..], columns);
                    let gemm = Gemm::new([small, slab.len() * layer, columns]).accumulate();
                    gemm.run(&left, &right, Out::rows(slopes, columns), Par::Sequential);
                });
            }
        }
        self.slopes_of(&slopes)
    }
}
