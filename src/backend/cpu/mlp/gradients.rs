//! The gradients of a multilayer perceptron, by the same blocks as its result.

use std::ops::Range;

use super::{
    Activation, BLOCK, Gemm, Job, Kept, Lane, Layer, Out, Packed, Par, Real, Strided, buffer, packed, scratch,
};
use crate::backend::cpu::vectorised;
use rayon::prelude::*;

/// Rows whose gradients of the weights are summed one block after another, and the most such spans: they share the rows
/// evenly where there are more.
const SPAN: usize = 2048;
const MOST_SPANS: usize = 64;

/// What a backward pass finds.
pub(crate) struct Gradients<T> {
    /// `[rows, in]`, if it was asked for.
    pub(crate) x: Option<Vec<T>>,
    /// Weight and bias of each layer, if they were asked for.
    pub(crate) layers: Vec<(Vec<T>, Vec<T>)>,
}

/// The gradients of `Σ g · y` in the input and in the weights, each if wanted, with what the forward pass kept.
pub(crate) fn gradients<T: Real>(
    x: &[T],
    layers: &[Layer<'_, T>],
    kept: &Kept<T>,
    g: &[T],
    rows: usize,
    [x_wanted, layers_wanted]: [bool; 2],
) -> Gradients<T> {
    let width = layers[0].width_in;
    let mut slope = buffer::<T>(if x_wanted { rows * width } else { 0 });
    let sizes = layers.iter().flat_map(|layer| [layer.width_in * layer.width_out, layer.width_out]);
    let starts: Vec<usize> = std::iter::once(0)
        .chain(sizes.scan(0, |sum, size| {
            *sum += size;
            Some(*sum)
        }))
        .collect();
    let count = if layers_wanted { starts[starts.len() - 1] } else { 0 };
    let spans = rows.div_ceil(SPAN).clamp(1, MOST_SPANS);
    let length = rows.div_ceil(spans).next_multiple_of(BLOCK).max(BLOCK);
    let spans = rows.div_ceil(length).max(1);
    let mut sums = buffer::<T>(spans * count);
    sums.fill(T::ZERO);
    let slopes = slope.chunks_mut((length * width).max(1)).map(Some);
    let slopes: Vec<_> = if x_wanted { slopes.collect() } else { (0..spans).map(|_| None).collect() };
    let weights: Vec<_> = layers.iter().map(|layer| Weights::of(layer, rows)).collect();
    let parts = sums.chunks_mut(count.max(1));
    let parts: Vec<_> = if count > 0 { parts.collect() } else { (0..spans).map(|_| &mut [][..]).collect() };
    parts.into_par_iter().zip(slopes).enumerate().for_each(|(i, (sums, mut slope))| {
        let mut span = Span { layers, weights: &weights, kept, starts: &starts, sums, layers_wanted };
        let last = layers[layers.len() - 1].width_out;
        let rows = i * length..rows.min((i + 1) * length);
        for start in rows.clone().step_by(BLOCK) {
            let block = start..rows.end.min(start + BLOCK);
            let from = start - rows.start;
            let slope = slope.as_deref_mut().map(|slope| &mut slope[from * width..][..block.len() * width]);
            let (x, g) = (&x[start * width..][..block.len() * width], &g[start * last..][..block.len() * last]);
            span.block(x, g, slope, block);
        }
    });
    let (first, rest) = sums.split_at_mut(count);
    if count > 0 {
        first.par_chunks_mut(1 << 12).enumerate().for_each(|(i, part)| {
            for span in rest.chunks(count) {
                part.iter_mut().zip(&span[i << 12..]).for_each(|(sum, value)| *sum += *value);
            }
        });
    }
    let part = |range: Range<usize>| first[range].to_vec();
    let layer = |i: usize| (part(starts[2 * i]..starts[2 * i + 1]), part(starts[2 * i + 1]..starts[2 * i + 2]));
    let found = (0..layers.len()).filter(|_| layers_wanted).map(layer).collect();
    Gradients { x: x_wanted.then_some(slope), layers: found }
}

/// The weight of a layer as the right factor of both directions.
struct Weights<'a, T: Real> {
    forward: Packed<'a, T>,
    backward: Packed<'a, T>,
}

impl<'a, T: Real> Weights<'a, T> {
    fn of(layer: &'a Layer<'_, T>, rows: usize) -> Self {
        let Layer { weight, width_in: width, width_out: out, .. } = *layer;
        Self { forward: layer.weight(rows), backward: packed(Strided::side_by_side(weight, width), [width, out], rows) }
    }
}

/// What the blocks of a span share.
struct Span<'a, T: Real> {
    layers: &'a [Layer<'a, T>],
    weights: &'a [Weights<'a, T>],
    kept: &'a Kept<T>,
    /// Where the sums of each weight and each bias begin.
    starts: &'a [usize],
    sums: &'a mut [T],
    layers_wanted: bool,
}

