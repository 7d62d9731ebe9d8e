//! Samples of a training step, and the random draws for each.

use gradreel::{DType, Error, ErrorKind, Key, Result, Tensor};

use super::Plan;
use crate::views::Detection;
use crate::views::denoiser::Told;
use crate::views::schedule::TIMES;

/// A batch of training samples: views of objects, and their conditioning.
#[derive(Debug, Clone)]
pub struct Batch {
    /// Latents of all views, scaled by [`crate::views::Coding::scale`]: `[b, views, latent, w, w]`. View 0 has the
    /// azimuth of the input image.
    pub latents: Tensor,
    /// CLIP embeddings of the input images `[b, 1, context]`.
    pub embeddings: Tensor,
    /// Sampled, unscaled latents of the input images: `[b, latent, w, w]`.
    pub images: Tensor,
    /// Elevations of the input cameras in radians.
    pub elevations: Vec<f64>,
    /// Detections for the spatial-aware module: one per sample, or none at all.
    pub boxes: Vec<Option<Detection>>,
}

impl Batch {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.elevations.len()
    }

    pub(super) fn check(&self, views: usize, latent: usize, context: usize) -> Result<()> {
        let b = self.len();
        let wrong = |what: &str, found: &Tensor, wanted: String| {
            Err(Error::new(ErrorKind::Shape, format!("the {what} of a batch do not fit the model"))
                .found(found.shape())
                .wanted(wanted))
        };
        let square = |dims: &[usize]| dims.len() == 2 && dims[0] == dims[1];
        let fits = |x: &Tensor, first: &[usize]| x.dims().starts_with(first) && square(&x.dims()[first.len()..]);
        if b == 0 {
            return Err(Error::new(ErrorKind::Input, "a batch has no samples").fix("give one elevation for each"));
        }
        if !fits(&self.latents, &[b, views, latent]) {
            return wrong("latents", &self.latents, format!("[{b}, {views}, {latent}, w, w], one for each elevation"));
        }
        if !fits(&self.images, &[b, latent]) || self.images.dims()[2] != self.latents.dims()[3] {
            return wrong("images", &self.images, format!("[{b}, {latent}, w, w] with the w of the latents"));
        }
        if !self.boxes.is_empty() && self.boxes.len() != b {
            return Err(Error::new(ErrorKind::Input, "a batch has boxes for some samples only")
                .found(self.boxes.len())
                .wanted(format!("{b}, or none at all")));
        }
        if *self.embeddings.dims() != [b, 1, context] {
            return wrong("embeddings", &self.embeddings, format!("[{b}, 1, {context}]"));
        }
        Ok(())
    }
}

/// Random draws for one sample of a batch.
#[derive(Debug, Clone)]
pub struct Draw {
    /// Diffusion time, below [`TIMES`].
    pub time: usize,
    /// The views whose noise is predicted.
    pub views: Vec<usize>,
    /// Conditions given to the model.
    pub told: Told,
    /// The noise of all views: `[views, latent, w, w]`, standard normal.
    pub noise: Tensor,
}

impl Draw {
    /// A draw that depends only on the key and the sample's index, so that a resumed training uses the same
    /// numbers.
    pub(super) fn new(key: Key, sample: usize, noise: &[usize], plan: &Plan) -> Self {
        let [times, view, told, numbers] = key.fold(sample as u64).split();
        let one = |key: Key, below: usize| key.below(below, 1).next().expect("one number");
        // the first views of a shuffled ring
        let mut views: Vec<usize> = (0..noise[0]).collect();
        for place in 0..plan.targets.min(noise[0]) {
            let key = if place == 0 { view } else { view.fold(place as u64) };
            views.swap(place, place + one(key, noise[0] - place));
        }
        views.truncate(plan.targets);
        let chance = told.uniform(1).next().expect("one number");
        let ways = [Told::Nothing, Told::NoImage, Told::NoVolumes, Told::NoToken];
        let way = ways.iter().zip(1..).find(|(_, place)| chance < plan.dropped * f64::from(*place));
        Self {
            time: one(times, TIMES),
            views,
            told: way.map_or(Told::All, |(told, _)| *told),
            noise: Tensor::normal(numbers, noise, DType::F32),
        }
    }

    /// Rejects a draw that does not fit the model.
    pub(super) fn check(&self, noise: &[usize]) -> Result<()> {
        let views = !self.views.is_empty() && self.views.iter().all(|view| *view < noise[0]);
        if self.time < TIMES && views && self.noise.dims() == noise {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "a draw does not fit the batch")
            .found(format!("time {}, views {:?}, noise {}", self.time, self.views, self.noise.shape()))
            .wanted(format!("a time below {TIMES}, views below {}, noise {noise:?}", noise[0])))
    }
}
