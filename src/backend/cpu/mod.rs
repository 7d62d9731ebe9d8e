//! The CPU backend: fixed work chunks over rayon's threads, so that results do not depend on the thread count.

pub(crate) mod grid;
mod partition;
pub(crate) mod rays;
mod transpose;
mod widest;

use rayon::prelude::*;

pub(crate) use partition::{Bins, partition};
pub(crate) use transpose::transposed;
pub(crate) use widest::{Job, widest};

/// Elements per work item of a pointwise loop: large enough to hide scheduling, small enough to stay in cache.
pub(crate) const CHUNK: usize = 1 << 14;

/// A vector of `len` numbers for a result. What it holds at first is unspecified: write every element.
pub(crate) fn buffer<T: bytemuck::Zeroable + Clone>(len: usize) -> Vec<T> {
    vec![T::zeroed(); len]
}

/// Fills a vector of `len` by chunks in parallel; `fill(start, chunk)` writes the elements from `start` on.
pub(crate) fn filled<T: bytemuck::Zeroable + Clone + Send>(
    len: usize,
    chunk: usize,
    fill: impl Fn(usize, &mut [T]) + Sync,
) -> Vec<T> {
    let mut values = buffer(len);
    if len <= chunk {
        fill(0, &mut values);
    } else {
        values.par_chunks_mut(chunk).enumerate().for_each(|(i, part)| fill(i * chunk, part));
    }
    values
}

/// A vector that several threads write different elements of.
pub(crate) struct Shared<T> {
    start: *mut T,
    len: usize,
}

// SAFETY: elements are only written, each by one thread: the contract of `Shared::at`.
unsafe impl<T: Send> Sync for Shared<T> {}

impl<T> Shared<T> {
    /// The vector must outlive this and not be used meanwhile.
    pub(crate) fn new(values: &mut [T]) -> Self {
        Self { start: values.as_mut_ptr(), len: values.len() }
    }

    /// The elements from a place on.
    ///
    /// # Safety
    /// The vector must be alive, and no other thread may use the elements that are written through the pointer.
    #[inline(always)]
    pub(crate) unsafe fn at(&self, place: usize) -> *mut T {
        debug_assert!(place <= self.len, "place {place} of {}", self.len);
        // SAFETY: the place is inside or at the end.
        unsafe { self.start.add(place) }
    }

    /// Writes one element.
    ///
    /// # Safety
    /// As [`Shared::at`], and the place is below the length.
    #[inline(always)]
    pub(crate) unsafe fn write(&self, place: usize, value: T) {
        debug_assert!(place < self.len, "place {place} of {}", self.len);
        // SAFETY: the caller's promise.
        unsafe { self.at(place).write(value) };
    }
}
