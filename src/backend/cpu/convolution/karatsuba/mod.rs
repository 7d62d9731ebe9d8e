//! Transposed convolutions in space whose stride is 2 and whose kernel is 3×3×3, with 125 products where there were 216
//! (Karatsuba's trick along each axis: Karatsuba and Ofman 1962; as a minimal filter F(2, 2): Winograd 1980), and gradients in
//! the weight likewise.
//!
//! ```text
//! axis        pairs of places along one axis, and their five products instead of six
//! transform   images to what is multiplied, and back
//! weights     weights likewise
//! ```
//!
//! The small image's pairs come in 27 forms, and each form meets the factors of up to eight products: 27 products of matrices
//! `[products · large channels, small channels] · [small channels, pairs]` make the large image. The gradient in the weight goes
//! through the same steps transposed. The small image of the large one would as well, but is no faster than its patches.

mod axis;
mod transform;
mod weights;

use std::ops::Range;

use rayon::prelude::*;

use crate::backend::cpu::gemm::{Gemm, Out, Par, Strided};
use crate::backend::cpu::{Places, Temporary, buffer, vectorised};
use crate::ops::Geometry;
use crate::scalar::Real;
use axis::{Axis, FORM, Image};
use transform::{Gather, Links, SLACK, Spread};

/// Values of forms and products that are in work at a time: 8 MiB of `f32`; and the most that may have to be.
const IN_WORK: usize = 2 << 20;
const MOST_IN_WORK: usize = 16 << 20;
/// Fewest pairs of a product, and fewest channels, for which the transforms pay.
const FEWEST_PAIRS: usize = 128;
const FEWEST_CHANNELS: usize = 32;
/// The share of the multiplications that must be left.
const LEFT: f64 = 0.75;

/// How a convolution is cut into pairs of places and slabs of them.
pub(super) struct Plan {
    /// Pairs along the depth.
    pairs: usize,
    batch: usize,
    /// Channels of the small and of the large image, and the former rounded up to whole vectors.
    channels: [usize; 2],
    row: usize,
    /// The products, by the form that they take, and where those of each form begin.
    parts: Vec<[usize; 3]>,
    starts: Vec<usize>,
    small: Links,
    large: Links,
    /// Layers of pairs that are in work at a time.
    layers: usize,
}