impl<T: Real> Span<'_, T> {
    /// Adds the gradients of one block of rows, and stores the gradient of its input.
    fn block(&mut self, x: &[T], g: &[T], mut slope: Option<&mut [T]>, block: Range<usize>) {
        let (layers, kept, rows) = (self.layers, self.kept, block.len());
        let kept = |i: usize| {
            let width = layers[i].width_out;
            kept.0[i].as_ref().map(|values| &values[block.start * width..block.end * width])
        };
        // what is made again; of the last layer, only where its activation is not the identity
        let last = layers.len() - 1;
        let again = |i: usize| kept(i).is_none() && (i < last || layers[i].activation != Activation::Identity);
        let places: Vec<usize> = (0..layers.len())
            .scan(0, |sum, i| {
                let start = *sum;
                *sum += if again(i) { rows * layers[i].width_out } else { 0 };
                Some(start)
            })
            .collect();
        let total = places[last] + if again(last) { rows * layers[last].width_out } else { 0 };
        let widest = layers.iter().map(|layer| layer.width_out).max().unwrap_or(0);
        let before = if layers.iter().any(|layer| layer.activation == Activation::Silu) { total } else { 0 };
        scratch::with([total, before, rows * widest, rows * widest], |[made, before, mut to, mut from]| {
            for (i, layer) in layers.iter().enumerate().filter(|(i, _)| again(*i)) {
                let (done, rest) = made.split_at_mut(places[i]);
                let input = match i.checked_sub(1) {
                    None => x,
                    Some(below) => kept(below).unwrap_or_else(|| &done[places[below]..]),
                };
                let output = &mut rest[..rows * layer.width_out];
                let weight = &self.weights[i].forward;
                if layer.activation == Activation::Silu {
                    let before = &mut before[places[i]..][..rows * layer.width_out];
                    layer.run(input, before, rows, Activation::Identity, weight);
                    // SAFETY: the job goes as far as the shorter slice.
                    unsafe { vectorised(Apply { activation: layer.activation, x: before, y: output }) };
                } else {
                    layer.run(input, output, rows, layer.activation, weight);
                }
            }
            let made = |i: usize| kept(i).unwrap_or_else(|| &made[places[i]..][..rows * layers[i].width_out]);
            from[..g.len()].copy_from_slice(g);
            for (i, layer) in layers.iter().enumerate().rev() {
                let (width, out) = (layer.width_in, layer.width_out);
                let g = &mut from[..rows * out];
                if layer.activation != Activation::Identity {
                    let silu = layer.activation == Activation::Silu;
                    let of = if silu { &before[places[i]..][..rows * out] } else { made(i) };
                    // SAFETY: the job goes as far as the shorter slice.
                    unsafe { vectorised(Slope { activation: layer.activation, of, g }) };
                }
                let input = if i == 0 { x } else { made(i - 1) };
                if self.layers_wanted {
                    let (weight, bias) =
                        self.sums[self.starts[2 * i]..self.starts[2 * i + 2]].split_at_mut(width * out);
                    Gemm::new([out, rows, width]).accumulate().run(
                        &Strided::side_by_side(g, out),
                        &Strided::side_by_side(input, width),
                        Out::rows(weight, width),
                        Par::Sequential,
                    );
                    // SAFETY: the job reads whole rows only.
                    unsafe { vectorised(AddRows { rows: g, to: bias }) };
                }
                let result = if i > 0 { Some(&mut to[..rows * width]) } else { slope.as_deref_mut() };
                if let Some(result) = result {
                    let (left, right) = (Strided::lines(g, out), &self.weights[i].backward);
                    Gemm::new([rows, out, width]).run(&left, right, Out::rows(result, width), Par::Sequential);
                }
                std::mem::swap(&mut from, &mut to);
            }
        });
    }
}

/// `y = activation(x)`.
struct Apply<'a, T> {
    activation: Activation,
    x: &'a [T],
    y: &'a mut [T],
}

impl<T: Real> Job<T> for Apply<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let len = self.x.len().min(self.y.len());
        let mut i = 0;
        while i < len {
            // SAFETY: both slices hold `len` values.
            unsafe {
                let x = V::load_part(self.x.as_ptr().add(i), len - i);
                self.activation.of(x).store_part(self.y.as_mut_ptr().add(i), len - i);
            }
            i += V::WIDTH;
        }
    }
}

/// `g = g · activation'`, the derivative being a function of the result, or for silu of the operand.
struct Slope<'a, T> {
    activation: Activation,
    of: &'a [T],
    g: &'a mut [T],
}

impl<T: Real> Job<T> for Slope<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { activation, of, g } = self;
        let len = of.len().min(g.len());
        macro_rules! each {
            (|$y:ident, $g:ident| $value:expr) => {{
                let mut i = 0;
                while i < len {
                    let at = g.as_mut_ptr().wrapping_add(i);
                    // SAFETY: both slices hold `len` values.
                    unsafe {
                        let ($y, $g) = (V::load_part(of.as_ptr().add(i), len - i), V::load_part(at, len - i));
                        $value.store_part(at, len - i);
                    }
                    i += V::WIDTH;
                }
            }};
        }
        // SAFETY: the instruction set is enabled, by the contract of `Job`.
        let (zero, one) = unsafe { (V::splat(T::ZERO), V::splat(T::ONE)) };
        match activation {
            Activation::Identity => {}
            Activation::Relu => each!(|y, g| zero.lt(y).choose(g, zero)),
            Activation::Tanh => each!(|y, g| y.neg_mul_add(y, one).mul(g)),
            Activation::Logistic => each!(|y, g| y.neg_mul_add(y, y).mul(g)),
            Activation::Softplus => each!(|y, g| y.neg().exp_m1().neg().mul(g)),
            Activation::Silu => each!(|x, g| {
                let s = x.logistic();
                x.mul(one.sub(s)).mul_add(s, s).mul(g)
            }),
        }
    }
}

/// Adds rows to one row.
struct AddRows<'a, T> {
    rows: &'a [T],
    to: &'a mut [T],
}

impl<T: Real> Job<T> for AddRows<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { rows, to } = self;
        let width = to.len();
        let count = rows.len() / width;
        let mut i = 0;
        while i < width {
            // SAFETY: every row holds `width` values.
            unsafe {
                let mut sum = V::load_part(to.as_ptr().add(i), width - i);
                for r in 0..count {
                    sum = sum.add(V::load_part(rows.as_ptr().add(r * width + i), width - i));
                }
                sum.store_part(to.as_mut_ptr().add(i), width - i);
            }
            i += V::WIDTH;
        }
    }
}
