//! A multilayer perceptron by blocks of rows that go through all layers while they are in the second-level cache.
//!
//! Nothing between the layers is kept: the gradients compute it again. Gradients of the weights are summed over the
//! blocks of a span, one after another, then over the spans in their order, so that they do not depend on the number of
//! threads.

mod gradients;

use rayon::prelude::*;

pub(crate) use gradients::gradients;

use super::buffer;
use super::gemm::{Activation, Gemm, Out, Par, Strided, scratch};
use crate::scalar::{Job, Lane, Real};

/// Rows that go through the layers together.
const BLOCK: usize = 256;

/// A layer `activation(x · wᵀ + b)`.
#[derive(Clone, Copy)]
pub(crate) struct Layer<'a, T> {
    /// `[out, in]`
    pub(crate) weight: &'a [T],
    /// `[out]`
    pub(crate) bias: &'a [T],
    pub(crate) activation: Activation,
    pub(crate) width_in: usize,
    pub(crate) width_out: usize,
}

impl<T: Real> Layer<'_, T> {
    /// Rows `[rows, in]` to `[rows, out]`.
    fn run(&self, x: &[T], y: &mut [T], rows: usize, activation: Activation) {
        let (width, out) = (self.width_in, self.width_out);
        Gemm::new([rows, width, out]).column_bias(Some(self.bias)).activation(activation).run(
            &Strided::lines(x, width),
            &Strided::lines(self.weight, width),
            Out::rows(y, out),
            Par::Sequential,
        );
    }
}

/// `[rows, in]` through all layers.
pub(crate) fn forward<T: Real>(x: &[T], layers: &[Layer<'_, T>], rows: usize) -> Vec<T> {
    let (first, last) = (layers[0].width_in, layers[layers.len() - 1].width_out);
    let widest = layers.iter().map(|layer| layer.width_out).max().unwrap_or(0);
    let mut result = buffer(rows * last);
    if result.is_empty() {
        return result;
    }
    result.par_chunks_mut(BLOCK * last).enumerate().for_each(|(i, y)| {
        let rows = y.len() / last;
        let x = &x[i * BLOCK * first..][..rows * first];
        scratch::with([rows * widest, rows * widest], |[mut from, mut to]| {
            for (number, layer) in layers.iter().enumerate() {
                let input = if number == 0 { x } else { &from[..rows * layer.width_in] };
                if number + 1 == layers.len() {
                    layer.run(input, y, rows, layer.activation);
                } else {
                    layer.run(input, to, rows, layer.activation);
                    std::mem::swap(&mut from, &mut to);
                }
            }
        });
    });
    result
}
