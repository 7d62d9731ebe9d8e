//! Convolutions on the CPU.

mod direct;
mod walk;

use rayon::prelude::*;

use crate::backend::cpu::buffer;
use crate::ops::Geometry;
use crate::scalar::Real;
use walk::Walk;

/// `batch × channels` planes that hold the bias of their channel.
fn biased<T: Real>(batch: usize, channels: usize, plane: usize, bias: Option<&[T]>) -> Vec<T> {
    let mut values = buffer(batch * channels * plane);
    values.par_chunks_mut(plane.max(1)).enumerate().for_each(|(number, values)| {
        values.fill(bias.map_or(T::ZERO, |bias| bias[number % channels]));
    });
    values
}

/// The result of image, weight and bias.
pub(crate) fn forward<T: Real>(g: &Geometry, image: &[T], weight: &[T], bias: Option<&[T]>) -> Vec<T> {
    let (channels, [_, places, volume]) = (g.groups * g.outputs, g.volumes());
    let mut result = biased(g.batch, channels, places, bias);
    let walk = Walk::forward(g);
    let padded = walk.pad(image);
    let at = |output: usize, input: usize, tap: usize| weight[(output * g.inputs + input) * volume + tap];
    direct::add(g, &walk, &mut result, channels, (&padded, g.inputs), at);
    result
}

/// The image of result, weight and bias.
pub(crate) fn transposed<T: Real>(g: &Geometry, result: &[T], weight: &[T], bias: Option<&[T]>) -> Vec<T> {
    let (channels, [pixels, _, volume]) = (g.groups * g.inputs, g.volumes());
    let mut image = biased(g.batch, channels, pixels, bias);
    let at = |channel: usize, output: usize, tap: usize| {
        let (group, input) = (channel / g.inputs, channel % g.inputs);
        weight[((group * g.outputs + output) * g.inputs + input) * volume + tap]
    };
    for walk in Walk::transposed(g) {
        let padded = walk.pad(result);
        direct::add(g, &walk, &mut image, channels, (&padded, g.outputs), at);
    }
    image
}

/// The weight of image and result.
pub(crate) fn weights<T: Real>(g: &Geometry, image: &[T], result: &[T]) -> Vec<T> {
    let walk = Walk::forward(g);
    direct::weights(g, &walk, &walk.pad(image), result)
}
