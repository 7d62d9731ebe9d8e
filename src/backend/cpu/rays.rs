//! Compositing along rays whose samples lie one after the other in one list.

use rayon::prelude::*;

use crate::backend::cpu::{Places, buffer, filled};
use crate::scalar::Real;

/// Rays per work item.
const RAYS: usize = 256;

/// The cotangents of a ray's results; none counts as 0.
#[derive(Clone, Copy)]
pub(crate) struct Cotangents<'a, T> {
    /// Of the weight of each sample.
    pub(crate) weights: Option<&'a [T]>,
    /// Of the transmittance left of each ray.
    pub(crate) left: Option<&'a [T]>,
}

/// No transmittance is below that of a ray that does not end early, on either backend.
fn threshold<T: Real>(stop: Option<f64>) -> T {
    T::from_f64(stop.unwrap_or(f64::from(f32::MIN)))
}

/// Calls `work(ray, samples, rows)` for each ray, in parallel; `rows` are the ray's own elements of the result.
fn each_ray<T: Real>(alpha: &[T], offsets: &[u32], work: impl Fn(usize, &[T], &mut [T]) + Sync) -> Vec<T> {
    let mut result = buffer(alpha.len());
    let rays = offsets.len() - 1;
    assert!(offsets.is_sorted() && offsets[rays] as usize == alpha.len(), "the offsets are not those of the samples");
    let out = Places::of(&mut result);
    let some = |item: usize| {
        for ray in item * RAYS..rays.min((item + 1) * RAYS) {
            let (start, end) = (offsets[ray] as usize, offsets[ray + 1] as usize);
            // SAFETY: the offsets never fall and end with the length, so that the ranges of rays do not overlap.
            let rows = unsafe { out.part(start, end - start) };
            work(ray, &alpha[start..end], rows);
        }
    };
    (0..rays.div_ceil(RAYS)).into_par_iter().for_each(some);
    result
}

/// `T_k α_k` of every sample.
pub(crate) fn weights<T: Real>(alpha: &[T], offsets: &[u32], stop: Option<f64>) -> Vec<T> {
    let stop = threshold(stop);
    each_ray(alpha, offsets, |_, alpha, weights| {
        let mut left = T::ONE;
        for (k, &a) in alpha.iter().enumerate() {
            weights[k] = left * a;
            left *= T::ONE - a;
            if left < stop {
                weights[k + 1..].fill(T::ZERO);
                break;
            }
        }
    })
}

/// `Π (1 − α_k)` of every ray.
pub(crate) fn transmittance<T: Real>(alpha: &[T], offsets: &[u32], stop: Option<f64>) -> Vec<T> {
    let stop = threshold(stop);
    filled(offsets.len() - 1, RAYS, |first, part: &mut [T]| {
        for (left, ends) in part.iter_mut().zip(offsets[first..].windows(2)) {
            *left = T::ONE;
            for &a in &alpha[ends[0] as usize..ends[1] as usize] {
                *left *= T::ONE - a;
                if *left < stop {
                    break;
                }
            }
        }
    })
}

/// The cotangents of the opacities.
///
/// With `R` the cotangent of the transmittance behind a sample, `∂/∂α_k = T_k (g_k − R_k)` and `R_{k−1} = g_k α_k +
/// (1 − α_k) R_k`, from the back: no division by `1 − α`.
pub(crate) fn slope<T: Real>(alpha: &[T], offsets: &[u32], rays: Cotangents<'_, T>, stop: Option<f64>) -> Vec<T> {
    let stop = threshold(stop);
    each_ray(alpha, offsets, |ray, alpha, slopes| {
        let (mut left, mut kept) = (T::ONE, alpha.len());
        for (k, &a) in alpha.iter().enumerate() {
            slopes[k] = left;
            left *= T::ONE - a;
            if left < stop {
                kept = k + 1;
                break;
            }
        }
        slopes[kept..].fill(T::ZERO);
        let start = offsets[ray] as usize;
        let mut behind = rays.left.map_or(T::ZERO, |g| g[ray]);
        for k in (0..kept).rev() {
            let g = rays.weights.map_or(T::ZERO, |g| g[start + k]);
            slopes[k] *= g - behind;
            behind = g * alpha[k] + (T::ONE - alpha[k]) * behind;
        }
    })
}
