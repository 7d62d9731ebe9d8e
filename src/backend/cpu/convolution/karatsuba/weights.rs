//! The weight turned into the factors of the products, and slopes of those turned back.

use rayon::prelude::*;

use super::Plan;
use super::axis::TAPS;
use crate::backend::cpu::convolution::layout::Turn;
use crate::backend::cpu::{Places, Temporary, buffer, vectorised};
use crate::scalar::Real;

/// Channels that go through together.
const BLOCK: usize = 16;
/// Taps of a kernel.
const VOLUME: usize = 27;

impl Plan {
    /// For each product, in the order in which they are kept, its taps.
    fn taps(&self) -> Vec<Vec<usize>> {
        let of = |[d, h, w]: [usize; 3]| {
            let pairs = TAPS[d].iter().flat_map(move |d| TAPS[h].iter().map(move |h| 3 * d + h));
            pairs.flat_map(|pair| TAPS[w].iter().map(move |w| 3 * pair + w)).collect()
        };
        self.parts.iter().copied().map(of).collect()
    }

    /// The factors `[products, large channels, small channels]`, the last rounded up to whole vectors, of a weight
    /// `[small channels, large channels, taps]`.
    pub(super) fn factors<T: Real>(&self, weight: &[T]) -> Temporary<T> {
        let ([small, large], row) = (self.channels, self.row);
        let taps = self.taps();
        let mut factors = Temporary::new(taps.len() * large * row);
        let to = Places::of(&mut factors);
        (0..large).into_par_iter().with_min_len(4).for_each(|l| {
            for first in (0..small).step_by(BLOCK) {
                let mut turned = [[T::ZERO; BLOCK]; VOLUME];
                let extent = [BLOCK.min(small - first), VOLUME];
                let from = weight[(first * large + l) * VOLUME..].as_ptr();
                let (from_row, into) = (large * VOLUME, turned.as_mut_ptr().cast());
                assert!(((first + extent[0] - 1) * large + l + 1) * VOLUME <= weight.len(), "within the weight");
                vectorised(Turn { from, from_row, to: into, to_row: BLOCK, extent });
                for (product, taps) in taps.iter().enumerate() {
                    let mut sum = [T::ZERO; BLOCK];
                    for &tap in taps {
                        sum.iter_mut().zip(&turned[tap]).for_each(|(sum, value)| *sum += *value);
                    }
                    // SAFETY: a block lies within the factors, and is one thread's.
                    unsafe { to.part((product * large + l) * row + first, BLOCK) }.copy_from_slice(&sum);
                }
            }
        });
        factors
    }

    /// The weight's slopes of the factors' ones.
    pub(super) fn slopes<T: Real>(&self, factors: &[T]) -> Vec<T> {
        let ([small, large], row) = (self.channels, self.row);
        let mut products = vec![Vec::new(); VOLUME];
        self.taps().iter().enumerate().for_each(|(i, taps)| taps.iter().for_each(|&tap| products[tap].push(i)));
        let mut weight = buffer(small * large * VOLUME);
        let to = Places::of(&mut weight);
        (0..large).into_par_iter().with_min_len(4).for_each(|l| {
            for first in (0..small).step_by(BLOCK) {
                let mut sums = [[T::ZERO; BLOCK]; VOLUME];
                for (sum, products) in sums.iter_mut().zip(&products) {
                    for product in products {
                        let from = &factors[(product * large + l) * row + first..][..BLOCK];
                        sum.iter_mut().zip(from).for_each(|(sum, value)| *sum += *value);
                    }
                }
                for (i, s) in (first..small.min(first + BLOCK)).enumerate() {
                    // SAFETY: the taps of two channels lie within the weight, and are one thread's.
                    let weight = unsafe { to.part((s * large + l) * VOLUME, VOLUME) };
                    weight.iter_mut().zip(&sums).for_each(|(weight, sum)| *weight = sum[i]);
                }
            }
        });
        weight
    }
}
