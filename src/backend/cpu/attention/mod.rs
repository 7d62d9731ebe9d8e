//! Scaled-dot-product attention without the matrix of scores.
//!
//! Queries lie along vectors: a block of 64 queries is transposed once, and then every step works on panels of rows of 64
//! queries, one row for each key or channel. Maxima, sums and rescaling of the online softmax are vertical, and any number
//! of channels is as good as any other. A key block's panel of scores stays in the cache.
//!
//! The forward pass keeps the logarithm of each query's sum of exponentials; the backward pass recomputes the weights from
//! it (Dao et al., "FlashAttention", 2022). Blocks depend on shapes alone, and so do the results' bits.

mod backward;
mod forward;
mod product;

pub(crate) use backward::backward;
pub(crate) use forward::forward;

use std::ops::{Deref, DerefMut};

use crate::scalar::Real;

/// Queries of a block.
const QUERIES: usize = 64;
/// Keys of a block: a multiple of the six rows of a tile.
const KEYS: usize = 96;

/// Numbers that begin at a cache line, so that no vector lies across two.
struct Panel<T> {
    values: Vec<T>,
    start: usize,
}

impl<T: Real> Panel<T> {
    /// Zeros.
    fn new(len: usize) -> Self {
        let values = vec![T::ZERO; len + 64 / size_of::<T>()];
        let start = values.as_ptr().align_offset(64);
        Self { values, start }
    }
}

impl<T> Deref for Panel<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values[self.start..]
    }
}

impl<T> DerefMut for Panel<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[self.start..]
    }
}

/// The operands: `heads` independent problems, one after the other.
pub(crate) struct Heads<'a, T> {
    /// `[heads, queries, channels]`
    pub q: &'a [T],
    /// `[heads, keys, channels]`
    pub k: &'a [T],
    /// `[heads, keys, values]`
    pub v: &'a [T],
    /// What is added to the scaled scores.
    pub mask: Option<Mask<'a, T>>,
    pub scale: T,
    pub heads: usize,
    pub queries: usize,
    pub keys: usize,
    /// Channels of queries and keys.
    pub channels: usize,
    /// Channels of values and of the result.
    pub values: usize,
}

/// An additive mask: `(head, query, key)` lies at `starts[head] + query · query_step + key · key_step`.
pub(crate) struct Mask<'a, T> {
    pub values: &'a [T],
    pub starts: Vec<usize>,
    pub query_step: usize,
    pub key_step: usize,
}

impl<T: Real> Heads<'_, T> {
    /// Adds the mask to a panel of scores that starts at these places.
    fn add_mask(&self, scores: &mut [T], head: usize, query: usize, queries: usize, key: usize) {
        let Some(mask) = &self.mask else { return };
        let start = mask.starts[head] + query * mask.query_step + key * mask.key_step;
        for (row, scores) in scores.chunks_mut(QUERIES).enumerate() {
            for (column, score) in scores[..queries].iter_mut().enumerate() {
                *score += mask.values[start + column * mask.query_step + row * mask.key_step];
            }
        }
    }
}

/// Transposes rows of `channels` numbers into columns of a panel, times `factor`; columns beyond the rows become 0.
fn transpose<T: Real>(rows: &[T], channels: usize, factor: T, panel: &mut [T]) {
    let count = rows.len() / channels;
    for (channel, panel) in panel.chunks_mut(QUERIES).take(channels).enumerate() {
        for (i, column) in panel[..count].iter_mut().enumerate() {
            *column = rows[i * channels + channel] * factor;
        }
        panel[count..].fill(T::ZERO);
    }
}
