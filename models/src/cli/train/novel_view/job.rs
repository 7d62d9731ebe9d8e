//! One training: its folder, steps and validations.

use std::fmt;
use std::path::Path;
use std::time::Instant;

use gradreel::io::TensorFile;
use gradreel::{DType, Device, Error, ErrorKind, Key, Result};

use super::NovelView;
use super::meshes::Objects;
use super::page::page;
use super::sampled::{rows, sampled, score};
use super::samples::{chance, feed, unseen};
use super::settings::Settings;
use crate::cli::network;
use crate::cli::train::log::Log;
use crate::layers::initialise;
use crate::report::animation::Picture;
use crate::report::synthesis::sheet;
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::views::objects::Sample;
use crate::views::{Detector, FileWeights, Model, ModelSizes, SamplerSettings, Score, Training, encode};

const SETTINGS: &str = "settings.toml";
/// Initial weights of a model trained from scratch.
const START: &str = "start.safetensors";
const STATE: &str = "state.safetensors";
/// Columns of the tables of steps and of validations.
const COLUMNS: [&str; 2] = ["loss,rate,gradient_norm", "loss,centre_error,box_iou,psnr_db,silhouette_iou"];
const MODEL: &str = "model.safetensors";
/// Number of views in a preview, and its enlargement factor.
const SHOWN: usize = 8;
const ENLARGED: usize = 2;
/// Key of the initial weights.
const FRESH: u64 = 103;
/// Smoothing factor of the displayed loss.
const NEWEST: f64 = 0.05;

/// A prepared training.
pub(super) struct Job {
    folder: RunFolder,
    settings: Settings,
    objects: Objects,
    weights: FileWeights,
    training: Training,
    log: Log,
}

impl Job {
    /// Starts a new training. Invalid input is rejected before anything is written.
    pub fn begin(arguments: &NovelView, progress: &Progress) -> Result<Self> {
        let (mut settings, given) = Settings::resolve(arguments)?;
        if given.is_none() && settings.model.denoiser.spatial_aware.is_some() {
            return Err(Error::new(ErrorKind::Input, "there is no model whose module could be trained")
                .at("--weights")
                .wanted("the weights of a base model: a safetensors file or a PyTorch checkpoint")
                .fix("train one first with `gradreel train novel-view`, or give the public weights of SyncDreamer"));
        }
        let device = settings.device.device()?;
        if let Some(weights) = &given {
            // all frozen weights must exist
            Training::new(weights.clone(), settings.model.denoiser.clone(), settings.plan())?;
        }
        let objects = Objects::open(&mut settings, progress)?;
        objects.can_train()?;
        let folder = match &arguments.out {
            Some(folder) => RunFolder::create(folder)?,
            None => RunFolder::create_free(Path::new("runs"), "novel-view")?,
        };
        folder.write(SETTINGS, settings.to_toml().as_bytes())?;
        objects.list(&folder)?;
        let path = match &arguments.weights {
            Some(path) => path.clone(),
            None => {
                folder.write(START, &fresh(&settings)?.to_bytes()?)?;
                folder.path(START)
            }
        };
        Self::open(folder, settings, objects, &path, &device)
    }

    /// Resumes the training in a folder.
    pub fn resume(arguments: &NovelView, progress: &Progress) -> Result<Self> {
        let folder = RunFolder::resume(arguments.out.as_deref().unwrap_or(Path::new(".")))?;
        let fix = "give the folder of an interrupted training to --out, or begin one without --resume";
        folder.goes_on(SETTINGS, "there is no training to go on with", fix)?;
        let text = folder.read_text(SETTINGS)?;
        let mut settings = Settings::parse(&text).map_err(|e| e.within(folder.path(SETTINGS).display()))?;
        let path = match &settings.weights {
            None => folder.path(START),
            Some(source) => {
                let path = arguments.weights.as_deref().unwrap_or(Path::new(&source.path));
                source.found_again(path, "the weights")?;
                path.to_owned()
            }
        };
        match (&mut settings.objects, &arguments.objects) {
            (Some(meshes), Some(moved)) => meshes.set(moved),
            (None, Some(_)) => {
                return Err(Error::new(ErrorKind::Input, "the training was begun with procedural objects")
                    .at("--objects")
                    .fix("leave it out, or begin another training"));
            }
            (_, None) => {}
        }
        let objects = Objects::open(&mut settings, progress)?;
        let device = settings.device.device()?;
        let mut job = Self::open(folder, settings, objects, &path, &device)?;
        if job.folder.has(STATE) {
            job.training.resume(job.folder.path(STATE))?;
            job.log = Log::open(&job.folder, COLUMNS, job.training.steps())?;
        }
        Ok(job)
    }

    fn open(folder: RunFolder, settings: Settings, objects: Objects, weights: &Path, device: &Device) -> Result<Self> {
        let weights = network::open(weights, device)?;
        let training = Training::new(weights.clone(), settings.model.denoiser.clone(), settings.plan())?;
        Ok(Self { folder, settings, objects, weights, training, log: Log::new(COLUMNS) })
    }

    /// Folder of the results.
    pub fn folder(&self) -> &RunFolder {
        &self.folder
    }

