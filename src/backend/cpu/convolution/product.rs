//! Convolutions as products of matrices: weight times patches, where the patches are packed straight from the padded image
//! and never exist as a whole.

use std::ops::Range;

use rayon::prelude::*;

use super::walk::{Tap, Walk};
use crate::backend::cpu::gemm::{Gemm, Out, Panel, Par, Strided};
use crate::backend::cpu::{Temporary, buffer, prefetch, vectorised};
use crate::ops::Geometry;
use crate::scalar::{Job, Lane, Real};

/// Most lines of a strip that a product asks for.
const MOST: usize = 32;
/// Places of a plane below which all images of a batch go through one product, so that weights are read once.
const FEW: usize = 256;

/// Rows of patches that are fetched ahead.
const AHEAD: usize = 16;

/// Patches of the source as the right factor: a line for each place of some images, along it the channels and their taps.
struct Patches<'a, T> {
    walk: &'a Walk,
    taps: &'a [Tap],
    /// Padded planes from the first channel of the first image on.
    source: &'a [T],
    /// Elements of a padded plane, and from one image to the next.
    plane: usize,
    image: usize,
}

impl<T: Real> Panel<T> for Patches<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        if depth.is_empty() {
            return;
        }
        let (count, height, long) = (self.walk.count(), self.walk.axes[1].count, self.walk.axes[2].count);
        let mut bases = [0; MOST];
        for (i, base) in bases[..width].iter_mut().enumerate() {
            // places beyond the last line repeat it
            let line = (lines.start + i).min(lines.end - 1);
            let (image, place) = (line / count, line % count);
            let row = self.walk.row(place / long / height, place / long % height).0;
            *base = image * self.image + row + place % long;
        }
        // SAFETY: the job checks its slices; the places of lines never fall.
        unsafe { vectorised(CopyPatches { from: self, depth, width, bases: &bases, into }) };
    }
}

/// Copies whole vectors where neighbouring lines are neighbouring pixels.
struct CopyPatches<'a, 'b, T> {
    from: &'b Patches<'a, T>,
    depth: Range<usize>,
    width: usize,
    bases: &'b [usize; MOST],
    into: &'b mut [T],
}

impl<T: Real> Job<T> for CopyPatches<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { from: Patches { taps, source, plane, .. }, depth, width, bases, into } = self;
        let furthest = bases[width - 1];
        let mut near = [false; MOST];
        for i in (0..width).step_by(V::WIDTH) {
            near[i] = i + V::WIDTH <= width && bases[i + V::WIDTH - 1] - bases[i] == V::WIDTH - 1;
        }
        let (mut channel, mut tap) = (depth.start / taps.len(), depth.start % taps.len());
        // a row of patches is in another plane soon: too far apart for the processor to see it coming
        let ahead = (AHEAD / taps.len()).max(1) * plane;
        for row in 0..depth.len() {
            let at = channel * plane + taps[tap].offset;
            let (row, source) = (&mut into[row * width..][..width], &source[at..=at + furthest]);
            for i in (0..width).step_by(V::WIDTH) {
                prefetch::to_read::<true, _>(source.as_ptr().wrapping_add(bases[i] + ahead));
                if near[i] {
                    // SAFETY: both slices reach to the last of these places.
                    unsafe { V::load(source.as_ptr().add(bases[i])).store(row.as_mut_ptr().add(i)) };
                } else {
                    for j in i..width.min(i + V::WIDTH) {
                        row[j] = source[bases[j]];
                    }
                }
            }
            tap += 1;
            if tap == taps.len() {
                (channel, tap) = (channel + 1, 0);
            }
        }
    }
}

/// The weight as the left factor of a transposed convolution: a line for each input, along it the outputs and their taps.
struct Turned<'a, T> {
    weight: &'a [T],
    taps: &'a [Tap],
    inputs: usize,
    volume: usize,
}

impl<T: Real> Panel<T> for Turned<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        if depth.is_empty() {
            return;
        }
        let (mut output, mut tap) = (depth.start / self.taps.len(), depth.start % self.taps.len());
        for row in into.chunks_exact_mut(width) {
            let first = (output * self.inputs + lines.start) * self.volume + self.taps[tap].number;
            let from = &self.weight[first..];
            for (i, value) in row[..lines.len()].iter_mut().enumerate() {
                *value = from[i * self.volume];
            }
            tap += 1;
            if tap == self.taps.len() {
                (output, tap) = (output + 1, 0);
            }
        }
    }
}

/// A walk with everything that its products need.
struct Product<'a, T> {
    g: &'a Geometry,
    walk: &'a Walk,
    taps: Vec<Tap>,
    source: &'a [T],
    weight: &'a [T],
    bias: Option<&'a [T]>,
    turned: bool,
}

