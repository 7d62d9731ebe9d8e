//! How values of a grid at points change with the points.

use rayon::prelude::*;

use super::{Cells, by_blocks};
use crate::backend::cpu::{Work, buffer, widest};
use crate::ops::grid::Extent;
use crate::scalar::Real;

/// `∂/∂x_p Σ_c s_pc · sample(values, x_p)_c` for points `[batch, count, D]`, values `[batch, nodes, channels]` and
/// samples `s`, `[batch, count, channels]`.
pub(super) fn run<T: Real, const D: usize, const K: usize>(
    cells: &Cells<T, D, K>,
    extent: Extent,
    values: &[T],
    points: &[T],
    samples: &[T],
) -> Vec<T> {
    let Extent { channels, nodes, count, .. } = extent;
    let mut slopes = buffer(points.len());
    let part = 16384usize.div_ceil(channels.max(1)).max(64);
    for (b, slopes) in slopes.chunks_mut((count * D).max(1)).enumerate() {
        let values = &values[b * nodes * channels..][..nodes * channels];
        slopes.par_chunks_mut(part * D).enumerate().for_each(|(i, out)| {
            let first = b * count + i * part;
            let end = first + out.len() / D;
            let (points, samples) = (&points[first * D..end * D], &samples[first * channels..end * channels]);
            widest(Slope { cells, values, points, samples, channels, out });
        });
    }
    slopes
}

struct Slope<'a, T, const D: usize, const K: usize> {
    cells: &'a Cells<T, D, K>,
    values: &'a [T],
    points: &'a [T],
    samples: &'a [T],
    channels: usize,
    out: &'a mut [T],
}

impl<T: Real, const D: usize, const K: usize> Work for Slope<'_, T, D, K> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { cells, values, points, samples, channels, out } = self;
        for p in 0..points.len() / D {
            let out = &mut out[p * D..][..D];
            for o in &mut *out {
                *o = T::ZERO;
            }
            let Some((mut offsets, slopes)) = cells.slopes(&points[p * D..][..D]) else { continue };
            for offset in &mut offsets {
                *offset *= channels;
                assert!(*offset + channels <= values.len(), "the nodes of a cell lie in the grid");
            }
            let sample = samples[p * channels..][..channels].as_ptr();
            let values = values.as_ptr();
            let mut dots = [T::ZERO; K];
            // SAFETY: `channels` numbers can be read from each node and from the sample.
            unsafe { by_blocks!(channels, i => block(values.add(i), &offsets, sample.add(i), &mut dots)) }
            for corner in 0..K {
                for along in 0..D {
                    out[along] += slopes[corner][along] * dots[corner];
                }
            }
        }
    }
}

/// Adds the products of `W` channels of each node and of the sample.
///
/// # Safety
/// `W` numbers must be readable at every offset and at `sample`.
#[inline(always)]
unsafe fn block<T: Real, const W: usize, const K: usize>(
    values: *const T,
    offsets: &[usize; K],
    sample: *const T,
    dots: &mut [T; K],
) {
    // SAFETY: the caller's promise.
    let sample = unsafe { sample.cast::<[T; W]>().read_unaligned() };
    for corner in 0..K {
        // SAFETY: the caller's promise.
        let mut products = unsafe { values.add(offsets[corner]).cast::<[T; W]>().read_unaligned() };
        for i in 0..W {
            products[i] *= sample[i];
        }
        // halves are added up, so that the vector stays one
        let mut width = W;
        while width > 1 {
            width /= 2;
            for i in 0..width {
                products[i] += products[i + width];
            }
        }
        dots[corner] += products[0];
    }
}
