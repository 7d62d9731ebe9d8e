//! The centroid term: positions of the object in the images. It constrains motion before silhouettes overlap, without
//! optical flow.

use std::ops::Range;

use gradreel::scalar::Real;
use gradreel::{DType, Result, Tensor, Var};

use crate::video::Clip;

/// Added to the rendered coverage, relative to the filmed one, so that the centroid stays defined for almost empty
/// images.
const LEAST: f64 = 1e-3;

/// The centroids of the object in all views of a frame.
///
/// The loss is `weight Σ_v w_v |m_v|²/V` over `V` views, with `m_v = Σ α c p / (Σ α c + ε)`: the centroid of the
/// rendered coverage `α` over the pixels that are not excluded (`c`), with positions `p` relative to the filmed
/// centroid in units of the square root of the filmed area.
#[derive(Debug, Clone)]
pub struct Trajectory {
    /// Column and row of every ray's pixel, relative to the filmed centroid, in units of the square root of the filmed
    /// area, times the pixel's weight; then the weight, `[rays, 3]`.
    places: Tensor,
    views: Vec<View>,
}

/// One view.
#[derive(Debug, Clone)]
struct View {
    rays: Range<usize>,
    /// Added to the rendered area \[pixels\].
    least: f64,
    weight: f64,
}

/// The centroid in one view: its two residuals, and their derivatives along some directions, `[2][directions]`.
pub(crate) struct Middle {
    pub residual: [f64; 2],
    pub changes: [Vec<f64>; 2],
    /// The weight of their squares.
    pub weight: f64,
}

impl Trajectory {
    /// The centroids of one frame of a clip, with a weight for each view.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    ///
    /// # Panics
    /// When `views` does not have one weight per camera.
    #[track_caller]
    pub fn of(clip: &Clip, frame: usize, weight: f64, views: &[f64], dtype: DType) -> Result<Self> {
        assert_eq!(views.len(), clip.cameras.len(), "one weight for each camera");
        let (mut places, mut all, mut first) = (Vec::new(), Vec::new(), 0);
        for (frames, view) in clip.frames.iter().zip(views) {
            let image = &frames[frame];
            let counted = || image.alpha.indexed_iter().map(|(at, &alpha)| (at, alpha, f64::from(image.weight[at])));
            let (mut area, mut middle) = (0.0, [0.0; 2]);
            for ((row, column), alpha, counts) in counted() {
                let mass = f64::from(alpha) * counts;
                area += mass;
                middle[0] += mass * column as f64;
                middle[1] += mass * row as f64;
            }
            // an object of less than a pixel does not count
            let seen = area >= 1.0;
            let (scale, rays) = (area.max(1.0).sqrt(), image.alpha.len());
            for ((row, column), _, counts) in counted() {
                let place = [column as f64 - middle[0] / area.max(1.0), row as f64 - middle[1] / area.max(1.0)];
                places.extend([counts * place[0] / scale, counts * place[1] / scale, counts]);
            }
            let weight = if seen { weight * view / views.len() as f64 } else { 0.0 };
            all.push(View { rays: first..first + rays, least: LEAST * area.max(1.0), weight });
            first += rays;
        }
        Ok(Self { places: Tensor::from_vec(places, [first, 3]).cast(dtype)?, views: all })
    }

    /// The loss of rendered pixels `[rays, 4]`.
    pub fn loss(&self, rendered: &Var) -> Var {
        let places = rendered.tape().constant(self.places.clone());
        let alpha = rendered.slice(1, 3..4);
        let one = |view: &View| {
            let sums = (&alpha.slice(0, view.rays.clone()) * &places.slice(0, view.rays.clone())).sum(&[0]);
            let area = sums.slice(0, 2..3) + view.least;
            (&sums.slice(0, 0..2) / &area).square().sum_all() * view.weight
        };
        let seen = self.views.iter().filter(|view| view.weight > 0.0).map(one);
        seen.reduce(|a, b| a + b).unwrap_or_else(|| alpha.sum_all() * 0.0)
    }

    /// The centroid in view `index`, from its rendered pixels `[n, 4]` and their tangents `[n, directions, 4]`; `None`
    /// if the view has no weight.
    pub(crate) fn middle<T: Real>(&self, index: usize, pixels: &[T], changes: &[T]) -> Option<Middle> {
        let view = &self.views[index];
        if view.weight == 0.0 {
            return None;
        }
        let count = pixels.len() / 4;
        let directions = changes.len() / pixels.len().max(1);
        let places = &self.places.slice::<T>()[3 * view.rays.start..3 * view.rays.end];
        let mut sums = [0.0; 3];
        let mut slopes = vec![[0.0; 3]; directions];
        for r in 0..count {
            let place = [0, 1, 2].map(|k| places[3 * r + k].to_f64());
            let alpha = pixels[4 * r + 3].to_f64();
            (0..3).for_each(|k| sums[k] += alpha * place[k]);
            for (l, slope) in slopes.iter_mut().enumerate() {
                let change = changes[4 * (directions * r + l) + 3].to_f64();
                (0..3).for_each(|k| slope[k] += change * place[k]);
            }
        }
        let area = sums[2] + view.least;
        let residual = [sums[0] / area, sums[1] / area];
        let along = |k: usize| slopes.iter().map(|slope| (slope[k] - residual[k] * slope[2]) / area).collect();
        Some(Middle { residual, changes: [along(0), along(1)], weight: view.weight })
    }
}
