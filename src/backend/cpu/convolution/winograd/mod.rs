//! Convolutions of stride 1 whose kernel is 3×3 on the last two axes, with 2.25 times fewer multiplications (Winograd's
//! minimal filtering F(2×2, 3×3); Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016).
//!
//! Every square of 2×2 results is made from 4×4 pixels, which are transformed; so are the weights. In transformed space each
//! of the 16 places is a product of matrices `[tiles, channels] · [channels, channels]`. A kernel with a depth adds up such
//! products over the slices that it meets. The gradient in the weight goes through the same steps transposed.

mod blocks;
mod transform;

use rayon::prelude::*;

use super::layout::{Window, channels_last};
use super::walk::Walk;
use crate::backend::cpu::buffer;
use crate::backend::cpu::gemm::{Gemm, Out, Par, Strided};
use crate::ops::Geometry;
use crate::scalar::{Path, Real};
use blocks::Blocks;
use transform::{BLOCK, Square, Step, Transform};

/// Places in transformed space.
const PLACES: usize = 16;
/// Values of transformed source and result that are in work at a time: 8 MiB of `f32`.
const IN_WORK: usize = 2 << 20;
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
        let most = (IN_WORK / PLACES / (padded[0] * g.kernel[0] + padded[1])).max(FEWEST_TILES);
        // as many as fit, evenly
        let even = |count: usize, most: usize| count.div_ceil(count.div_ceil(most.max(1)));
        let rows = even(tiles[0], most / tiles[1]);
        // slices of a kernel with a depth depend on each other and are taken one by one
        let apart = g.kernel[0] == 1 && g.padding[0] == 0 && g.batch > 0;
        let slices = if apart { even(g.batch * depth, most / (rows * tiles[1])) } else { 1 };
        let wasted = 4 * tiles[0] * tiles[1] > height * width * 3 / 2;
        let plan = Self { walk, images: g.batch, channels, padded, tiles, rows, slices };
        (!wasted && slices * rows * tiles[1] >= FEWEST_TILES).then_some(plan)
    }

    fn parts(&self) -> impl Iterator<Item = Part> + '_ {
        let count = self.images * self.walk.result[0];
        (0..self.tiles[0]).step_by(self.rows).flat_map(move |row| {
            (0..count).step_by(self.slices).map(move |slice| Part {
                slices: slice..count.min(slice + self.slices),
                rows: row..self.tiles[0].min(row + self.rows),
            })
        })
    }

    /// The source with its channels last and as many zeros around it as the tiles reach.
    fn source<T: Real>(&self, planes: &[T]) -> Vec<T> {
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
            (Some(least), Some(most)) if self.slices == 1 => most - least + 1,
            _ => 1,
        }
    }

    /// Tiles of a full part.
    fn most_tiles(&self) -> usize {
        self.slices * self.rows * self.tiles[1]
    }

    /// Transforms squares of pixels of some slices: `[places, tiles, channels]`, or by blocks of channels `[places, blocks,
    /// tiles, 16]`. `extent` are the rows and columns of a slice.
    #[allow(clippy::too_many_arguments)]
    fn squares<T: Real>(
        &self,
        step: Step,
        pixels: &[T],
        extent: [usize; 2],
        channels: usize,
        slices: std::ops::Range<usize>,
        part: &Part,
        by_blocks: bool,
        into: &mut [T],
    ) {
        let [rows, across] = [part.rows.len(), self.tiles[1]];
        let tiles = slices.len() * rows * across;
        let line = extent[1] * channels;
        let into = Shared::new(into);
        let slice = extent[0] * line;
        let side = if step == Step::Input { 4 } else { 2 };
        (0..slices.len() * rows).into_par_iter().with_min_len(2).for_each(|number| {
            let from = (slices.start + number / rows) * slice + (part.rows.start + number % rows) * 2 * line;
            let pixels = &pixels[from..from + side * line];
            let place = tiles * channels;
            let to_next = if by_blocks { BLOCK } else { channels };
            let to_block = if by_blocks { tiles * BLOCK } else { BLOCK };
            let reach = (channels / BLOCK - 1) * to_block + (across - 1) * to_next + BLOCK;
            let to = into.at(number * across * to_next, (PLACES - 1) * place + reach);
            let transform = Transform {
                step,
                from: Square { at: pixels.as_ptr(), row: line, column: channels },
                to: Square { at: to, row: 4 * place, column: place },
                channels,
                to_block,
                count: across,
                from_next: 2 * channels,
                to_next,
            };
            // SAFETY: the best path is available. `side` lines of pixels and the last place were checked to be there, and
            // each row of tiles is written by one thread.
            unsafe { T::dispatch(Path::best(), transform) };
        });
    }

    /// The transformed weight: for each tap along the depth and each place `[blocks, source channels, 16]`, in blocks of
    /// channels of the result.
    /// `weight(source, result, tap)` gives the first of nine numbers.
    fn weight<T: Real>(&self, weight: &[T], at: impl Fn(usize, usize, usize) -> usize + Sync, flip: bool) -> Vec<T> {
        let ([from, to], [_, row]) = (self.channels, self.padded);
        let taps = &self.walk.axes[0].taps;
        let mut transformed = buffer(taps.len() * PLACES * from * row);
        let shared = Shared::new(&mut transformed);
        (0..taps.len() * from.div_ceil(BLOCK)).into_par_iter().for_each(|number| {
            let (tap, block) = (number % taps.len(), number / taps.len() * BLOCK);
            let mut nine = [T::ZERO; 9 * BLOCK];
            for first in (0..to).step_by(BLOCK) {
                for k in block..from.min(block + BLOCK) {
                    for (i, m) in (first..to.min(first + BLOCK)).enumerate() {
                        let values = &weight[at(k, m, taps[tap].0)..][..9];
                        for j in 0..9 {
                            nine[if flip { 8 - j } else { j } * BLOCK + i] = values[j];
                        }
                    }
                    let place = from * row;
                    let offset = tap * PLACES * place + first * from + k * BLOCK;
                    let transform = Transform {
                        step: Step::Weight,
                        from: Square { at: nine.as_ptr(), row: 3 * BLOCK, column: BLOCK },
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

    /// Transforms the slices of the source that a part meets and that are not there yet. `kept` says which slice each place
    /// of the ring holds.
    fn fill<T: Real>(
        &self,
        part: &Part,
        pixels: &[T],
        by_blocks: bool,
        ring: &mut [T],
        kept: &mut [Option<(usize, usize)>],
    ) {
        let extent = self.source_extent();
        let length = ring.len() / kept.len();
        if self.walk.axes[0].taps.len() == 1 && self.slices > 1 {
            let slices = part.slices.start..part.slices.end;
            self.squares(Step::Input, pixels, [extent[1], extent[2]], self.padded[0], slices, part, by_blocks, ring);
            return;
        }
        for (_, slice) in self.met(part.slices.start) {
            let place = slice % kept.len();
            if kept[place] != Some((slice, part.rows.start)) {
                let into = &mut ring[place * length..][..length];
                let slices = slice..slice + 1;
                self.squares(
                    Step::Input,
                    pixels,
                    [extent[1], extent[2]],
                    self.padded[0],
                    slices,
                    part,
                    by_blocks,
                    into,
                );
                kept[place] = Some((slice, part.rows.start));
            }
        }
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
        let mut ring = buffer::<T>(self.span() * PLACES * self.most_tiles() * from_row);
        let mut products = buffer::<T>(PLACES * self.most_tiles() * to_row);
        let mut kept = vec![None; self.span()];
        for part in self.parts() {
            self.fill(&part, &pixels, false, &mut ring, &mut kept);
            let tiles = part.slices.len() * part.rows.len() * self.tiles[1];
            let (ring, kept) = (&ring, kept.len());
            let met: Vec<_> = if self.slices > 1 { vec![(0, 0)] } else { self.met(part.slices.start).collect() };
            let all = &mut products[..PLACES * tiles * to_row];
            all.par_chunks_mut(tiles * to_row).with_max_len(1).enumerate().for_each(|(place, product)| {
                if met.is_empty() {
                    product.fill(T::ZERO);
                }
                for (number, (tap, slice)) in met.iter().enumerate() {
                    let left = &ring[slice % kept * (ring.len() / kept) + place * tiles * from_row..];
                    let right = &weight[(tap * PLACES + place) * from * to_row..];
                    let gemm = Gemm::new([tiles, from, to]);
                    let gemm = if number > 0 { gemm.accumulate() } else { gemm };
                    let (left, right) = (Strided::lines(left, from_row), Blocks { values: right, depth: from });
                    gemm.run(&left, &right, Out::rows(product, to_row), Par::Sequential);
                }
            });
            self.put(&part, &products, tiles, bias, &Shared::new(&mut result));
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
                    let line = &lines[(h - first) * 2 * across * row..][..2 * across * row];
                    for block in (0..to).step_by(BLOCK) {
                        for m in block..to.min(block + BLOCK) {
                            let bias = bias.map_or(T::ZERO, |bias| bias[m]);
                            let to = result.at((((image * to + m) * depth + d) * height + h) * width, width);
                            for w in 0..width {
                                // SAFETY: the row was checked to be there, and is written by one thread.
                                unsafe { *to.add(w) = line[w * row + m] + bias };
                            }
                        }
                    }
                }
            },
        );
    }

    /// The weight `[result channels, source channels, depth, 3, 3]` of source and result.
    pub(super) fn weights<T: Real>(&self, source: &[T], result: &[T]) -> Vec<T> {
        let ([from, to], [from_row, to_row]) = (self.channels, self.padded);
        let extent = [self.walk.result[0], 2 * self.tiles[0], 2 * self.tiles[1]];
        let window = Window { size: self.walk.result, before: [0; 3], extent };
        let (pixels, slopes) = (self.source(source), channels_last(result, to, &window, to_row));
        let taps = self.walk.axes[0].taps.len();
        let mut ring = buffer::<T>(self.span() * PLACES * self.most_tiles() * from_row);
        let mut turned = buffer::<T>(PLACES * self.most_tiles() * to_row);
        let mut kept = vec![None; self.span()];
        let mut sums = buffer::<T>(PLACES * taps * to * from_row);
        sums.par_chunks_mut(to * from_row).for_each(|sums| sums.fill(T::ZERO));
        for part in self.parts() {
            self.fill(&part, &pixels, true, &mut ring, &mut kept);
            let slices = part.slices.clone();
            self.squares(Step::OutputSlope, &slopes, [extent[1], extent[2]], to_row, slices, &part, true, &mut turned);
            let tiles = part.slices.len() * part.rows.len() * self.tiles[1];
            let (ring, turned, kept) = (&ring, &turned, kept.len());
            let met: Vec<_> = if self.slices > 1 { vec![(0, 0)] } else { self.met(part.slices.start).collect() };
            sums.par_chunks_mut(taps * to * from_row).with_max_len(1).enumerate().for_each(|(place, sums)| {
                for (tap, slice) in &met {
                    let left = &turned[place * tiles * to_row..];
                    let right = &ring[slice % kept * (ring.len() / kept) + place * tiles * from_row..];
                    let sums = &mut sums[tap * to * from_row..][..to * from_row];
                    let (left, right) = (Blocks { values: left, depth: tiles }, Blocks { values: right, depth: tiles });
                    let gemm = Gemm::new([to, tiles, from]).accumulate();
                    gemm.run(&left, &right, Out::rows(sums, from_row), Par::Sequential);
                }
            });
        }
        let mut weight = buffer::<T>(to * from * taps * 9);
        weight.par_chunks_mut(from * taps * 9).enumerate().for_each(|(m, weight)| {
            let mut nine = [T::ZERO; 9 * BLOCK];
            for tap in 0..taps {
                for first in (0..from).step_by(BLOCK) {
                    let place = taps * to * from_row;
                    let sums = &sums[(tap * to + m) * from_row + first..];
                    assert!(sums.len() >= (PLACES - 1) * place + BLOCK, "within the sums");
                    let transform = Transform {
                        step: Step::WeightSlope,
                        from: Square { at: sums.as_ptr(), row: 4 * place, column: place },
                        to: Square { at: nine.as_mut_ptr(), row: 3 * BLOCK, column: BLOCK },
                        channels: BLOCK,
                        to_block: 0,
                        count: 1,
                        from_next: 0,
                        to_next: 0,
                    };
                    // SAFETY: the best path is available; all sums and nine vectors are there.
                    unsafe { T::dispatch(Path::best(), transform) };
                    for (i, c) in (first..from.min(first + BLOCK)).enumerate() {
                        let weight = &mut weight[(c * taps + self.walk.axes[0].taps[tap].0) * 9..][..9];
                        for j in 0..9 {
                            weight[j] = nine[j * BLOCK + i];
                        }
                    }
                }
            }
        });
        weight
    }
}