impl<T: Real> Product<'_, T> {
    /// Channels of one group of the source and of the result.
    fn channels(&self) -> [usize; 2] {
        let Geometry { inputs, outputs, .. } = *self.g;
        if self.turned { [outputs, inputs] } else { [inputs, outputs] }
    }

    /// The places of some images of one group: `out` is `[channels, images · places]`.
    fn run(&self, group: usize, images: Range<usize>, out: Out<'_, T>, par: Par) {
        let ([from, to], [_, _, volume]) = (self.channels(), self.g.volumes());
        let plane = self.walk.plane().0;
        let image = self.g.groups * from * plane;
        let patches = Patches {
            walk: self.walk,
            taps: &self.taps,
            source: &self.source[images.start * image + group * from * plane..],
            plane,
            image,
        };
        let weight = &self.weight[group * self.g.outputs * self.g.inputs * volume..];
        let depth = from * self.taps.len();
        let gemm = Gemm::new([to, depth, images.len() * self.walk.count()]);
        let gemm = gemm.row_bias(self.bias.map(|bias| &bias[group * to..][..to]));
        let plain = self.walk.axes.iter().all(|axis| axis.every == 1 && axis.step == 1 && axis.taps.len() == 1);
        let point = Strided::side_by_side(patches.source, plane);
        // a product of one tap per channel reads the image as it lies
        let right: &dyn Panel<T> =
            if plain && images.len() == 1 && self.taps[0].offset == 0 && self.walk.count() == plane {
                &point
            } else {
                &patches
            };
        if self.turned {
            gemm.run(&Turned { weight, taps: &self.taps, inputs: self.g.inputs, volume }, right, out, par);
        } else {
            gemm.run(&Strided::lines(weight, depth), right, out, par);
        }
    }

    /// All images and groups into `[batch, groups · channels, places]`.
    fn dense(&self, result: &mut [T]) {
        let (count, [_, to]) = (self.walk.count(), self.channels());
        let Geometry { batch, groups, .. } = *self.g;
        if batch > 1 && count < FEW {
            self.merged(result);
        } else if groups == 1 {
            for (image, out) in result.chunks_exact_mut(to * count).enumerate() {
                self.run(0, image..image + 1, Out::rows(out, count), Par::Threads);
            }
        } else {
            result.par_chunks_mut(to * count).with_max_len(1).enumerate().for_each(|(i, out)| {
                self.run(i % groups, i / groups..i / groups + 1, Out::rows(out, count), Par::Sequential);
            });
        }
    }

    /// The same with the whole batch in one product for each group.
    fn merged(&self, result: &mut [T]) {
        let (count, [_, to]) = (self.walk.count(), self.channels());
        let Geometry { batch, groups, .. } = *self.g;
        let mut together = Temporary::new(result.len());
        if groups == 1 {
            self.run(0, 0..batch, Out::rows(&mut together, batch * count), Par::Threads);
        } else {
            together.par_chunks_mut(to * batch * count).with_max_len(1).enumerate().for_each(|(group, out)| {
                self.run(group, 0..batch, Out::rows(out, batch * count), Par::Sequential);
            });
        }
        result.par_chunks_mut(count).with_min_len(64).enumerate().for_each(|(number, out)| {
            let (image, channel) = (number / (groups * to), number % (groups * to));
            out.copy_from_slice(&together[(channel * batch + image) * count..][..count]);
        });
    }
}

/// The result of image, weight and bias.
pub(super) fn forward<T: Real>(g: &Geometry, walk: &Walk, image: &[T], weight: &[T], bias: Option<&[T]>) -> Vec<T> {
    let source = walk.pad(image);
    let product = Product { g, walk, taps: walk.taps(g.kernel), source: &source, weight, bias, turned: false };
    let mut result = buffer(g.batch * g.groups * g.outputs * g.volumes()[1]);
    product.dense(&mut result);
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
    let [pixels, _, _] = g.volumes();
    let mut image = buffer(g.batch * g.groups * g.inputs * pixels);
    let Some(first) = walks.first() else {
        return image;
    };
    // all walks go over the same padded planes
    let source = first.pad(result);
    let product =
        |walk| Product { g, walk, taps: Walk::taps(walk, g.kernel), source: &source, weight, bias, turned: true };
    if first.is_dense() {
        product(first).dense(&mut image);
        return image;
    }
    let parts: Vec<_> = walks
        .par_iter()
        .with_max_len(1)
        .map(|walk| {
            let mut part = Temporary::new(g.batch * g.groups * g.inputs * walk.count());
            product(walk).dense(&mut part);
            (walk, part)
        })
        .collect();
    // walks that share rows follow one another, so that a row is completed while it is at hand
    image.par_chunks_mut(pixels).enumerate().for_each(|(plane, image)| {
        for row in parts.chunk_by(|(a, _), (b, _)| (0..2).all(|axis| a.axes[axis].first == b.axes[axis].first)) {
            let [depth, height, _] = &row[0].0.axes;
            for number in 0..depth.count * height.count {
                let to = |walk: &Walk| walk.row(number / height.count, number % height.count).1;
                let from = |walk: &Walk| {
                    let long = walk.axes[2].count;
                    plane * walk.count() + number * long..plane * walk.count() + (number + 1) * long
                };
                match row {
                    // two that take turns: whole vectors
                    [one, two] if one.0.axes[2].every == 2 && one.0.axes[2].count == two.0.axes[2].count => {
                        let ((a, evens), (b, odds)) = if to(one.0) < to(two.0) { (one, two) } else { (two, one) };
                        let to = image[to(a)..].as_chunks_mut::<2>().0.iter_mut();
                        let both = evens[from(a)].iter().zip(&odds[from(b)]);
                        to.zip(both).for_each(|(to, (even, odd))| *to = [*even, *odd]);
                    }
                    _ => row.iter().for_each(|(walk, part)| {
                        let to = image[to(walk)..].iter_mut().step_by(walk.axes[2].every);
                        to.zip(&part[from(walk)]).for_each(|(to, value)| *to = *value);
                    }),
                }
            }
        }
    });
    image
}
