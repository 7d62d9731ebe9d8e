//! Tensors that do not fit one binding, a window at a time.
//!
//! A kernel that copies elements is run once for each window of what it writes and each window of what it reads, and
//! writes those elements whose source it sees. Every element has one source, so that each is written once.

use std::ops::Range;

use crate::Tensor;
use crate::backend::gpu::{Gpu, GpuBuffer};

impl Gpu {
    /// Windows that hold the elements `range` of a tensor, at least one: the number of its first element, and the window.
    /// What fits one binding is its own window.
    pub(crate) fn windows(&self, x: &Tensor, range: Range<usize>) -> Vec<(usize, Tensor)> {
        let most = self.part_len();
        if x.len() <= most {
            return vec![(0, x.clone())];
        }
        let aligned = GpuBuffer::ALIGNMENT / x.dtype().size();
        let first = range.start.min(x.len() - 1) / aligned * aligned;
        let end = range.end.clamp(first + 1, x.len());
        (first..end).step_by(most).map(|begin| (begin, x.gpu_part(begin, [most.min(x.len() - begin)]))).collect()
    }
}
