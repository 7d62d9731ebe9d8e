//! Sampled views of a training object.

use gradreel::{Result, Tensor};

use crate::report::animation::Picture;
use crate::report::synthesis::picture_of;
use crate::runtime::interrupt;
use crate::views::objects::{Sample, View};
use crate::views::{Detector, Ensemble, FileWeights, ModelSizes, SamplerSettings, Sampling, Score, decode, subject_of};

/// Samples all views of an object from its input image: pictures `[3, s, s]` in about −1..1, one per camera. A
/// spatial-aware module receives the detector's result.
///
/// # Errors
/// If a stop was requested, or the model cannot be evaluated.
pub(super) fn sampled(
    weights: &FileWeights,
    sizes: &ModelSizes,
    ensemble: &Ensemble,
    sample: &Sample,
    detector: Detector,
    settings: SamplerSettings,
) -> Result<Vec<Tensor>> {
    let views = sizes.denoiser.ring.views;
    let subject = subject_of(weights, sizes, sample, detector, settings.picture_key())?;
    let mut run = Sampling::begin(subject, settings, views)?;
    while !run.is_finished() {
        run.step(ensemble, &mut |_| interrupt::check())?;
    }
    let mut pictures = Vec::with_capacity(views);
    let all: Vec<usize> = (0..views).collect();
    decode(weights, sizes, run.latents(), &all, weights.device(), &mut |_, picture| {
        pictures.push(picture);
        Ok(())
    })?;
    Ok(pictures)
}

/// Mean agreement of all views.
///
/// # Errors
/// If a picture cannot be read.
pub(super) fn score(found: &[Tensor], sample: &Sample) -> Result<Score> {
    let each: Result<Vec<Score>> =
        found.iter().zip(&sample.views).map(|(found, truth)| Score::of(found, truth)).collect();
    Ok(Score::mean(&each?))
}

/// Two rows: the input image and some true views; below, an empty cell and the sampled views.
///
/// # Errors
/// If a picture has a non-finite pixel.
pub(super) fn rows(found: &[Tensor], sample: &Sample, columns: usize) -> Result<Vec<Picture>> {
    let shown: Vec<usize> = (0..columns).map(|column| column * found.len() / columns).collect();
    let of_view = |view: &View| picture_of(&Tensor::from_vec(view.colours.clone(), [3, view.size, view.size]));
    let mut all = vec![of_view(&sample.input)?];
    for &view in &shown {
        all.push(of_view(&sample.views[view])?);
    }
    let size = sample.input.size;
    all.push(Picture { width: size, height: size, rgb: vec![255; 3 * size * size] });
    for &view in &shown {
        all.push(picture_of(&found[view])?);
    }
    Ok(all)
}
