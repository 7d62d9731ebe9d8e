//! A multilayer perceptron by blocks of rows that go through all layers while they are in the second-level cache.
//!
//! What is between the layers stays in the caches, and the gradients compute it again, unless they ask to keep it: that is done
//! where a layer costs more to compute than to read, as long as it does not take much memory. Gradients of the weights are
//! summed over the blocks of a span, one after another, then over the spans in their order, so that they do not depend on the
//! number of threads.

mod gradients;

use rayon::prelude::*;

pub(crate) use gradients::gradients;

use super::gemm::{Activation, Gemm, Out, Packed, Panel, Par, Strided, scratch};
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
    /// Rows `[rows, in]` to `[rows, out]`. The weight may have been packed before.
    fn run(&self, x: &[T], y: &mut [T], rows: usize, activation: Activation, packed: Option<&Packed<T>>) {
        let (width, out) = (self.width_in, self.width_out);
        let weight = Strided::lines(self.weight, width);
        let right: &dyn Panel<T> = packed.map_or(&weight, |packed| packed);
        Gemm::new([rows, width, out]).column_bias(Some(self.bias)).activation(activation).run(
            &Strided::lines(x, width),
            right,
            Out::rows(y, out),
            Par::Sequential,
        );
    }

    /// The weight packed for [`Layer::run`], where many blocks of rows meet it.
    fn packed(&self, rows: usize) -> Option<Packed<T>> {
        let weight = Strided::lines(self.weight, self.width_in);
        if rows > BLOCK { Packed::new(&weight, self.width_out, self.width_in) } else { None }
    }
}

/// Inputs of a layer from which on its result is rather kept than computed again.
const WIDE: usize = 64;
/// Bytes of results between the layers that are kept at most.
const KEPT: usize = 64 << 20;

/// For each layer, its result if that was kept, `[rows, out]`.
pub(crate) struct Kept<T: Real>(Vec<Option<Temporary<T>>>);

impl<T: Real> Kept<T> {
    fn nothing(layers: usize) -> Self {
        Self((0..layers).map(|_| None).collect())
    }

    /// Room for what is worth keeping.
    fn room(layers: &[Layer<'_, T>], rows: usize) -> Self {
        let mut left = KEPT / size_of::<T>();
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
    if result.is_empty() {
        return (result, Kept::nothing(layers.len()));
    }
    let mut kept_layers = if keep { Kept::room(layers, rows) } else { Kept::nothing(layers.len()) };
    let places: Vec<_> =
        kept_layers.0.iter_mut().map(|values| values.as_mut().map(|values| Places::of(values))).collect();
    let packed: Vec<_> = layers.iter().map(|layer| layer.packed(rows)).collect();
    result.par_chunks_mut(BLOCK * last).enumerate().for_each(|(i, y)| {
        let rows = y.len() / last;
        let x = &x[i * BLOCK * first..][..rows * first];
        // SAFETY: the rows of a block lie within what is kept, and are one thread's.
        let kept = |number: usize| {
            places[number].map(|places| unsafe {
                let width = layers[number].width_out;
                places.part(i * BLOCK * width, rows * width)
            })
        };
        scratch::with([rows * widest, rows * widest], |[mut from, mut to]| {
            for (number, layer) in layers.iter().enumerate() {
                let before = if number == 0 { None } else { kept(number - 1) };
                let input = match before {
                    _ if number == 0 => x,
                    Some(kept) => kept,
                    None => &from[..rows * layer.width_in],
                };
                let output = match kept(number) {
                    _ if number + 1 == layers.len() => &mut *y,
                    Some(kept) => kept,
                    None => &mut to[..rows * layer.width_out],
                };
                layer.run(input, output, rows, layer.activation, packed[number].as_ref());
                std::mem::swap(&mut from, &mut to);
            }
        });
    });
    (result, kept_layers)
}
