//! The sampler: a DDIM run as a state that can be saved after any view and resumed.

use gradreel::{DType, Error, ErrorKind, Key, Result, Shape, Tape, Tensor, Var};

use super::{Ddim, Schedule, Subject, on_cpu};

/// Settings that determine a run's result, besides model and picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SamplerSettings {
    /// Requested steps; if they do not divide 1000, there are slightly more (see `Ddim::new`).
    pub steps: usize,
    /// Strength of the classifier-free guidance; 1 disables it and halves the cost.
    pub guidance: f64,
    /// Random seed. The result does not depend on the number of threads or of concurrent views.
    pub seed: u64,
}

impl Default for SamplerSettings {
    /// 50 steps, guidance 2, seed 0.
    fn default() -> Self {
        Self { steps: 50, guidance: 2.0, seed: 0 }
    }
}

impl SamplerSettings {
    /// Key of the noise in the input picture's latent.
    pub fn picture_key(&self) -> Key {
        self.keys()[0]
    }

    /// Validates the settings.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for an invalid setting.
    pub fn check(&self) -> Result<()> {
        if !self.guidance.is_finite() {
            return Err(Error::new(ErrorKind::Input, "the guidance is not a number")
                .found(self.guidance)
                .wanted("a number such as 1.5 or 2")
                .fix("choose another guidance"));
        }
        Ddim::new(&Schedule::published(), self.steps).map(|_| ())
    }

    /// Keys of the picture's latent, of the initial latents, and of the steps.
    fn keys(&self) -> [Key; 3] {
        Key::new(self.seed).split()
    }
}

/// One model evaluation requested from a [`Predictor`].
pub struct Moment<'a> {
    /// All noised views `[1, views, latent, w, w]`, on the CPU.
    pub latents: &'a Tensor,
    /// Index of the step, counted down to 0.
    pub index: usize,
    /// The diffusion time.
    pub time: usize,
    /// The input picture.
    pub subject: &'a Subject,
    /// Strength of the guidance.
    pub guidance: f64,
}

/// Predicts the noise in noised views: [`super::Ensemble`], or a stub in a test.
pub trait Predictor {
    /// Predicts the noise `[1, latent, w, w]` of some views and passes each with its index to `found`, in any
    /// order, on the CPU. Returns the first error of `found`, if any.
    ///
    /// # Errors
    /// If the model cannot be evaluated.
    fn predict(
        &self,
        moment: &Moment<'_>,
        views: &[usize],
        found: &mut dyn FnMut(usize, Tensor) -> Result<()>,
    ) -> Result<()>;

    /// Whether the result of a run is the last step's estimate of the clean latents. Otherwise it is the latents at
    /// diffusion time 0, including their residual noise, as published.
    fn ends_clean(&self) -> bool {
        false
    }
}

/// A run of the sampler: noised latents of all views, and the known predictions of the next step.
#[derive(Debug, Clone)]
pub struct Sampling {
    pub(super) subject: Subject,
    pub(super) settings: SamplerSettings,
    pub(super) ddim: Ddim,
    /// `[1, views, latent, w, w]`
    pub(super) latents: Tensor,
    /// Completed steps.
    pub(super) done: usize,
    /// Known noise predictions of the next step, per view.
    pub(super) predicted: Vec<Option<Tensor>>,
    /// Estimate of the clean latents from the last step.
    clean: Option<Tensor>,
}

impl Sampling {
    /// Starts a run for a picture from noise in `views` views.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for an invalid setting.
    pub fn begin(subject: Subject, settings: SamplerSettings, views: usize) -> Result<Self> {
        let key = settings.keys()[1];
        let latents = noise(key, views, subject.latent.shape(), subject.latent.dtype())?;
        Self::begin_from(subject, settings, latents)
    }

    /// Starts a run from given latents `[1, views, latent, w, w]`.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for an invalid setting.
    pub fn begin_from(subject: Subject, settings: SamplerSettings, latents: Tensor) -> Result<Self> {
        let refuse = |what: &str, found: String, wanted: &str| {
            Err(Error::new(ErrorKind::Input, what).found(found).wanted(wanted).fix("choose another value"))
        };
        settings.check()?;
        if subject.elevation.is_nan() || subject.elevation.abs() > std::f64::consts::FRAC_PI_2 {
            let degrees = subject.elevation.to_degrees();
            return refuse("there is no such elevation", format!("{degrees}°"), "−90° to 90°");
        }
        if latents.dims().len() != 5 || latents.dims()[0] != 1 || latents.dims()[1] == 0 {
            return refuse("these are not the latents of views", latents.shape().to_string(), "[1, views, c, h, w]");
        }
        let ddim = Ddim::new(&Schedule::published(), settings.steps)?;
        let predicted = vec![None; latents.dims()[1]];
        Ok(Self { subject, settings, ddim, latents, done: 0, predicted, clean: None })
    }

    /// The input picture.
    pub fn subject(&self) -> &Subject {
        &self.subject
    }

    /// The settings.
    pub fn settings(&self) -> &SamplerSettings {
        &self.settings
    }

    /// Current latents `[1, views, latent, w, w]`; the result once the run is finished.
    pub fn latents(&self) -> &Tensor {
        &self.latents
    }

