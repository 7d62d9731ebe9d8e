//! The gradient of a convolution in its weight as a product: results times patches, summed over all places of all images.

use std::ops::Range;

use rayon::prelude::*;

use super::layout::{Window, channels_last};
use super::walk::{Tap, Walk};
use crate::backend::cpu::gemm::{Gemm, Out, Panel, Par, Strided};
use crate::backend::cpu::{Temporary, buffer, vectorised};
use crate::ops::Geometry;
use crate::scalar::{Job, Lane, Real};

/// Places from which on turning the image pays.
const MANY: usize = 512;

/// Patches as the right factor from padded planes: a line for each channel and tap, along it the places of all images.
struct Planes<'a, T> {
    planes: &'a [T],
    plane: usize,
    taps: &'a [Tap],
    /// Where each place lies, without channel and tap.
    places: &'a [usize],
}

impl<T: Real> Panel<T> for Planes<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        for (i, line) in lines.enumerate() {
            let base = line / self.taps.len() * self.plane + self.taps[line % self.taps.len()].offset;
            for (row, place) in into.chunks_exact_mut(width).zip(&self.places[depth.clone()]) {
                row[i] = self.planes[place + base];
            }
        }
    }
}

/// Patches as the right factor from an image with its channels last: a line for each tap and channel, taps outermost.
struct Pixels<'a, T> {
    image: &'a [T],
    channels: usize,
    /// Where each tap reads, and each place of all images lies.
    taps: &'a [usize],
    places: &'a [usize],
}

impl<T: Real> Panel<T> for Pixels<'_, T> {
    fn pack(&self, lines: Range<usize>, depth: Range<usize>, width: usize, into: &mut [T]) {
        let mut line = lines.start;
        while line < lines.end {
            let (tap, channel) = (line / self.channels, line % self.channels);
            let len = (self.channels - channel).min(lines.end - line);
            let image = &self.image[self.taps[tap] + channel..];
            let places = &self.places[depth.clone()];
            // SAFETY: the job checks its slices.
            unsafe { vectorised(CopyPixels { image, places, len, width, into: &mut into[line - lines.start..] }) };
            line += len;
        }
    }
}

/// Copies a few neighbouring channels of each place.
struct CopyPixels<'a, 'b, T> {
    image: &'a [T],
    places: &'a [usize],
    len: usize,
    width: usize,
    into: &'b mut [T],
}

impl<T: Real> Job<T> for CopyPixels<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { image, places, len, width, into } = self;
        for row in 0..places.len() {
            let (from, to) = (&image[places[row]..][..len], &mut into[row * width..][..len]);
            let mut i = 0;
            while i + V::WIDTH <= len {
                // SAFETY: both slices hold `len` values.
                unsafe { V::load(from.as_ptr().add(i)).store(to.as_mut_ptr().add(i)) };
                i += V::WIDTH;
            }
            while i < len {
                to[i] = from[i];
                i += 1;
            }
        }
    }
}

/// The weight of image and result.
pub(super) fn weights<T: Real>(g: &Geometry, walk: &Walk, image: &[T], result: &[T]) -> Vec<T> {
    let [_, count, volume] = g.volumes();
    let whole = Window { size: g.y, before: [0; 3], extent: g.y };
    let turned = channels_last(result, g.groups * g.outputs, &whole, g.groups * g.outputs);
    let (taps, plane) = (walk.taps(g.kernel), walk.plane().0);
    let [_, height, width] = &walk.axes;
    let at = |place: usize| {
        let (row, w) = (place / width.count, place % width.count);
        walk.row(row / height.count, row % height.count).0 + w
    };
    let (depth, lines) = (g.batch * count, g.inputs * volume);
    let each = |weight: &mut [T], right: &dyn Panel<T>, group: usize, par: Par| {
        let values = turned.get(group * g.outputs..).unwrap_or(&[]);
        let left = Strided { values, line: 1, depth: g.groups * g.outputs };
        Gemm::new([g.outputs, depth, lines]).run(&left, right, Out::rows(weight, lines), par);
    };
    let mut weight = buffer(g.groups * g.outputs * lines);
    let groups = |weight: &mut [T], each: &(dyn Fn(usize, &mut [T], Par) + Sync)| {
        if g.groups == 1 {
            each(0, weight, Par::Threads);
        } else {
            let parts = weight.par_chunks_mut(g.outputs * lines).with_max_len(1).enumerate();
            parts.for_each(|(group, weight)| each(group, weight, Par::Sequential));
        }
    };
    if depth < MANY {
        let padded = walk.pad(image);
        let step = g.groups * g.inputs * plane;
        let places: Vec<_> = (0..depth).map(|i| i / count * step + at(i % count)).collect();
        groups(&mut weight, &|group, weight, par| {
            let planes = padded.get(group * g.inputs * plane..).unwrap_or(&[]);
            each(weight, &Planes { planes, plane, taps: &taps, places: &places }, group, par);
        });
        return weight;
    }
    let channels = g.groups * g.inputs;
    let window = Window {
        size: g.x,
        before: [0, 1, 2].map(|axis| walk.axes[axis].before.cast_signed()),
        extent: [0, 1, 2].map(|axis| walk.axes[axis].padded()),
    };
    let image = channels_last(image, channels, &window, channels);
    let [_, high, wide] = window.extent;
    let pixel = |[d, h, w]: [usize; 3]| ((d * high + h) * wide + w) * channels;
    let across =
        |number: usize, size: [usize; 3]| [number / size[2] / size[1], number / size[2] % size[1], number % size[2]];
    let step = [0, 1, 2].map(|axis| walk.axes[axis].step);
    let places: Vec<_> = (0..depth)
        .map(|i| {
            let place = across(i % count, g.y);
            i / count * pixel([window.extent[0], 0, 0]) + pixel([0, 1, 2].map(|axis| place[axis] * step[axis]))
        })
        .collect();
    let offsets: Vec<_> = (0..volume)
        .map(|number| {
            let tap = across(number, g.kernel);
            pixel([0, 1, 2].map(|axis| walk.axes[axis].taps[tap[axis]].1))
        })
        .collect();
    let mut outermost = Temporary::new(weight.len());
    groups(&mut outermost, &|group, weight, par| {
        let right = Pixels { image: &image[group * g.inputs..], channels: g.inputs, taps: &offsets, places: &places };
        each(weight, &right, group, par);
    });
    weight.par_chunks_mut(lines).zip(outermost.par_chunks(lines)).for_each(|(weight, outermost)| {
        for (tap, values) in outermost.chunks_exact(g.inputs).enumerate() {
            values.iter().enumerate().for_each(|(c, value)| weight[c * volume + tap] = *value);
        }
    });
    weight
}
