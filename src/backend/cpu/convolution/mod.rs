//! Convolutions on the CPU.
//!
//! ```text
//! walk       which taps meet which places of a padded image
//! direct     row by row, for few channels
//! product    as products of matrices whose patches are packed from the image
//! gradient   the gradient in the weight, likewise
//! winograd   3×3 kernels of stride 1, with fewer multiplications
//! karatsuba  transposed ones of 3×3×3 kernels and stride 2, likewise
//! layout     images with their channels last
//! ```

mod direct;
mod gradient;
mod karatsuba;
mod layout;
mod product;
#[cfg(test)]
mod tests;
mod walk;
mod winograd;

use crate::ops::Geometry;
use crate::scalar::Real;
use walk::Walk;
use winograd::Plan;

/// Channels of a group's result up to which it is made row by row.
const FEW: usize = 4;

/// The result of image, weight and bias.
pub(crate) fn forward<T: Real>(g: &Geometry, image: &[T], weight: &[T], bias: Option<&[T]>) -> Vec<T> {
    let walk = Walk::forward(g);
    if g.outputs <= FEW {
        direct::forward(g, &walk, image, weight, bias)
    } else if let Some(plan) = Plan::new(g, &walk, false) {
        let volume = g.volumes()[2];
        plan.run(image, weight, |input, output, tap| (output * g.inputs + input) * volume + 9 * tap, false, bias)
    } else {
        product::forward(g, &walk, image, weight, bias)
    }
}

/// The image of result, weight and bias.
pub(crate) fn transposed<T: Real>(g: &Geometry, result: &[T], weight: &[T], bias: Option<&[T]>) -> Vec<T> {
    let walks = Walk::transposed(g);
    if g.inputs <= FEW {
        return direct::transposed(g, &walks, result, weight, bias);
    }
    if let [walk] = &walks[..]
        && let Some(plan) = Plan::new(g, walk, true)
    {
        let volume = g.volumes()[2];
        let at = |output: usize, input: usize, tap: usize| (output * g.inputs + input) * volume + 9 * tap;
        plan.run(result, weight, at, true, bias)
    } else if let Some(plan) = karatsuba::Plan::new(g) {
        plan.enlarge(result, weight, bias)
    } else {
        product::transposed(g, &walks, result, weight, bias)
    }
}

/// The weight of image and result.
pub(crate) fn weights<T: Real>(g: &Geometry, image: &[T], result: &[T]) -> Vec<T> {
    let walk = Walk::forward(g);
    if g.outputs <= FEW {
        direct::weights(g, &walk, &walk.pad(image), result)
    } else if let Some(plan) = Plan::new(g, &walk, false) {
        plan.weights(image, result)
    } else if let Some(plan) = karatsuba::Plan::new(g) {
        plan.weights(image, result)
    } else {
        gradient::weights(g, &walk, image, result)
    }
}
