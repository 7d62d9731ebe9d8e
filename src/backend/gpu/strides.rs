//! Axes as kernels walk them: sizes and steps, with neighbours merged.

use std::ops::Range;

use crate::backend::gpu::{Gpu, Kernel, Work};
use crate::{Error, ErrorKind, Result, Spec, Tensor};

/// The kernel of every op that copies elements from places at regular steps.
pub(crate) static STRIDED: Kernel =
    Kernel::new("strided", "main", include_str!("../../../kernels/strided.wgsl"), &["y", "x"]);

/// Axes that the arrays of `kernels/strided.wgsl` and `kernels/sum.wgsl` hold.
const MOST: usize = 8;

/// Some axes, outermost first, with their distances in elements between neighbours. A distance may be negative: steps
/// are added modulo the word size, on both backends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Strides(Vec<(usize, usize)>);

impl Strides {
    /// Axes of these sizes and steps. Those of size 1 are dropped, and neighbours that a single walk passes are merged.
    pub(crate) fn new(axes: impl IntoIterator<Item = (usize, usize)>) -> Self {
        let mut merged: Vec<(usize, usize)> = Vec::new();
        for (size, step) in axes.into_iter().filter(|(size, _)| *size != 1) {
            match merged.last_mut() {
                Some((outer, outer_step)) if *outer_step == size.wrapping_mul(step) => {
                    (*outer, *outer_step) = (*outer * size, step)
                }
                _ => merged.push((size, step)),
            }
        }
        Self(merged)
    }

    /// Number of places.
    pub(crate) fn len(&self) -> usize {
        self.0.iter().map(|(size, _)| size).product()
    }

    /// The distance to the place with this number, in row-major order.
    pub(crate) fn place(&self, number: usize) -> usize {
        let step = |(at, rest): (usize, usize), (size, step): &(usize, usize)| {
            (at.wrapping_add((rest % size).wrapping_mul(*step)), rest / size)
        };
        self.0.iter().rev().fold((0, number), step).0
    }

    /// Number of axes that are left.
    pub(crate) fn rank(&self) -> usize {
        self.0.len()
    }

    /// Sizes and steps, outermost first.
    pub(crate) fn axes(&self) -> &[(usize, usize)] {
        &self.0
    }

    /// The words of the kernel's array of axes.
    pub(crate) fn words(&self, op: &str) -> Result<Vec<u32>> {
        if self.rank() > MOST {
            return Err(Error::new(ErrorKind::Unsupported, format!("{op}: too many axes for its WGSL kernel"))
                .found(format!("{} axes that cannot be merged", self.rank()))
                .wanted(format!("at most {MOST}"))
                .fix("reshape, or move the operand to the CPU with to_device(&Device::Cpu)"));
        }
        let mut words = vec![0; 4 * MOST];
        for (axis, (size, step)) in self.0.iter().enumerate() {
            words[4 * axis..][..2].copy_from_slice(&crate::backend::gpu::words([*size, *step]));
        }
        Ok(words)
    }

    /// Copies the elements at `start` plus these steps into a new tensor, by windows where they do not fit one binding.
    pub(crate) fn gather(&self, gpu: &Gpu, op: &str, x: &Tensor, start: usize, result: Spec) -> Result<Tensor> {
        let axes = self.words(op)?;
        let y = gpu.empty(result)?;
        for (first, to) in gpu.windows(&y, 0..y.len()) {
            for (begin, from) in gpu.windows(x, self.bounds(start, first, to.len())) {
                let start = start.wrapping_sub(begin);
                let mut parameters = words([to.len(), start, self.rank(), first]).to_vec();
                parameters.extend_from_slice(&axes);
                gpu.dispatch(&STRIDED, &[&to, &from], &parameters, Work::Invocations(to.len()))?;
            }
        }
        Ok(y)
    }

    /// As [`Strides::bounds`] from place 0 on, when any place of `behind` is added. No step is negative.
    pub(crate) fn bounds_with(&self, behind: &Self, first: usize, count: usize) -> Range<usize> {
        let bounds = self.bounds(0, first, count);
        bounds.start..bounds.end + behind.bounds(0, 0, behind.len()).end - 1
    }

    /// From the least to the largest place among `count` of them from the number `first` on; `start` is where number 0 is.
    pub(crate) fn bounds(&self, start: usize, first: usize, count: usize) -> Range<usize> {
        let (mut low, mut high) = (start as isize, start as isize);
        let (mut first, mut last) = (first, first + count.max(1) - 1);
        let (mut inner, mut bounds) = (self.len(), Vec::with_capacity(self.rank()));
        // an axis runs over all of its indices once one further out takes two
        let mut whole = false;
        for (size, step) in &self.0 {
            inner /= size.max(&1);
            let (a, b) = if whole { (0, size - 1) } else { (first / inner.max(1), last / inner.max(1)) };
            whole |= a != b;
            (first, last) = (first % inner.max(1), last % inner.max(1));
            bounds.push((a as isize * *step as isize, b as isize * *step as isize));
        }
        for (a, b) in bounds {
            (low, high) = (low + a.min(b), high + a.max(b));
        }
        low as usize..high as usize + 1
    }
}

/// Sizes as the 32-bit words of a parameter struct. A tensor on a GPU has fewer than 2^32 elements:
/// [`GpuLimits`](crate::backend::gpu::GpuLimits) sees to it.
#[allow(clippy::cast_possible_truncation)]
pub(crate) fn words<const N: usize>(sizes: [usize; N]) -> [u32; N] {
    sizes.map(|size| size as u32)
}

#[cfg(test)]
mod tests {
    use super::Strides;

    #[test]
    fn bounds_hold_every_place() {
        let walks = [
            Strides(vec![(3, 40), (4, 1)]),
            Strides(vec![(4, 1), (3, 40)]),
            Strides(vec![(5, 0), (6, 1)]),
            Strides(vec![(5, 1usize.wrapping_neg())]),
            Strides(vec![(2, 7), (3, 50), (4, 1usize.wrapping_neg())]),
            Strides(vec![]),
        ];
        for walk in walks {
            let places: Vec<usize> = (0..walk.len()).map(|n| 1000usize.wrapping_add(walk.place(n))).collect();
            for first in 0..walk.len() {
                for count in 1..=walk.len() - first {
                    let within = &places[first..first + count];
                    let bounds = walk.bounds(1000, first, count);
                    assert!(within.iter().all(|place| bounds.contains(place)), "{walk:?} {first} {count}");
                    let ends = places.contains(&bounds.start) && places.contains(&(bounds.end - 1));
                    assert!(ends, "{walk:?} {first} {count}");
                }
            }
        }
    }

    #[test]
    fn contiguous_axes_merge() {
        assert_eq!(Strides::new([(2, 12), (3, 4), (4, 1)]), Strides::new([(24, 1)]));
        assert_eq!(Strides::new([(2, 12), (1, 7), (3, 1)]).rank(), 2);
        assert_eq!(Strides::new([(2, 0), (3, 0), (4, 1)]), Strides(vec![(6, 0), (4, 1)]));
        assert_eq!(Strides::new([]).len(), 1);
    }
}
