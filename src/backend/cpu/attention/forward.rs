//! The forward pass: blocks of queries against all keys, with the softmax kept up to date block by block of keys.

// plain loops: iterator adaptors would lose the instruction set
#![allow(clippy::needless_range_loop)]

use rayon::prelude::*;

use super::product::{Left, Product, Start};
use super::{Heads, KEYS, Panel, QUERIES, transpose};
use crate::backend::cpu::{buffer, vectorised};
use crate::scalar::{Job, Lane, Real};

/// The result `[heads, queries, values]`, and for each query `ln Σ exp(score)`: +∞ where no key counts, so that weights
/// recomputed from it are 0.
pub(crate) fn forward<T: Real>(heads: &Heads<'_, T>) -> (Vec<T>, Vec<T>) {
    let mut result = buffer::<T>(heads.heads * heads.queries * heads.values);
    let mut log_sums = buffer::<T>(heads.heads * heads.queries);
    let mut blocks = Vec::new();
    let (mut results, mut sums) = (&mut result[..], &mut log_sums[..]);
    for head in 0..heads.heads {
        for first in (0..heads.queries).step_by(QUERIES) {
            let count = QUERIES.min(heads.queries - first);
            let (block, rest) = results.split_at_mut(count * heads.values);
            let (block_sums, rest_of_sums) = sums.split_at_mut(count);
            (results, sums) = (rest, rest_of_sums);
            blocks.push((head, first, block, block_sums));
        }
    }
    blocks.into_par_iter().for_each_init(
        || Scratch::new(heads),
        |scratch, (head, first, result, log_sums)| scratch.block(heads, head, first, result, log_sums),
    );
    (result, log_sums)
}

/// Panels of one block of queries; columns are queries.
struct Scratch<T> {
    queries: Panel<T>,
    scores: Panel<T>,
    results: Panel<T>,
    largest: [T; QUERIES],
    sums: [T; QUERIES],
    factors: [T; QUERIES],
}

impl<T: Real> Scratch<T> {
    fn new(heads: &Heads<'_, T>) -> Self {
        Self {
            queries: Panel::new(heads.channels * QUERIES),
            scores: Panel::new(KEYS * QUERIES),
            results: Panel::new(heads.values * QUERIES),
            largest: [T::ZERO; QUERIES],
            sums: [T::ZERO; QUERIES],
            factors: [T::ZERO; QUERIES],
        }
    }

    fn block(&mut self, heads: &Heads<'_, T>, head: usize, first: usize, result: &mut [T], log_sums: &mut [T]) {
        let &Heads { channels, values, .. } = heads;
        let count = log_sums.len();
        let rows = &heads.q[(head * heads.queries + first) * channels..][..count * channels];
        transpose(rows, channels, heads.scale, &mut self.queries);
        self.largest.fill(-T::INFINITY);
        self.sums.fill(T::ZERO);
        self.results.fill(T::ZERO);
        for key in (0..heads.keys).step_by(KEYS) {
            let keys = KEYS.min(heads.keys - key);
            let at = head * heads.keys + key;
            let left = &heads.k[at * channels..][..keys * channels];
            Product {
                rows: keys,
                depth: channels,
                columns: QUERIES,
                left: Left { values: left, row_step: channels, depth_step: 1 },
                right: &self.queries,
                result: &mut self.scores,
                start: Start::Zero,
            }
            .run();
            let scores = &mut self.scores[..keys * QUERIES];
            heads.add_mask(scores, head, first, count, key);
            let Self { largest, sums, factors, .. } = self;
            // SAFETY: the scores are whole rows of 64.
            unsafe { vectorised(Weights { scores, largest, sums, factors }) };
            let left = &heads.v[at * values..][..keys * values];
            Product {
                rows: values,
                depth: keys,
                columns: QUERIES,
                left: Left { values: left, row_step: 1, depth_step: values },
                right: &self.scores,
                result: &mut self.results,
                start: Start::Scaled(&self.factors),
            }
            .run();
        }
        for (i, (row, log_sum)) in result.chunks_mut(values).zip(log_sums).enumerate() {
            let sum = self.sums[i];
            let empty = sum == T::ZERO;
            let inverse = if empty { T::ZERO } else { T::ONE / sum };
            for (channel, out) in row.iter_mut().enumerate() {
                *out = self.results[channel * QUERIES + i] * inverse;
            }
            *log_sum = if empty { T::INFINITY } else { self.largest[i] + sum.ln() };
        }
    }
}

/// Scores of a key block into weights relative to the largest score so far; `factors` is what earlier sums shrink by.
struct Weights<'a, T> {
    scores: &'a mut [T],
    largest: &'a mut [T; QUERIES],
    sums: &'a mut [T; QUERIES],
    factors: &'a mut [T; QUERIES],
}

impl<T: Real> Job<T> for Weights<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        /// Vectors worked on at once, so that they hide each other's latency; 64 queries are a multiple of them.
        const GROUP: usize = 4;
        let keys = self.scores.len() / QUERIES;
        let mut column = 0;
        while column < QUERIES {
            // SAFETY: columns below 64 of arrays and rows of 64.
            unsafe {
                let scores = self.scores.as_mut_ptr().add(column);
                let mut largest = [V::splat(T::ZERO); GROUP];
                let mut shifts = largest;
                let mut sums = largest;
                for g in 0..GROUP {
                    largest[g] = V::load(self.largest.as_ptr().add(column + g * V::WIDTH));
                }
                for key in 0..keys {
                    for g in 0..GROUP {
                        // a NaN is passed over here and reappears in the sum
                        largest[g] = V::load(scores.add(key * QUERIES + g * V::WIDTH)).larger(largest[g]);
                    }
                }
                for g in 0..GROUP {
                    let at = column + g * V::WIDTH;
                    // −∞ − −∞ would be NaN where no key counts yet
                    shifts[g] = largest[g].le(V::splat(-T::INFINITY)).choose(V::splat(T::ZERO), largest[g]);
                    let factor = V::load(self.largest.as_ptr().add(at)).sub(shifts[g]).exp_of_negative();
                    factor.store(self.factors.as_mut_ptr().add(at));
                    sums[g] = V::load(self.sums.as_ptr().add(at)).mul(factor);
                    largest[g].store(self.largest.as_mut_ptr().add(at));
                }
                for key in 0..keys {
                    for g in 0..GROUP {
                        let score = scores.add(key * QUERIES + g * V::WIDTH);
                        let weight = V::load(score).sub(shifts[g]).exp_of_negative();
                        weight.store(score);
                        sums[g] = sums[g].add(weight);
                    }
                }
                for g in 0..GROUP {
                    sums[g].store(self.sums.as_mut_ptr().add(column + g * V::WIDTH));
                }
            }
            column += GROUP * V::WIDTH;
        }
    }
}
