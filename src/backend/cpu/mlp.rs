//! A multilayer perceptron by blocks of rows that go through all layers while they are in the second-level cache.
//!
//! What is between the layers stays in the caches, and the gradients compute it again, unless they ask to keep it: that is done
//! where a layer costs more to compute than to read, as long as it does not take much memory. Gradients of the weights are
//! summed over the blocks of a span, one after another, then over the spans in their order, so that they do not depend on the
//! number of threads.

mod gradients;

use rayon::prelude::*;

pub(crate) use gradients::gradients;

use super::gemm::{Activation, Gemm, Out, Packed, Par, Strided, scratch};
use super::{Places, Temporary, buffer};
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
    /// Rows `[rows, in]` to `[rows, out]`, with the weight that [`Layer::weight`] made.
    fn run(&self, x: &[T], y: &mut [T], rows: usize, activation: Activation, weight: &Packed<'_, T>) {
        let (width, out) = (self.width_in, self.width_out);
        Gemm::new([rows, width, out]).column_bias(Some(self.bias)).activation(activation).run(
            &Strided::lines(x, width),
            weight,
            Out::rows(y, out),
            Par::Sequential,
        );
    }

    /// The weight as the right factor of [`Layer::run`].
    fn weight(&self, rows: usize) -> Packed<'_, T> {
        packed(Strided::lines(self.weight, self.width_in), [self.width_out, self.width_in], rows)
    }
}

/// A weight, packed where many blocks of rows meet it.
fn packed<T: Real>(weight: Strided<'_, T>, size: [usize; 2], rows: usize) -> Packed<'_, T> {
    if rows > BLOCK { Packed::now(weight, size) } else { Packed::later(weight, size) }
}

/// Inputs of a layer from which on its result is rather kept than computed again.
const WIDE: usize = 64;
/// Bytes of results between the layers that are kept at most.
const KEPT: usize = 64 << 20;

/// For each layer, its result if that was kept, `[rows, out]`.
pub(crate) struct Kept<T: Real>(Vec<Option<Temporary<T>>>);

impl<T: Real> Kept<T> {
    /// Room for what is worth keeping, within so many bytes.
    fn room(layers: &[Layer<'_, T>], rows: usize, bytes: usize) -> Self {
        let mut left = bytes / size_of::<T>();
        let hidden = layers.len() - 1;
        let kept = layers.iter().enumerate().map(|(i, layer)| {
            let len = rows * layer.width_out;
            // silu's slope needs what came before it
            let worth = i < hidden && layer.width_in >= WIDE && layer.activation != Activation::Silu && len <= left;
            worth.then(|| {
                left -= len;
                Temporary::new(len)
            })
        });
        Self(kept.collect())
    }

    /// How many bytes that is.
    pub(crate) fn bytes(&self) -> usize {
        self.0.iter().flatten().map(|values| values.len() * size_of::<T>()).sum()
    }
}

/// `[rows, in]` through all layers, and, if `keep` says so, what is between them.
pub(crate) fn forward<T: Real>(x: &[T], layers: &[Layer<'_, T>], rows: usize, keep: bool) -> (Vec<T>, Kept<T>) {
    let (first, last) = (layers[0].width_in, layers[layers.len() - 1].width_out);
    let widest = layers.iter().map(|layer| layer.width_out).max().unwrap_or(0);
    let mut result = buffer(rows * last);
    let mut between = Kept::room(layers, rows, if keep && !result.is_empty() { KEPT } else { 0 });
    if result.is_empty() {
        return (result, between);
    }
    let places: Vec<_> = between.0.iter_mut().map(|values| values.as_mut().map(|values| Places::of(values))).collect();
    let weights: Vec<_> = layers.iter().map(|layer| layer.weight(rows)).collect();
    result.par_chunks_mut(BLOCK * last).enumerate().for_each(|(i, y)| {
        let rows = y.len() / last;
        let x = &x[i * BLOCK * first..][..rows * first];
        let kept = |number: usize| {
            let width = layers[number].width_out;
            // SAFETY: the rows of a block lie within what is kept, and are one thread's.
            places[number].map(|places| unsafe { places.part(i * BLOCK * width, rows * width) })
        };
        scratch::with([rows * widest, rows * widest], |[mut from, mut to]| {
            for (number, layer) in layers.iter().enumerate() {
                let input = match number.checked_sub(1) {
                    None => x,
                    Some(below) => kept(below).map_or(&from[..rows * layer.width_in], |kept| kept),
                };
                let output = match kept(number) {
                    _ if number + 1 == layers.len() => &mut *y,
                    Some(kept) => kept,
                    None => &mut to[..rows * layer.width_out],
                };
                layer.run(input, output, rows, layer.activation, &weights[number]);
                std::mem::swap(&mut from, &mut to);
            }
        });
    });
    (result, between)
}