impl Plan {
    /// The plan for a geometry, if it is one of those that pay.
    pub(super) fn new(g: &Geometry) -> Option<Self> {
        if g.groups != 1 || g.kernel != [3; 3] || g.stride != [2; 3] || g.dilation != [1; 3] {
            return None;
        }
        let axes = [0, 1, 2].map(|axis| Axis::new([g.y[axis], g.x[axis]], g.padding[axis]));
        let pairs = axes.map(|axis| axis.pairs);
        let left: f64 = (0..3).map(|axis| 5.0 / 6.0 * (2 * pairs[axis]) as f64 / g.y[axis] as f64).product();
        let channels = [g.outputs, g.inputs];
        let few = channels.iter().any(|&count| count < FEWEST_CHANNELS);
        if few || pairs.iter().product::<usize>() < FEWEST_PAIRS || left > LEFT {
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
        let mut ranks = vec![0; parts.len()];
        let n = Image::Large.slots();
        parts.iter().enumerate().for_each(|(rank, [d, h, w])| ranks[(d * n + h) * n + w] = rank);
        let large = Links::new(Image::Large, axes, ranks);
        let small = Links::new(Image::Small, axes, (0..forms).collect());
        let each = small.layer() * (forms * channels[0] + parts.len() * channels[1]);
        let layers = pairs[0].div_ceil(pairs[0].div_ceil((IN_WORK / each).max(1)));
        let row = channels[0].next_multiple_of(16);
        let plan = Self { pairs: pairs[0], batch: g.batch, channels, row, parts, starts, small, large, layers };
        (each <= MOST_IN_WORK).then_some(plan)
    }

    /// Slabs of pairs along the depth.
    fn slabs(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let (layers, pairs) = (self.layers, self.pairs);
        (0..pairs).step_by(layers).map(move |start| start..pairs.min(start + layers))
    }

    /// Memory of a slab for the slots of an image, and the length of one slot of one channel. The lengths are odd multiples of
    /// a line, so that neighbouring rows do not compete for the same places of the caches.
    fn slots<T: Real>(&self, links: &Links, channels: usize) -> (Temporary<T>, usize) {
        let length = (self.layers + 1) * links.layer() + SLACK;
        let length = (length.div_ceil(SLACK) | 1) * SLACK;
        (Temporary::new(links.count() * channels * length), length)
    }

    /// Fills the slots of a slab from an image.
    fn spread<T: Real>(&self, links: &Links, image: &[T], slab: &Range<usize>, to: &mut [T], length: usize) {
        let channels = image.len() / links.volume();
        let to = Places::of(to);
        image.par_chunks(links.volume()).enumerate().for_each_init(Vec::new, |scratch, (c, channel)| {
            // SAFETY: the slots of a channel lie within the memory, and are one thread's.
            let to = unsafe { to.at(c * length) };
            vectorised(Spread { links, channel, slab: slab.clone(), to, rank: channels * length, scratch });
        });
    }

    /// Makes what a slab completes of the large image.
    fn gather<T: Real>(&self, slab: &Range<usize>, from: &mut [T], length: usize, bias: Option<&[T]>, image: &mut [T]) {
        let (links, rank) = (&self.large, self.channels[1] * length);
        let from = Places::of(from);
        image.par_chunks_mut(links.volume()).enumerate().for_each_init(Vec::new, |scratch, (c, channel)| {
            // SAFETY: the products of a channel lie within the memory, and are one thread's.
            let from = unsafe { from.at(c * length) };
            let bias = bias.map_or(T::ZERO, |bias| bias[c]);
            vectorised(Gather { links, slab: slab.clone(), from, rank, bias, channel, scratch });
        });
    }

    /// The forms, the range of products of each and these products' part of some memory, the largest first.
    fn forms<'m, T: Send>(&self, memory: &'m mut [T]) -> Vec<(usize, Range<usize>, &'m mut [T])> {
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
    pub(super) fn enlarge<T: Real>(&self, image: &[T], weight: &[T], bias: Option<&[T]>) -> Vec<T> {
        let ([small, large], row) = (self.channels, self.row);
        let factors = self.factors(weight);
        let (mut forms, form) = self.slots::<T>(&self.small, small);
        let (mut products, product) = self.slots::<T>(&self.large, large);
        let mut result = buffer(self.batch * large * self.large.volume());
        let images = image.chunks_exact(small * self.small.volume());
        for (image, result) in images.zip(result.chunks_exact_mut(large * self.large.volume())) {
            for slab in self.slabs() {
                self.spread(&self.small, image, &slab, &mut forms, form);
                let pairs = slab.len() * self.small.layer();
                let work = self.forms(&mut products);
                work.into_par_iter().with_max_len(1).for_each(|(number, parts, products)| {
                    let left = Strided::lines(&factors[parts.start * large * row..], row);
                    let right = Strided::side_by_side(&forms[number * small * form..], form);
                    let out = Out::rows(&mut products[self.large.layer()..], product);
                    Gemm::new([parts.len() * large, small, pairs]).run(&left, &right, out, Par::Sequential);
                });
                self.gather(&slab, &mut products, product, bias, result);
            }
        }
        result
    }

    /// The weight of both images.
    pub(super) fn weights<T: Real>(&self, large_image: &[T], small_image: &[T]) -> Vec<T> {
        let ([small, large], row) = (self.channels, self.row);
        let (mut forms, form) = self.slots::<T>(&self.small, small);
        let (mut products, product) = self.slots::<T>(&self.large, large);
        let mut slopes = Temporary::<T>::new(self.parts.len() * large * row);
        slopes.par_chunks_mut(large * row).for_each(|slopes| slopes.fill(T::ZERO));
        let images = large_image.chunks_exact(large * self.large.volume());
        for (large_image, small_image) in images.zip(small_image.chunks_exact(small * self.small.volume())) {
            for slab in self.slabs() {
                self.spread(&self.small, small_image, &slab, &mut forms, form);
                self.spread(&self.large, large_image, &slab, &mut products, product);
                let pairs = slab.len() * self.small.layer();
                let work = self.forms(&mut slopes);
                work.into_par_iter().with_max_len(1).for_each(|(number, parts, slopes)| {
                    let left = Strided::lines(&products[parts.start * large * product..], product);
                    let right = Strided::lines(&forms[number * small * form..], form);
                    let gemm = Gemm::new([parts.len() * large, pairs, small]).accumulate();
                    gemm.run(&left, &right, Out::rows(slopes, row), Par::Sequential);
                });
            }
        }
        self.slopes(&slopes)
    }
}
