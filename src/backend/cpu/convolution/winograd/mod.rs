//! Convolutions of stride 1 whose kernel is 3×3 on the last two axes, with 2.25 times fewer multiplications (Winograd's
//! minimal filtering F(2×2, 3×3); Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016).
//!
//! Every square of 2×2 results is made from 4×4 pixels, which are transformed; so are the weights. In transformed space each
//! of the 16 places is a product of matrices `[tiles, channels] · [channels, channels]`. A kernel with a depth adds up such
//! products over the slices that it meets. The gradient in the weight goes through the same steps transposed.

mod blocks;
mod gradient;
mod squares;
mod transform;

use rayon::prelude::*;

use super::layout::{Turn, Window, channels_last};
use super::walk::Walk;
use crate::backend::cpu::gemm::{Gemm, Out, Par, Strided};
use crate::backend::cpu::{Temporary, buffer};
use crate::ops::Geometry;
use crate::scalar::{Path, Real};
use blocks::Blocks;
use squares::{Ring, Squares};
use transform::{BLOCK, Square, Step, Transform};

/// Places in transformed space.
const PLACES: usize = 16;
/// Values of transformed source and result that are in work at a time: 16 MiB of `f32`.
const IN_WORK: usize = 4 << 20;
/// Slices of a kernel with a depth that are in work together, so that what they share is read once.
const TOGETHER: usize = 4;
/// Fewest tiles of a product, and fewest channels, for which the transforms pay.
const FEWEST_TILES: usize = 48;
const FEWEST_CHANNELS: usize = 16;

/// Memory that threads write at distinct places.
struct Shared<T>(*mut T, usize);

// SAFETY: its users write distinct elements from distinct threads.
unsafe impl<T: Send> Sync for Shared<T> {}

impl<T> Shared<T> {
    fn new(values: &mut [T]) -> Self {
        Self(values.as_mut_ptr(), values.len())
    }

    /// The place `offset`, with at least `len` values behind it.
    fn at(&self, offset: usize, len: usize) -> *mut T {
        assert!(offset + len <= self.1, "within the memory");
        self.0.wrapping_add(offset)
    }
}

/// How a convolution is cut into tiles.
pub(super) struct Plan<'a> {
    walk: &'a Walk,
    images: usize,
    /// Channels of source and result, and the same rounded up to whole vectors.
    channels: [usize; 2],
    padded: [usize; 2],
    /// Tiles along the height and the width of a slice of the result.
    tiles: [usize; 2],
    /// Rows of tiles, and slices, that are in work at a time.
    rows: usize,
    slices: usize,
    /// Whether slices do not depend on each other and go through one product.
    merged: bool,
}

/// Some slices in work, numbered through all images, and their rows of tiles.
#[derive(Debug, Clone)]
struct Part {
    slices: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
}

impl<'a> Plan<'a> {
    /// The plan for a walk, if it is one of those that pay. `turned` says that the walk is to the image of `g`.
    pub(super) fn new(g: &Geometry, walk: &'a Walk, turned: bool) -> Option<Self> {
        let near = (0..3).all(|axis| g.stride[axis] == 1) && g.dilation[1..] == [1, 1] && g.kernel[1..] == [3, 3];
        let channels = if turned { [g.outputs, g.inputs] } else { [g.inputs, g.outputs] };
        if !near || g.groups != 1 || channels.iter().any(|&count| count < FEWEST_CHANNELS) {
            return None;
        }
        let padded = channels.map(|count| count.next_multiple_of(16));
        let [depth, height, width] = walk.result;
        let tiles = [height.div_ceil(2), width.div_ceil(2)];
        let most = (IN_WORK / PLACES / (padded[0] + padded[1])).max(FEWEST_TILES);
        // as many as fit, evenly
        let even = |count: usize, most: usize| count.div_ceil(count.div_ceil(most.max(1)));
        let rows = even(tiles[0], most / tiles[1]);
        let merged = g.kernel[0] == 1 && g.padding[0] == 0 && g.batch > 0;
        let slices = if merged { even(g.batch * depth, most / (rows * tiles[1])) } else { TOGETHER.min(depth) };
        let wasted = 4 * tiles[0] * tiles[1] > height * width * 3 / 2;
        let plan = Self { walk, images: g.batch, channels, padded, tiles, rows, slices, merged };
        (!wasted && if merged { slices } else { 1 } * rows * tiles[1] >= FEWEST_TILES).then_some(plan)
    }