    /// Clean latents as estimated by the last step; `None` before the first step and right after reading a run from
    /// a file.
    pub fn clean(&self) -> Option<&Tensor> {
        self.clean.as_ref()
    }

    /// Number of views.
    pub fn views(&self) -> usize {
        self.predicted.len()
    }

    /// Number of completed steps.
    pub fn done(&self) -> usize {
        self.done
    }

    /// Total number of steps.
    pub fn steps(&self) -> usize {
        self.ddim.len()
    }

    /// Number of views whose prediction for the next step is known.
    pub fn known(&self) -> usize {
        self.predicted.iter().flatten().count()
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.done == self.steps()
    }

    /// Predicts the missing views of the next step. `watch` is called after each with the number of known views; an
    /// error from it ends the call without losing known predictions.
    ///
    /// # Errors
    /// Those of the predictor or `watch`; [`ErrorKind::NonFinite`] if a prediction contains NaN or infinity.
    ///
    /// # Panics
    /// If the run is finished, or a prediction does not have the shape of a view.
    #[track_caller]
    pub fn predict(&mut self, predictor: &dyn Predictor, watch: &mut dyn FnMut(usize) -> Result<()>) -> Result<()> {
        let index = self.index();
        let Self { subject, settings, ddim, latents, predicted, done, .. } = self;
        let missing: Vec<usize> = (0..predicted.len()).filter(|&view| predicted[view].is_none()).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let time = ddim.times[index];
        let moment = Moment { latents, index, time, subject, guidance: settings.guidance };
        predictor.predict(&moment, &missing, &mut |view, noise| {
            assert_eq!(noise.dims()[1..], latents.dims()[2..], "the prediction of view {view}");
            if !noise.all_finite()? {
                return Err(Error::new(ErrorKind::NonFinite, "the model predicts a noise that is not a number")
                    .at(format!("view {view}, step {}, diffusion time {time}", *done + 1))
                    .fix("check the weights: those of another model, or rounded to too few digits, do this"));
            }
            predicted[view] = Some(noise);
            watch(predicted.iter().flatten().count())
        })
    }

    /// Completes a step whose predictions are all known, with given noise in the shape of the latents; the last
    /// step adds none.
    ///
    /// # Errors
    /// If the tape reports a fault.
    ///
    /// # Panics
    /// If a prediction is missing.
    #[track_caller]
    pub fn update(&mut self, noise: &Tensor) -> Result<()> {
        let (index, tape) = (self.index(), Tape::new());
        let parts: Option<Vec<Tensor>> = self.predicted.iter().cloned().collect();
        let parts = parts.expect("every view was predicted");
        let predicted = side_by_side(&tape, &parts).reshape(self.latents.shape().clone());
        let x = tape.constant(self.latents.clone());
        let next = self.ddim.step(index, &x, &predicted, &tape.constant(noise.clone()));
        self.clean = Some(on_cpu(&self.ddim.clean(index, &x, &predicted))?);
        self.latents = on_cpu(&next)?;
        self.done += 1;
        self.predicted.fill(None);
        Ok(())
    }

    /// One step: predicts all views and updates the latents with noise from the run's seed. `watch` is as in
    /// [`Sampling::predict`].
    ///
    /// # Errors
    /// As [`Sampling::predict`] and [`Sampling::update`].
    ///
    /// # Panics
    /// If the run is finished.
    #[track_caller]
    pub fn step(&mut self, predictor: &dyn Predictor, watch: &mut dyn FnMut(usize) -> Result<()>) -> Result<()> {
        self.predict(predictor, watch)?;
        let key = self.settings.keys()[2].fold(self.index() as u64);
        let latent = &self.subject.latent;
        let noise = noise(key, self.views(), latent.shape(), latent.dtype())?;
        self.update(&noise)?;
        if let (true, true, Some(clean)) = (self.is_finished(), predictor.ends_clean(), &self.clean) {
            self.latents = clean.clone();
        }
        Ok(())
    }

    #[track_caller]
    fn index(&self) -> usize {
        assert!(!self.is_finished(), "the run is finished");
        self.steps() - 1 - self.done
    }
}

/// Normal noise `[1, views, ..latent]` with one key per view.
fn noise(key: Key, views: usize, latent: &Shape, dtype: DType) -> Result<Tensor> {
    let tape = Tape::new();
    let each: Vec<Tensor> =
        (0..views).map(|view| Tensor::normal(key.fold(view as u64), latent.clone(), dtype)).collect();
    if each.is_empty() {
        return Err(Error::new(ErrorKind::Input, "there are no views to sample"));
    }
    let mut shape = vec![1, views];
    shape.extend(&latent.dims()[1..]);
    Ok(on_cpu(&side_by_side(&tape, &each))?.reshape(shape))
}

/// Concatenates tensors along the first axis.
fn side_by_side(tape: &Tape, parts: &[Tensor]) -> Var {
    let parts: Vec<Var> = parts.iter().map(|part| tape.constant(part.clone())).collect();
    parts[0].concat(&parts[1..].iter().collect::<Vec<_>>(), 0)
}
