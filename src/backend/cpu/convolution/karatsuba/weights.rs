//! The weight turned into the factors of the products, and slopes of those turned back.

use rayon::prelude::*;

use super::Plan;
use super::axis::TAPS;
use super::transform::WIDEST;
use crate::backend::cpu::convolution::layout::Turn;
use crate::backend::cpu::{Places, Temporary, buffer, vectorised};
use crate::scalar::Real;

/// Taps of a kernel.
const VOLUME: usize = 27;

impl<T: Real> Plan<T> {
    /// For each product, in the order in which they are kept, its taps.
    fn taps(&self) -> Vec<Vec<usize>> {
        let of = |[d, h, w]: [usize; 3]| {
            let pairs = TAPS[d].iter().flat_map(move |d| TAPS[h].iter().map(move |h| 3 * d + h));
            pairs.flat_map(|pair| TAPS[w].iter().map(move |w| 3 * pair + w)).collect()
        };
        self.parts.iter().copied().map(of).collect()
    }

    /// The factors of a weight `[small channels, large channels, taps]`.
    pub(super) fn factors_of(&self, weight: &[T]) -> Temporary<T> {
        let ([small, large], taps) = (self.channels, self.taps());
        let mut factors = Temporary::new(taps.len() * small * self.products.row);
        let (to, length) = (Places::of(&mut factors), large * VOLUME);
        weight.par_chunks(length).with_min_len(4).enumerate().for_each(|(s, weight)| {
            for first in (0..large).step_by(WIDEST) {
                let mut turned = [[T::ZERO; WIDEST]; VOLUME];
                let extent = [WIDEST.min(large - first), VOLUME];
                let (from, into) = (weight[first * VOLUME..].as_ptr(), turned.as_mut_ptr().cast());
                // SAFETY: the weight has `large` rows of taps from here on by the length of its part, and `turned` a vector for each tap.
                unsafe { vectorised(Turn { from, from_row: VOLUME, to: into, to_row: WIDEST, extent }) };
                for ([at, step], taps) in self.factors.iter().zip(&taps) {
                    let mut sum = [T::ZERO; WIDEST];
                    for &tap in taps {
                        sum.iter_mut().zip(&turned[tap]).for_each(|(sum, value)| *sum += *value);
                    }
                    // SAFETY: a vector lies within the factors, and is one thread's.
                    unsafe { to.part(at + s * step + first, WIDEST) }.copy_from_slice(&sum);
                }
            }
        });
        factors
    }

    /// The weight's slopes of the factors' ones.
    pub(super) fn slopes_of(&self, factors: &[T]) -> Vec<T> {
        let ([small, large], length) = (self.channels, self.channels[1] * VOLUME);
        let mut products = vec![Vec::new(); VOLUME];
        self.taps().iter().enumerate().for_each(|(i, taps)| taps.iter().for_each(|&tap| products[tap].push(i)));
        let mut weight = buffer(small * length);
        weight.par_chunks_mut(length).with_min_len(4).enumerate().for_each(|(s, weight)| {
            for first in (0..large).step_by(WIDEST) {
                let mut sums = [[T::ZERO; WIDEST]; VOLUME];
                for (sum, products) in sums.iter_mut().zip(&products) {
                    for &product in products {
                        let [at, step]: [usize; 2] = self.factors[product];
                        let from = &factors[at + s * step + first..][..WIDEST];
                        sum.iter_mut().zip(from).for_each(|(sum, value)| *sum += *value);
                    }
                }
                let extent = [VOLUME, WIDEST.min(large - first)];
                let (from, to) = (sums.as_ptr().cast(), weight[first * VOLUME..].as_mut_ptr());
                // SAFETY: `sums` has a vector for each tap, and the weight as many rows of taps as the extent says.
                unsafe { vectorised(Turn { from, from_row: WIDEST, to, to_row: VOLUME, extent }) };
            }
        });
        weight
    }
}