    /// The parts of all images, which have `slices` each: slices innermost.
    fn parts(&self, slices: usize) -> impl Iterator<Item = Part> + '_ {
        // a run of slices is one image, or all of them where that does not matter
        let (runs, run) = if self.merged { (1, self.images * slices) } else { (self.images, slices) };
        (0..self.tiles[0]).step_by(self.rows).flat_map(move |row| {
            let starts =
                (0..runs).flat_map(move |image| (0..run).step_by(self.slices).map(move |at| (image * run, at)));
            starts.map(move |(first, at)| Part {
                slices: first + at..first + run.min(at + self.slices),
                rows: row..self.tiles[0].min(row + self.rows),
            })
        })
    }

    /// The source with its channels last and as many zeros around it as the tiles reach.
    fn source<T: Real>(&self, planes: &[T]) -> Temporary<T> {
        let axes = &self.walk.axes;
        let first = |axis: usize| axes[axis].taps.iter().map(|(_, offset)| *offset).min().unwrap_or(0).cast_signed();
        let window = Window {
            size: [0, 1, 2].map(|axis| axes[axis].source),
            before: [0, axes[1].before.cast_signed() - first(1), axes[2].before.cast_signed() - first(2)],
            extent: self.source_extent(),
        };
        channels_last(planes, self.channels[0], &window, self.padded[0])
    }

    fn source_extent(&self) -> [usize; 3] {
        [self.walk.axes[0].source, 2 * self.tiles[0] + 2, 2 * self.tiles[1] + 2]
    }

    /// The squares of what [`Plan::source`] made.
    fn pixels<'p, T>(&self, pixels: &'p [T], by_blocks: bool) -> Squares<'p, T> {
        let [_, height, width] = self.source_extent();
        let (channels, across) = (self.padded[0], self.tiles[1]);
        Squares { step: Step::Input, pixels, extent: [height, width], channels, across, by_blocks }
    }

    /// For each tap along the depth, the slice of the source that a slice of the result meets there, if it is inside.
    fn met(&self, slice: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let (depth, axis) = (self.walk.result[0], &self.walk.axes[0]);
        let (image, place) = (slice / depth, slice % depth);
        axis.taps.iter().enumerate().filter_map(move |(tap, (_, offset))| {
            let at = (place + offset).checked_sub(axis.before).filter(|&at| at < axis.source)?;
            Some((tap, image * axis.source + at))
        })
    }

    /// Slices of the transformed source that are kept.
    fn span(&self) -> usize {
        let offsets = self.walk.axes[0].taps.iter().map(|(_, offset)| *offset);
        match (offsets.clone().min(), offsets.max()) {
            (Some(least), Some(most)) if !self.merged => most - least + self.slices,
            _ => 1,
        }
    }

    /// Tiles of a part of a ring.
    fn ring_tiles(&self) -> usize {
        if self.merged { self.most_tiles() } else { self.rows * self.tiles[1] }
    }

    /// Tiles of a full part.
    fn most_tiles(&self) -> usize {
        self.slices * self.rows * self.tiles[1]
    }

    /// The transformed weight: for each tap along the depth and each place `[blocks, source channels, 16]`, in blocks of
    /// channels of the result.
    /// `weight(source, result, tap)` gives the first of nine numbers.
    fn weight<T: Real>(
        &self,
        weight: &[T],
        at: impl Fn(usize, usize, usize) -> usize + Sync,
        flip: bool,
    ) -> Temporary<T> {
        let ([from, to], [_, row]) = (self.channels, self.padded);
        let taps = &self.walk.axes[0].taps;
        let mut transformed = Temporary::new(taps.len() * PLACES * from * row);
        let shared = Shared::new(&mut transformed);
        (0..taps.len() * from.div_ceil(BLOCK)).into_par_iter().for_each(|number| {
            let (tap, block) = (number % taps.len(), number / taps.len() * BLOCK);
            let mut nine = [[T::ZERO; BLOCK]; 9];
            for first in (0..to).step_by(BLOCK) {
                let count = BLOCK.min(to - first);
                for k in block..from.min(block + BLOCK) {
                    for i in 0..count {
                        let values = &weight[at(k, first + i, taps[tap].0)..][..9];
                        for j in 0..9 {
                            nine[j][i % BLOCK] = values[if flip { 8 - j } else { j }];
                        }
                    }
                    let place = from * row;
                    let offset = tap * PLACES * place + first * from + k * BLOCK;
                    let transform = Transform {
                        step: Step::Weight,
                        from: Square { at: nine.as_ptr().cast(), row: 3 * BLOCK, column: BLOCK },
                        to: Square { at: shared.at(offset, 15 * place + BLOCK), row: 4 * place, column: place },
                        channels: BLOCK,
                        to_block: 0,
                        count: 1,
                        from_next: 0,
                        to_next: 0,
                    };
                    // SAFETY: the best path is available, nine vectors are there, the last place was checked, and each
                    // channel of the source is written by one thread.
                    unsafe { T::dispatch(Path::best(), transform) };
                }
            }
        });
        transformed
    }

    /// The result of walking: `planes` of the source, and a weight as for [`Plan::weight`].
    pub(super) fn run<T: Real>(
        &self,
        planes: &[T],
        weight: &[T],
        at: impl Fn(usize, usize, usize) -> usize + Sync,
        flip: bool,
        bias: Option<&[T]>,
    ) -> Vec<T> {
        let ([from, to], [from_row, to_row]) = (self.channels, self.padded);
        let (pixels, weight) = (self.source(planes), self.weight(weight, at, flip));
        let [depth, height, width] = self.walk.result;
        let mut result = buffer::<T>(self.images * to * depth * height * width);
        let pixels = self.pixels(&pixels, false);
        let mut ring = Ring::new(self.span(), self.ring_tiles(), from_row);
        let mut products = Temporary::<T>::new(PLACES * self.most_tiles() * to_row);
        for part in self.parts(depth) {
            // what each product of some tiles is the sum of: taps and slices of the source
            let met: Vec<Vec<_>> = match self.merged {
                true => vec![vec![(0, 0)]],
                false => part.slices.clone().map(|slice| self.met(slice).collect()).collect(),
            };
            if self.merged {
                ring.fill_all(&pixels, &part.slices, &part.rows);
            } else {
                ring.fill(&pixels, met.iter().flatten().map(|(_, slice)| *slice), &part.rows);
            }
            let (ring, all) = (&ring, part.slices.len() * part.rows.len() * self.tiles[1]);
            let tiles = all / met.len();
            products[..PLACES * all * to_row].par_chunks_mut(all * to_row).with_max_len(1).enumerate().for_each(
                |(place, products)| {
                    for (product, met) in products.chunks_exact_mut(tiles * to_row).zip(&met) {
                        if met.is_empty() {
                            product.fill(T::ZERO);
                        }
                        for (number, (tap, slice)) in met.iter().enumerate() {
                            let left = Strided::lines(&ring.slice(*slice)[place * tiles * from_row..], from_row);
                            let right = [&weight[(tap * PLACES + place) * from * to_row..]];
                            let right = Blocks { parts: &right, lines: to, depth: from };
                            let gemm = Gemm::new([tiles, from, to]);
                            let gemm = if number > 0 { gemm.accumulate() } else { gemm };
                            gemm.run(&left, &right, Out::rows(product, to_row), Par::Sequential);
                        }
                    }
                },
            );
            self.put(&part, &products, all, bias, &Shared::new(&mut result));
        }
        result
    }

    /// Transforms products back and puts them in their planes.
    fn put<T: Real>(&self, part: &Part, products: &[T], tiles: usize, bias: Option<&[T]>, result: &Shared<T>) {
        let (to, row) = (self.channels[1], self.padded[1]);
        let [depth, height, width] = self.walk.result;
        let across = self.tiles[1];
        let rows = part.rows.len();
        (0..part.slices.len() * rows).into_par_iter().with_min_len(2).for_each_init(
            || vec![T::ZERO; 4 * across * row],
            |lines, number| {
                let place = tiles * row;
                let from = &products[number * across * row..];
                assert!(from.len() >= (PLACES - 1) * place + across * row, "within the products");
                let transform = Transform {
                    step: Step::Output,
                    from: Square { at: from.as_ptr(), row: 4 * place, column: place },
                    to: Square { at: lines.as_mut_ptr(), row: 2 * across * row, column: row },
                    channels: row,
                    to_block: BLOCK,
                    count: across,
                    from_next: row,
                    to_next: 2 * row,
                };
                // SAFETY: the best path is available; all products and both lines are there.
                unsafe { T::dispatch(Path::best(), transform) };
                let slice = part.slices.start + number / rows;
                let (image, d) = (slice / depth, slice % depth);
                let first = 2 * (part.rows.start + number % rows);
                for h in first..height.min(first + 2) {
                    let line = &mut lines[(h - first) * 2 * across * row..][..2 * across * row];
                    if let Some(bias) = bias {
                        for pixel in line.chunks_exact_mut(row).take(width) {
                            pixel.iter_mut().zip(bias).for_each(|(value, bias)| *value += *bias);
                        }
                    }
                    let (plane, first) =
                        (depth * height * width, (image * to * depth + d) * height * width + h * width);
                    let (from, extent) = (line.as_ptr(), [width, to]);
                    let to = result.at(first, (to - 1) * plane + width);
                    let turn = Turn { from, from_row: row, to, to_row: plane, extent };
                    // SAFETY: the best path is available; the rows of all channels were checked, and one thread writes them.
                    unsafe { T::dispatch(Path::best(), turn) };
                }
            },
        );
    }
}
