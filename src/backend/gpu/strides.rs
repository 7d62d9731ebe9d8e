//! Axes as kernels walk them: sizes and steps, with neighbours merged.

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
        let step = |(at, rest): (usize, usize), (size, step): &(usize, usize)| (at + rest % size * step, rest / size);
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

    /// Copies the elements at `start` plus these steps into a new tensor.
    pub(crate) fn gather(&self, gpu: &Gpu, op: &str, x: &Tensor, start: usize, result: Spec) -> Result<Tensor> {
        let len = result.shape.len();
        let mut parameters = words([len, start, self.rank(), 0]).to_vec();
        parameters.extend(self.words(op)?);
        gpu.launch(&STRIDED, &[x], &parameters, result, Work::Invocations(len))
    }
}

/// Sizes as the 32-bit words of a parameter struct. A tensor on a GPU has fewer than 2^32 elements: its bytes fit one
/// binding.
#[allow(clippy::cast_possible_truncation)]
pub(crate) fn words<const N: usize>(sizes: [usize; N]) -> [u32; N] {
    sizes.map(|size| size as u32)
}

#[cfg(test)]
mod tests {
    use super::Strides;

    #[test]
    fn contiguous_axes_merge() {
        assert_eq!(Strides::new([(2, 12), (3, 4), (4, 1)]), Strides::new([(24, 1)]));
        assert_eq!(Strides::new([(2, 12), (1, 7), (3, 1)]).rank(), 2);
        assert_eq!(Strides::new([(2, 0), (3, 0), (4, 1)]), Strides(vec![(6, 0), (4, 1)]));
        assert_eq!(Strides::new([]).len(), 1);
    }
}
