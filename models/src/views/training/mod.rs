//! Training of the multi-view model: the noise in some views is predicted from all views, with most of the
//! published weights frozen (Liu et al. 2023).

mod draw;
mod encoding;
mod plan;
mod sources;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use gradreel::io::TensorFile;
use gradreel::optim::{Adam, Ema, Load, Params, Update};
use gradreel::{DType, Device, Error, ErrorKind, Key, Memory, Result, Tape, Tensor, Var};
use rayon::prelude::*;

pub use draw::{Batch, Draw};
pub use encoding::{Detector, encode, subject_of};
pub use plan::Plan;

use self::sources::{Fixed, Picked, Source};
use super::weights::File;
use super::{Condition, Denoiser, DenoiserSizes, Ensemble, FileWeights, ModelSizes, Schedule, Target, Told};
use crate::layers::{Scope, Weights, initialise, listing};

/// A resumable training: the trained weights, the optimiser's moments, and the number of steps.
///
/// Frozen weights stay in their file ([`FileWeights`]). Checkpoints ([`Training::save`]) are safetensors with the
/// trained weights under the published names, and the optimiser's state under `optimizer.`.
pub struct Training {
    plan: Plan,
    sizes: DenoiserSizes,
    frozen: Arc<File>,
    params: Params,
    adam: Adam,
    average: Option<Ema>,
    schedule: Schedule,
}

/// Result of one training step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Mean squared error of the prediction ([`super::Output`]).
    pub loss: f64,
    /// The optimiser's update.
    pub update: Update,
    /// Memory that the tapes of the step held for their backward passes.
    pub memory: Memory,
}

/// The gradients of a batch.
pub struct BatchGradients {
    /// Mean squared error of the prediction ([`super::Output`]).
    pub loss: f64,
    /// Gradients by path.
    pub by_path: BTreeMap<String, Tensor>,
    /// Peak memory of the tapes.
    pub memory: Memory,
}

