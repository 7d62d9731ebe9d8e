//! The gradient in the weight: the steps of the convolution transposed.

use rayon::prelude::*;

use super::blocks::Blocks;
use super::squares::{Ring, Squares};
use super::transform::{BLOCK, Square, Step, Transform};
use super::{PLACES, Plan};
use crate::backend::cpu::convolution::layout::{Window, channels_last};
use crate::backend::cpu::gemm::{Gemm, Out, Par};
use crate::backend::cpu::{Temporary, buffer};
use crate::scalar::{Path, Real};

impl Plan<'_> {
    /// For each tap along the depth, in order, the slice of the result that meets a slice of the source there.
    fn met_by(&self, slice: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let (depth, axis) = (self.walk.result[0], &self.walk.axes[0]);
        let (image, place) = (slice / axis.source, slice % axis.source);
        axis.taps.iter().enumerate().filter_map(move |(tap, (_, offset))| {
            let at = (place + axis.before).checked_sub(*offset).filter(|&at| at < depth)?;
            Some((tap, image * depth + at))
        })
    }

    /// The weight `[result channels, source channels, depth, 3, 3]` of source and result.
    pub(in super::super) fn weights<T: Real>(&self, source: &[T], result: &[T]) -> Vec<T> {
        let ([from, to], [from_row, to_row]) = (self.channels, self.padded);
        let (across, taps) = (self.tiles[1], self.walk.axes[0].taps.len());
        let extent = [self.walk.result[0], 2 * self.tiles[0], 2 * self.tiles[1]];
        let window = Window { size: self.walk.result, before: [0; 3], extent };
        let (pixels, slopes) = (self.source(source), channels_last(result, to, &window, to_row));
        let pixels = self.pixels(&pixels, true);
        let slopes = Squares {
            step: Step::OutputSlope,
            pixels: &slopes,
            extent: [extent[1], extent[2]],
            channels: to_row,
            across,
            by_blocks: true,
        };
        let mut images = Ring::new(if self.merged { 1 } else { self.slices }, self.ring_tiles(), from_row);
        let mut results = Ring::new(self.span(), self.ring_tiles(), to_row);
        let mut sums = Temporary::<T>::new(PLACES * taps * to * from_row);
        sums.par_chunks_mut(to * from_row).for_each(|sums| sums.fill(T::ZERO));
        // each slice of the source is packed once, and meets all its slices of the result
        for part in self.parts(self.walk.axes[0].source) {
            // slices of the source, and the taps and slices of the result that they meet
            let met: Vec<(usize, Vec<_>)> = match self.merged {
                true => vec![(0, vec![(0, 0)])],
                false => part.slices.clone().map(|slice| (slice, self.met_by(slice).collect())).collect(),
            };
            let tiles = if self.merged { part.slices.len() } else { 1 } * part.rows.len() * across;
            if self.merged {
                images.fill_all(&pixels, &part.slices, &part.rows);
                results.fill_all(&slopes, &part.slices, &part.rows);
            } else {
                images.fill(&pixels, met.iter().map(|(slice, _)| *slice), &part.rows);
                results.fill(&slopes, met.iter().flat_map(|(_, met)| met).map(|(_, slice)| *slice), &part.rows);
            }
            let (images, results) = (&images, &results);
            sums.par_chunks_mut(taps * to * from_row).with_max_len(1).enumerate().for_each(|(place, sums)| {
                for (image, met) in &met {
                    let left: Vec<_> =
                        met.iter().map(|(_, slice)| &results.slice(*slice)[place * tiles * to_row..]).collect();
                    let Some((first, _)) = met.first() else { continue };
                    let left = Blocks { parts: &left, lines: to, depth: tiles };
                    let right = [&images.slice(*image)[place * tiles * from_row..]];
                    let right = Blocks { parts: &right, lines: from, depth: tiles };
                    let gemm = Gemm::new([met.len() * to, tiles, from]).accumulate();
                    gemm.run(&left, &right, Out::rows(&mut sums[first * to * from_row..], from_row), Par::Sequential);
                }
            });
        }
        self.turn_back(&sums)
    }

    /// Turns sums `[places, taps, result channels, source channels]` into the weight.
    fn turn_back<T: Real>(&self, sums: &[T]) -> Vec<T> {
        let ([from, to], from_row) = (self.channels, self.padded[0]);
        let taps = self.walk.axes[0].taps.len();
        let mut weight = buffer::<T>(to * from * taps * 9);
        weight.par_chunks_mut(from * taps * 9).enumerate().for_each(|(m, weight)| {
            let mut nine = [[T::ZERO; BLOCK]; 9];
            for (tap, (number, _)) in self.walk.axes[0].taps.iter().enumerate() {
                for first in (0..from).step_by(BLOCK) {
                    let place = taps * to * from_row;
                    let sums = &sums[(tap * to + m) * from_row + first..];
                    assert!(sums.len() >= (PLACES - 1) * place + BLOCK, "within the sums");
                    let transform = Transform {
                        step: Step::WeightSlope,
                        from: Square { at: sums.as_ptr(), row: 4 * place, column: place },
                        to: Square { at: nine.as_mut_ptr().cast(), row: 3 * BLOCK, column: BLOCK },
                        channels: BLOCK,
                        to_block: 0,
                        count: 1,
                        from_next: 0,
                        to_next: 0,
                    };
                    // SAFETY: the best path is available; all sums and nine vectors are there.
                    unsafe { T::dispatch(Path::best(), transform) };
                    for (i, c) in (first..from.min(first + BLOCK)).enumerate() {
                        let weight = &mut weight[(c * taps + number) * 9..][..9];
                        for j in 0..9 {
                            weight[j] = nine[j][i % BLOCK];
                        }
                    }
                }
            }
        });
        weight
    }
}
