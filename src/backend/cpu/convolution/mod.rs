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

/// The numbers of image, result, weight, and of the bias of the result and of the image, where they are given.
///
/// # Panics
/// When there are not as many as the geometry says: what follows reads and writes without further checks.
fn check(g: &Geometry, found: [Option<usize>; 5]) {
    let [pixels, places, volume] = g.volumes();
    let Geometry { batch, groups, inputs, outputs, .. } = *g;
    let wanted = [
        batch * groups * inputs * pixels,
        batch * groups * outputs * places,
        groups * outputs * inputs * volume,
        groups * outputs,
        groups * inputs,
    ];
    let fits = found.iter().zip(wanted).all(|(found, wanted)| found.is_none_or(|found| found == wanted));
    assert!(fits, "a convolution of {wanted:?} numbers got {found:?}");
}

/// The result of image, weight and bias.
pub(crate) fn forward<T: Real>(g: &Geometry, image: &[T], weight: &[T], bias: Option<&[T]>) -> Vec<T> {
    check(g, [Some(image.len()), None, Some(weight.len()), bias.map(<[T]>::len), None]);
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
    check(g, [None, Some(result.len()), Some(weight.len()), None, bias.map(<[T]>::len)]);
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
    check(g, [Some(image.len()), Some(result.len()), None, None, None]);
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
