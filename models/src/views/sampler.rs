//! The sampler: a run of DDIM steps as a state that can be saved after any view and gone on with.

use gradreel::{DType, Error, ErrorKind, Key, Result, Shape, Tape, Tensor, Var};

use super::{Ddim, Schedule, Subject, on_cpu};

/// What decides the result of a run, beside the model and the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SamplerSettings {
    /// Steps asked for; where they do not divide 1000 there are somewhat more (see [`Ddim::new`]).
    pub steps: usize,
    /// Strength of the classifier-free guidance; 1: none, at half the work.
    pub guidance: f64,
    /// The same seed gives the same views, whatever the number of threads and of views at once.
    pub seed: u64,
}

impl Default for SamplerSettings {
    /// 50 steps, guidance 2, seed 0.
    fn default() -> Self {
        Self { steps: 50, guidance: 2.0, seed: 0 }
    }
}

impl SamplerSettings {
    /// The key of the noise in the latent of the input picture.
    pub fn picture_key(&self) -> Key {
        self.keys()[0]
    }

    /// Whether a run can be made with them.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when a setting makes no sense.
    pub fn check(&self) -> Result<()> {
        if !self.guidance.is_finite() {
            return Err(Error::new(ErrorKind::Input, "the guidance is not a number")
                .found(self.guidance)
                .wanted("a number such as 1.5 or 2")
                .fix("choose another guidance"));
        }
        Ddim::new(&Schedule::published(), self.steps).map(|_| ())
    }

    /// Of the noise in the picture's latent, the first latents, and the noise of the steps.
    fn keys(&self) -> [Key; 3] {
        Key::new(self.seed).split()
    }
}

/// One evaluation of the model that a [`Predictor`] is asked for.
pub struct Moment<'a> {
    /// All noised views `[1, views, latent, w, w]`, on the CPU.
    pub latents: &'a Tensor,
    /// The step, counted down to 0.
    pub index: usize,
    /// The diffusion time.
    pub time: usize,
    /// The input picture.
    pub subject: &'a Subject,
    /// Strength of the guidance.
    pub guidance: f64,
}

/// What predicts the noise in noised views: [`super::Ensemble`], or a stand-in of a test.
pub trait Predictor {
    /// Predicts the noise `[1, latent, w, w]` of some views and hands each to `found` with its number, in any order, on the
    /// CPU. Ends with the error that `found` returns, if it does.
    ///
    /// # Errors
    /// When the model cannot be evaluated.
    fn predict(
        &self,
        moment: &Moment<'_>,
        views: &[usize],
        found: &mut dyn FnMut(usize, Tensor) -> Result<()>,
    ) -> Result<()>;

    /// Whether the result of a run is the clean latents that its last step estimates. Otherwise it is those of diffusion time 0 with
    /// their little noise, as published.
    fn ends_clean(&self) -> bool {
        false
    }
}

/// A run of the sampler: noised latents of all views, and what is known of the next step.
///
/// ```
/// use gradreel::{DType, Key, Result, Tensor};
/// use gradreel_models::views::{Moment, Predictor, SamplerSettings, Sampling, Subject};
///
/// /// A model that takes all it sees for noise.
/// struct Doubter;
/// impl Predictor for Doubter {
///     fn predict(
///         &self,
///         moment: &Moment<'_>,
///         views: &[usize],
///         found: &mut dyn FnMut(usize, Tensor) -> Result<()>,
///     ) -> Result<()> {
///         let all = moment.latents.slice::<f32>();
///         let size = all.len() / moment.latents.dims()[1];
///         views.iter().try_for_each(|&v| {
///             found(v, Tensor::from_vec(all[v * size..][..size].to_vec(), [1, 4, 2, 2]))
///         })
///     }
/// }
///
/// let latent = Tensor::zeros([1, 4, 2, 2], DType::F32);
/// let subject = Subject { embedding: Tensor::zeros([1, 1, 8], DType::F32), latent, elevation: 0.5, seen: None };
/// let settings = SamplerSettings { steps: 4, ..SamplerSettings::default() };
/// let mut run = Sampling::begin(subject, settings, 3)?;
/// run.step(&Doubter, &mut |_| Ok(()))?;
/// let mut other = Sampling::from_file(&run.to_file())?;
/// while !run.is_finished() {
///     run.step(&Doubter, &mut |_| Ok(()))?;
///     other.step(&Doubter, &mut |_| Ok(()))?;
/// }
/// assert_eq!(run.latents().slice::<f32>(), other.latents().slice::<f32>());
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Sampling {
    pub(super) subject: Subject,
    pub(super) settings: SamplerSettings,
    pub(super) ddim: Ddim,
    /// `[1, views, latent, w, w]`
    pub(super) latents: Tensor,
    /// Steps that are done.
    pub(super) done: usize,
    /// The noise of the views that are known already of the next step.
    pub(super) predicted: Vec<Option<Tensor>>,
    /// The estimate of the clean latents that the last step made.
    clean: Option<Tensor>,
}

impl Sampling {
    /// A run for a picture, from noise in so many views.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when a setting makes no sense.
    pub fn begin(subject: Subject, settings: SamplerSettings, views: usize) -> Result<Self> {
        let key = settings.keys()[1];
        let latents = noise(key, views, subject.latent.shape(), subject.latent.dtype())?;
        Self::begin_from(subject, settings, latents)
    }

    /// A run from given latents `[1, views, latent, w, w]`.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when a setting makes no sense.
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

    /// The latents `[1, views, latent, w, w]` as they are; the result when the run is finished.
    pub fn latents(&self) -> &Tensor {
        &self.latents
    }

    /// The clean latents that the last step estimated; `None` before the first, and right after the run was read from a
    /// file.
    pub fn clean(&self) -> Option<&Tensor> {
        self.clean.as_ref()
    }

    /// Number of views.
    pub fn views(&self) -> usize {
        self.predicted.len()
    }

    /// Steps that are done.
    pub fn done(&self) -> usize {
        self.done
    }

    /// Steps in all.
    pub fn steps(&self) -> usize {
        self.ddim.len()
    }

    /// Views that are known already of the next step.
    pub fn known(&self) -> usize {
        self.predicted.iter().flatten().count()
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.done == self.steps()
    }

    /// Predicts what is not known yet of the next step. `watch` is called with the number of known views after each; an
    /// error that it returns ends the work and loses nothing that is known.
    ///
    /// # Errors
    /// What the predictor or `watch` returns; [`ErrorKind::NonFinite`] when a prediction holds NaN or infinity.
    ///
    /// # Panics
    /// When the run is finished, or a prediction has another shape than a view.
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

    /// Ends a step whose predictions are all known with given noise, of the shape of the latents; the last step adds none.
    ///
    /// # Errors
    /// When the tape reports a fault.
    ///
    /// # Panics
    /// When a prediction is missing.
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

    /// One step: predicts all views and goes on with noise of the run's seed. `watch` is as in [`Sampling::predict`].
    ///
    /// # Errors
    /// As [`Sampling::predict`] and [`Sampling::update`].
    ///
    /// # Panics
    /// When the run is finished.
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

/// Normal numbers `[1, views, ..latent]`, those of each view from a key of its own.
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

/// Tensors one after the other along the first axis.
fn side_by_side(tape: &Tape, parts: &[Tensor]) -> Var {
    let parts: Vec<Var> = parts.iter().map(|part| tape.constant(part.clone())).collect();
    parts[0].concat(&parts[1..].iter().collect::<Vec<_>>(), 0)
}
