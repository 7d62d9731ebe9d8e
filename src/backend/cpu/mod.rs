//! The CPU backend: fixed work chunks over rayon's threads, so that results do not depend on the thread count.

pub(crate) mod attention;
pub(crate) mod convolution;
pub(crate) mod depth_attention;
pub(crate) mod gemm;
pub(crate) mod grid;
pub(crate) mod mlp;
pub(crate) mod normalise;
mod partition;
pub mod pool;
mod prefetch;
pub(crate) mod rays;
pub(crate) mod reduce;
pub(crate) mod rows;
pub(crate) mod scan;
pub(crate) mod softmax;
pub(crate) mod strided;
mod temporary;
mod widest;

use bytemuck::Pod;
use rayon::prelude::*;

pub(crate) use partition::{Bins, partition};
pub(crate) use strided::Places;
pub(crate) use temporary::Temporary;
pub(crate) use widest::{Work, vectorised, widest};

/// Elements per work item of a pointwise loop: large enough to hide scheduling, small enough to stay in cache.
pub(crate) const CHUNK: usize = 1 << 14;

/// A vector of `len` numbers for a result. What it holds at first is unspecified: write every element.
pub(crate) fn buffer<T: Pod>(len: usize) -> Vec<T> {
    pool::take(len)
}

/// Fills a vector of `len` by chunks in parallel; `fill(start, chunk)` writes the elements from `start` on.
pub(crate) fn filled<T: Pod + Send>(len: usize, chunk: usize, fill: impl Fn(usize, &mut [T]) + Sync) -> Vec<T> {
    let mut values = buffer(len);
    if len <= chunk {
        fill(0, &mut values);
    } else {
        values.par_chunks_mut(chunk).enumerate().for_each(|(i, part)| fill(i * chunk, part));
    }
    values
}
