//! Memory that a kernel needs while it runs.

use std::ops::{Deref, DerefMut};

use bytemuck::Pod;

use super::pool;

/// A buffer that goes back to the pool when it is dropped. What it holds at first is unspecified.
pub(crate) struct Temporary<T: Pod>(Vec<T>);

impl<T: Pod> Temporary<T> {
    /// A buffer of `len` elements.
    pub(crate) fn new(len: usize) -> Self {
        Self(pool::take(len))
    }
}

impl<T: Pod> Deref for Temporary<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.0
    }
}

impl<T: Pod> DerefMut for Temporary<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.0
    }
}

impl<T: Pod> Drop for Temporary<T> {
    fn drop(&mut self) {
        pool::give(std::mem::take(&mut self.0));
    }
}
