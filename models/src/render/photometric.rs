//! The photometric loss: rendered pixels against those of the clip.

use gradreel::{DType, Result, Tensor, Var};

use super::{Trajectory, huber};
use crate::video::Clip;

/// The pixels of one frame in the order of the rays: all cameras, row by row.
#[derive(Debug, Clone)]
pub struct Target {
    /// Premultiplied red, green, blue and coverage, `[rays, 4]`.
    pub rgba: Tensor,
    /// Weight of a squared residual of each channel, `[rays, 4]`: 0 for excluded pixels, normalised by the area of the
    /// object in pixels, so that the loss does not depend on the image size.
    pub weight: Tensor,
    /// Pixels with a robust loss, if any.
    pub robust: Option<Robust>,
    /// The centroid term, if it is used.
    pub trajectory: Option<Trajectory>,
}

/// Pixels with the [`huber`] loss: those of imagined views, which may be misregistered.
#[derive(Debug, Clone)]
pub struct Robust {
    /// Residual beyond which the loss is linear.
    pub delta: f64,
    /// Flags of the rays with the robust loss, 0 or 1, `[rays, 1]`.
    pub rays: Tensor,
}

impl Robust {
    /// All pixels of a clip's imagined views.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    pub fn of(clip: &Clip, delta: f64, dtype: DType) -> Result<Self> {
        let views = clip.cameras.iter().zip(&clip.imagined);
        let rays: Vec<f64> =
            views.flat_map(|(camera, &imagined)| vec![f64::from(imagined); camera.width * camera.height]).collect();
        let count = rays.len();
        Ok(Self { delta, rays: Tensor::from_vec(rays, [count, 1]).cast(dtype)? })
    }
}

/// Weights of colour and coverage in the loss.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// Weight of a squared colour residual (for each of red, green, blue).
    pub colour: f64,
    /// Weight of a squared coverage residual.
    #[serde(skip)]
    pub coverage: f64,
    /// Weight of the colours of imagined views relative to those of real ones; 0 for models whose silhouettes are more
    /// reliable than their colours.
    pub imagined_colour: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self { colour: 0.2, coverage: 1.0, imagined_colour: 1.0 }
    }
}

impl Target {
    /// The pixels of one frame of a clip.
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    pub fn of(clip: &Clip, frame: usize, weights: &Weights, dtype: DType) -> Result<Self> {
        Self::of_views(clip, frame, weights, &vec![1.0; clip.cameras.len()], dtype)
    }

    /// [`Target::of`] with a weight for each view ([`ViewWeights`](super::ViewWeights)).
    ///
    /// # Errors
    /// Only for types other than `f32` and `f64`.
    ///
    /// # Panics
    /// When `views` does not have one weight per camera.
    #[track_caller]
    pub fn of_views(clip: &Clip, frame: usize, weights: &Weights, views: &[f64], dtype: DType) -> Result<Self> {
        assert_eq!(views.len(), clip.cameras.len(), "one weight for each camera");
        let (mut rgba, mut weight) = (Vec::new(), Vec::new());
        let mut area = 0.0;
        for ((frames, view), imagined) in clip.frames.iter().zip(views).zip(&clip.imagined) {
            let colour = weights.colour * if *imagined { weights.imagined_colour } else { 1.0 };
            let image = &frames[frame];
            for ((row, column), &alpha) in image.alpha.indexed_iter() {
                // the image is over white: premultiplied colour = image − (1 − alpha)
                rgba.extend((0..3).map(|c| f64::from(image.rgb[[row, column, c]] - (1.0 - alpha)).max(0.0)));
                rgba.push(f64::from(alpha));
                let counts = f64::from(image.weight[[row, column]]);
                weight.extend([colour * counts * view; 3]);
                weight.push(weights.coverage * counts * view);
                area += f64::from(alpha) * counts;
            }
        }
        let area = area.max(1.0);
        weight.iter_mut().for_each(|w| *w /= area);
        let rays = rgba.len() / 4;
        Ok(Self {
            rgba: Tensor::from_vec(rgba, [rays, 4]).cast(dtype)?,
            weight: Tensor::from_vec(weight, [rays, 4]).cast(dtype)?,
            robust: None,
            trajectory: None,
        })
    }

    /// `Σ weight · (rendered − target)²` for rendered pixels `[rays, 4]`, with `huber` in place of the square for
    /// robust pixels, plus the centroid term.
    pub fn loss(&self, rendered: &Var) -> Var {
        let tape = rendered.tape();
        let residual = rendered - &tape.constant(self.rgba.clone());
        let mut each = residual.square();
        if let Some(robust) = &self.robust {
            each = tape.constant(robust.rays.clone()).choose(&huber(&residual, robust.delta), &each);
        }
        let loss = (&each * &tape.constant(self.weight.clone())).sum_all();
        match &self.trajectory {
            Some(trajectory) => &loss + &trajectory.loss(rendered),
            None => loss,
        }
    }
}