impl Training {
    /// Starts a training from a weights file. Trained weights missing in the file are initialised, such as those of
    /// the volume path if the file is that of a single-view model.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for missing frozen weights, weights of the wrong shape, or an invalid plan.
    pub fn new(weights: FileWeights, sizes: DenoiserSizes, plan: Plan) -> Result<Self> {
        let all = listing(|scope| Denoiser::new(scope, &sizes))?;
        for (prefix, _) in &plan.trained {
            let alone = Plan { trained: vec![(prefix.clone(), 0.0)], ..plan.clone() };
            if !all.iter().any(|(path, _)| alone.trains(path)) {
                return Err(Error::new(ErrorKind::Input, "nothing has the prefix of what is to be trained").at(prefix));
            }
        }
        let none = plan.at_once == 0 || plan.side_by_side == 0 || plan.targets == 0;
        if none || !(0.0..=0.25).contains(&plan.dropped) {
            return Err(Error::new(ErrorKind::Input, "the training cannot follow its plan")
                .found(format!(
                    "{} samples at once, {} groups side by side, {} targets, {} dropped",
                    plan.at_once, plan.side_by_side, plan.targets, plan.dropped
                ))
                .wanted("at least one sample at once, one group and one target, and a probability of at most 1/4 for each of four ways"));
        }
        let mut report = weights.check(&all);
        let fresh: Vec<String> = report.missing.iter().filter(|path| plan.trains(path)).cloned().collect();
        report.missing.retain(|path| !plan.trains(path));
        report.into_result()?;
        let device = weights.device().clone();
        let mut params = Params::new();
        if !fresh.is_empty() {
            let only = |scope: &Scope<'_>| {
                let picked = Picked { inner: scope.weights(), tape: Tape::new(), fresh: &fresh };
                Denoiser::new(&Scope::root(&picked), &sizes)
            };
            for (path, value) in initialise(Key::new(plan.seed).fold(START), DType::F32, only)?.iter() {
                params.set(path, value.to_device(&device)?);
            }
        }
        for (path, shape) in all.iter().filter(|(path, _)| plan.trains(path) && !fresh.contains(path)) {
            params.set(path, weights.tensor(path, shape)?.cast(DType::F32)?.to_device(&device)?);
        }
        let (adam, average) = (plan.optimiser(), plan.average.map(Ema::new));
        Ok(Self { plan, sizes, frozen: weights.file().clone(), params, adam, average, schedule: Schedule::published() })
    }

    /// Number of completed steps.
    pub fn steps(&self) -> u64 {
        self.adam.steps()
    }

    /// The trained weights.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// One step: gradients of the batch, then the optimiser's update.
    ///
    /// # Errors
    /// As [`Training::gradients`]; [`ErrorKind::NonFinite`] for a non-finite gradient, which leaves the training
    /// unchanged.
    pub fn step(&mut self, batch: &Batch) -> Result<Step> {
        let BatchGradients { loss, by_path, memory } = self.gradients(batch)?;
        let update = self.adam.step(&mut self.params, &by_path)?;
        if let Some(average) = &mut self.average {
            average.update(&self.params)?;
        }
        Ok(Step { loss, update, memory })
    }

    /// Loss and gradients of a batch at the current step: means over the samples, independent of the group size.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] for a batch that does not fit the model; [`ErrorKind::Device`] if a device fails.
    pub fn gradients(&self, batch: &Batch) -> Result<BatchGradients> {
        let key = Key::new(self.plan.seed).fold(TRAINING).fold(self.steps());
        self.gradients_at(batch, &self.draws(batch, key, &self.plan)?)
    }

    /// As [`Training::gradients`], with given times, views and noise: one draw per sample.
    ///
    /// # Errors
    /// As [`Training::gradients`]; [`ErrorKind::Input`] for a draw that does not fit the batch.
    pub fn gradients_at(&self, batch: &Batch, draws: &[Draw]) -> Result<BatchGradients> {
        let groups: Vec<Range<usize>> = self.groups(batch, draws)?.collect();
        let mut sum = BatchGradients { loss: 0.0, by_path: BTreeMap::new(), memory: Memory::default() };
        for side_by_side in groups.chunks(self.plan.side_by_side) {
            let each = side_by_side.par_iter().map(|group| self.gradients_of(batch, draws, group.clone()));
            let each = each.collect::<Result<Vec<_>>>()?;
            let [held, peak] = [|m: &Memory| m.held, |m: &Memory| m.peak]
                .map(|of| each.iter().map(|found| of(&found.memory)).sum::<usize>());
            sum.memory = Memory { held, peak: peak.max(sum.memory.peak) };
            // summed in fixed order, whichever finishes first
            for found in each {
                sum.loss += found.loss;
                for (path, gradient) in found.by_path {
                    let total = match sum.by_path.remove(&path) {
                        None => gradient,
                        Some(before) => {
                            let adding = Tape::new();
                            (&adding.constant(before) + &adding.constant(gradient)).value()?.clone()
                        }
                    };
                    sum.by_path.insert(path, total);
                }
            }
        }
        Ok(sum)
    }

    /// Contribution of some samples to the loss and gradients of their batch.
    fn gradients_of(&self, batch: &Batch, draws: &[Draw], group: Range<usize>) -> Result<BatchGradients> {
        let tape = Tape::new();
        let bound = self.params.bind(&tape);
        let share = group.len() as f64 / batch.len() as f64;
        let loss = &self.loss(&tape, &bound, batch, draws, group)? * share;
        let value = loss.item()?;
        let by_path = bound.gradients(&loss.into_gradients()?)?;
        Ok(BatchGradients { loss: value, by_path, memory: tape.memory() })
    }

    /// The loss of a batch with all conditions, without a step. Equal values of `turn` draw equal times, views and
    /// noise at any stage of the training, so that losses are comparable.
    ///
    /// # Errors
    /// As [`Training::gradients`].
    pub fn validate(&self, batch: &Batch, turn: u64) -> Result<f64> {
        let all = Plan { dropped: 0.0, ..self.plan.clone() };
        let draws = self.draws(batch, Key::new(self.plan.seed).fold(VALIDATION).fold(turn), &all)?;
        let mut sum = 0.0;
        for group in self.groups(batch, &draws)? {
            let tape = Tape::new();
            let fixed = Fixed { params: &self.params, tape: &tape };
            let share = group.len() as f64 / batch.len() as f64;
            sum += share * self.loss(&tape, &fixed, batch, &draws, group)?.item()?;
        }
        Ok(sum)
    }

    /// Random draws for each sample of a batch.
    fn draws(&self, batch: &Batch, key: Key, plan: &Plan) -> Result<Vec<Draw>> {
        batch.check(self.sizes.ring.views, self.sizes.volume.latent, self.sizes.unet.context)?;
        let noise = &batch.latents.dims()[1..];
        Ok((0..batch.len()).map(|sample| Draw::new(key, sample, noise, plan)).collect())
    }

    /// The groups of samples that are evaluated together.
    fn groups(&self, batch: &Batch, draws: &[Draw]) -> Result<impl Iterator<Item = Range<usize>> + use<>> {
        batch.check(self.sizes.ring.views, self.sizes.volume.latent, self.sizes.unet.context)?;
        draws.iter().try_for_each(|draw| draw.check(&batch.latents.dims()[1..]))?;
        let (count, at_once) = (batch.len(), self.plan.at_once);
        if draws.len() != count {
            return Err(Error::new(ErrorKind::Input, "a batch needs one draw for each sample")
                .found(draws.len())
                .wanted(count));
        }
        Ok((0..count).step_by(at_once).map(move |first| first..(first + at_once).min(count)))
    }

    /// Contribution of some samples to the batch's mean loss.
    fn loss(
        &self,
        tape: &Tape,
        trained: &dyn Weights,
        batch: &Batch,
        draws: &[Draw],
        group: Range<usize>,
    ) -> Result<Var> {
        let draws = &draws[group.clone()];
        let source = Source { trained, plan: &self.plan, frozen: FileWeights::of(&self.frozen, tape) };
        let scope = Scope::root(&source);
        let scope = if self.plan.recomputed { scope.recomputed() } else { scope };
        let net = Denoiser::new(&scope, &self.sizes)?;
        let device = self.frozen.device();
        let constant = |x: Tensor| Ok::<_, Error>(tape.constant(x.cast(DType::F32)?.to_device(device)?));
        let of_group = |x: &Tensor| Ok::<_, Error>(constant(x.clone())?.slice(0, group.clone()));
        let latents = of_group(&batch.latents)?;
        let mut one = vec![1];
        one.extend(&latents.dims()[1..]);
        let noises = draws.iter().map(|draw| Ok(constant(draw.noise.clone())?.reshape(&*one)));
        let noises = noises.collect::<Result<Vec<Var>>>()?;
        let noise = noises[0].concat(&noises[1..].iter().collect::<Vec<_>>(), 0);
        let condition = Condition {
            embedding: of_group(&batch.embeddings)?,
            latent: of_group(&batch.images)?,
            elevations: batch.elevations[group.clone()].to_vec(),
            boxes: batch.boxes.get(group.clone()).unwrap_or_default().to_vec(),
        };
        let times: Vec<usize> = draws.iter().map(|draw| draw.time).collect();
        let of = |(sample, draw): (usize, &Draw)| draw.views.iter().map(|&view| Target { sample, view }).collect();
        let targets: Vec<Target> = draws.iter().enumerate().flat_map::<Vec<Target>, _>(of).collect();
        let told: Vec<Told> = targets.iter().map(|target| draws[target.sample].told).collect();
        let [loss, _] = net.loss(&self.schedule, [&latents, &noise], &times, &targets, &condition, &told)?;
        Ok(loss)
    }

    /// The current model (with averaged trained weights, if any) for sampling with `at_once` concurrent views.
    ///
    /// # Errors
    /// As [`Ensemble::new`].
    pub fn ensemble(&self, at_once: usize) -> Result<Ensemble> {
        let (tape, averaged) = (Tape::new(), self.averaged());
        let params = averaged.as_ref().unwrap_or(&self.params);
        let fixed = Fixed { params, tape: &tape };
        let source = Source { trained: &fixed, plan: &self.plan, frozen: FileWeights::of(&self.frozen, &tape) };
        Ensemble::new(&source, &self.sizes, self.frozen.device(), at_once)
    }

    /// The averaged trained weights, if any.
    fn averaged(&self) -> Option<Params> {
        self.average.as_ref().filter(|_| self.steps() > 0).map(|average| average.averaged(&self.params))
    }

    /// Saves the trained weights under the published names, the optimiser's state, the average if there is one, and
    /// the number of steps. The file is replaced atomically: even after a crash it holds either the old or the new
    /// content.
    ///
    /// # Errors
    /// [`ErrorKind::Io`] or [`ErrorKind::Input`] if the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let mut file = TensorFile::default();
        self.params.save(&mut file)?;
        self.adam.save(&mut file);
        if let Some(average) = &self.average {
            average.save(&mut file);
        }
        file.metadata.insert(SEED.to_owned(), self.plan.seed.to_string());
        file.write(path)
    }

    /// Resumes from a checkpoint, bitwise identical to an uninterrupted training.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a file that is not a checkpoint of a training with these weights and this seed,
    /// which leaves the training unchanged.
    pub fn resume(&mut self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let file = TensorFile::read(path)?;
        self.restore(&file).map_err(|e| e.within(path.display()))
    }

    fn restore(&mut self, file: &TensorFile) -> Result<()> {
        let seed = file.metadata.get(SEED);
        if seed.is_none_or(|seed| *seed != self.plan.seed.to_string()) {
            return Err(Error::new(ErrorKind::Input, "the checkpoint is not one of a training with this seed")
                .found(seed.map_or("no seed", |seed| seed))
                .wanted(self.plan.seed)
                .fix("give the seed with which the training began"));
        }
        let (mut params, mut adam, mut average) = (self.params.clone(), self.adam.clone(), self.average.clone());
        params.load(file, &Load::strict())?;
        adam.restore(file)?;
        if let Some(average) = &mut average {
            average.restore(file)?;
        }
        (self.params, self.adam, self.average) = (params, adam, average);
        Ok(())
    }

    /// Writes a complete model: the original file with its trained weights replaced (by their average, if there is
    /// one). It can be loaded like any other weights file, also by PyTorch programs.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for an unreadable entry of the original file; [`ErrorKind::Io`] if writing fails.
    pub fn export(&self, path: impl AsRef<Path>) -> Result<()> {
        let frozen = FileWeights::of(&self.frozen, &Tape::new());
        let archive = frozen.archive();
        let mut file = TensorFile { tensors: BTreeMap::new(), metadata: archive.metadata().clone() };
        let before = frozen.sizes()?;
        let module = self.sizes.spatial_aware.clone();
        if before.denoiser.spatial_aware != module {
            let denoiser = DenoiserSizes { spatial_aware: module, ..before.denoiser };
            file.metadata.insert(ModelSizes::METADATA.to_owned(), ModelSizes { denoiser, ..before }.to_json());
        }
        for name in archive.names() {
            // mapped weights take no memory here
            file.tensors.insert(name.to_owned(), archive.map(name)?);
        }
        for (path, value) in self.averaged().as_ref().unwrap_or(&self.params).iter() {
            file.tensors.insert(path.to_owned(), value.to_device(&Device::Cpu)?);
        }
        file.write(path)
    }
}

/// Key folds that separate the uses of the seed.
const TRAINING: u64 = 0;
const VALIDATION: u64 = 1;
const START: u64 = 2;

/// Metadata key of the seed in a checkpoint.
const SEED: &str = "training.seed";