    /// Runs all remaining steps.
    pub fn finish(&mut self, progress: &Progress, told: bool) -> Result<()> {
        let Settings { steps, checkpoint_every, .. } = self.settings;
        let every = self.settings.validation.every;
        let sizes = self.settings.model.clone();
        let count = self.settings.validation.samples.max(self.settings.validation.shapes);
        let unseen = unseen(&self.settings, &self.objects, count)?;
        let first = self.training.steps();
        let feed = feed(&self.settings, &self.objects, first)?;
        let stage = progress.stage("training", steps - first);
        let (begun, mut resting, mut shown) = (Instant::now(), 0.0, None);
        loop {
            let made = self.training.steps();
            let due = made == steps || (every > 0 && made > 0 && made.is_multiple_of(every));
            if due && !self.log.looked(made) {
                self.save()?;
                let before = Instant::now();
                let (loss, score) = self.look(&unseen)?;
                let Score { centre, overlap, psnr, silhouette } = score;
                self.log.look(made, &[loss, centre, overlap, psnr, silhouette]);
                self.save()?;
                self.folder.write("index.html", page(&self.settings, &self.log).as_bytes())?;
                resting += before.elapsed().as_secs_f64();
                if told {
                    progress.stage(&format!("after {made} steps"), 1).finish(&described(loss, &score));
                }
            }
            if made == steps {
                break;
            }
            let samples = feed.next()?;
            let key = chance(&self.settings, made);
            let batch = encode(&self.weights, &sizes, &samples, self.settings.detector, key)?;
            let step = self.training.step(&batch)?;
            let update = &step.update;
            self.log.step(update.step, &[step.loss, update.rate, update.gradient_norm]);
            let average = shown.map_or(step.loss, |old: f64| old + NEWEST * (step.loss - old));
            shown = Some(average);
            let done = step.update.step - first;
            let pace = (begun.elapsed().as_secs_f64() - resting) / done as f64;
            let norm = step.update.gradient_norm;
            stage.set(
                done,
                &format!("step {}, loss {average:.4}, gradient {norm:.2}, {pace:.2} s a step", step.update.step),
            );
            let stop = interrupt::requested();
            if stop || step.update.step.is_multiple_of(checkpoint_every) {
                self.save()?;
            }
            if stop {
                interrupt::check()?;
            }
        }
        self.training.export(self.folder.path(MODEL))?;
        stage.finish(&shown.map_or(String::new(), |loss| format!("loss {loss:.4}")));
        Ok(())
    }

    /// Saves the tables first: rows beyond the saved state are dropped on resuming.
    fn save(&self) -> Result<()> {
        self.log.write(&self.folder)?;
        self.training.save(self.folder.path(STATE))
    }

    /// Loss of held-out objects, and agreement of the views of some. Writes a preview.
    fn look(&self, unseen: &[Sample]) -> Result<(f64, Score)> {
        let Settings { model, validation, optimiser, .. } = &self.settings;
        let (mut loss, mut count) = (0.0, 0);
        for (turn, samples) in unseen[..validation.samples].chunks(optimiser.batch).enumerate() {
            let key = Key::new(self.settings.seed).fold(turn as u64);
            let batch = encode(&self.weights, model, samples, Detector::EXACT, key)?;
            loss += samples.len() as f64 * self.training.validate(&batch, turn as u64)?;
            count += samples.len();
            interrupt::check()?;
        }
        let at_once = self.settings.device.at_once(model.denoiser.ring.views);
        let ensemble = self.training.ensemble(at_once)?;
        let columns = SHOWN.min(model.denoiser.ring.views);
        let (mut scores, mut shown) = (Vec::new(), Vec::new());
        for (seed, sample) in unseen[..validation.shapes].iter().enumerate() {
            let settings =
                SamplerSettings { steps: validation.steps, guidance: validation.guidance, seed: seed as u64 };
            let found = sampled(&self.weights, model, &ensemble, sample, Detector::EXACT, settings)?;
            scores.push(score(&found, sample)?);
            shown.extend(rows(&found, sample, columns)?);
        }
        if !shown.is_empty() {
            let preview = sheet(&[Picture::grid(columns + 1, &shown)], ENLARGED)?;
            self.folder.write(&format!("previews/step_{:07}.png", self.training.steps()), &preview)?;
        }
        Ok((loss / f64::from(count.max(1) as u32), Score::mean(&scores)))
    }
}

/// A score, for display.
pub(super) fn described(loss: f64, score: &Score) -> String {
    let Score { centre, overlap, psnr, silhouette } = score;
    format!(
        "unseen objects: loss {loss:.4}, centre off by {:.1} % of the image, box IoU {overlap:.2}, PSNR {psnr:.1} dB, \
         silhouette IoU {silhouette:.2}",
        100.0 * centre
    )
}

/// Initial weights of a model.
fn fresh(settings: &Settings) -> Result<TensorFile> {
    let key = Key::new(settings.seed).fold(FRESH);
    let params = initialise(key, DType::F32, |scope| Model::new(scope, &settings.model))?;
    let mut file = TensorFile::default();
    params.save(&mut file)?;
    file.metadata.insert(ModelSizes::METADATA.to_owned(), settings.model.to_json());
    Ok(file)
}

impl fmt::Display for Job {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { settings, objects, training, folder, .. } = self;
        if let Some(told) = objects.described() {
            writeln!(f, "{told}")?;
        }
        let trained: usize = training.params().iter().map(|(_, weight)| weight.len()).sum();
        write!(
            f,
            "{trained} numbers trained, {} views of {}² pixels, {} samples of {} views a step, step {} of {} → {}",
            settings.model.denoiser.ring.views,
            settings.model.image,
            settings.optimiser.batch,
            settings.optimiser.targets,
            training.steps(),
            settings.steps,
            folder.root().display()
        )
    }
}
