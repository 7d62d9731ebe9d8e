//! One training: its folder, steps and validations.

use std::fmt;
use std::path::Path;
use std::time::Instant;

use gradreel::{Error, ErrorKind, Result};

use super::Depth;
use super::data::Solids;
use super::page::page;
use super::settings::Settings;
use crate::cli::train::log::Log;
use crate::depth::{Agreement, DepthNetwork, Training, agreement, preview};
use crate::report::synthesis::sheet;
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;

const SETTINGS: &str = "settings.toml";
const STATE: &str = "state.safetensors";
const MODEL: &str = "model.safetensors";
/// Columns of the tables of steps and of validations.
const COLUMNS: [&str; 2] =
    ["loss,front_error,overlap,rate,gradient_norm", "iou,iou_as_deep_as_wide,front_error,back_error,wrong_sign"];
/// Pictures of a preview, and its enlargement factor.
const SHOWN: usize = 12;
const ENLARGED: usize = 2;
/// Smoothing factor of the displayed loss.
const NEWEST: f64 = 0.02;

/// A prepared training.
pub(super) struct Job {
    folder: RunFolder,
    settings: Settings,
    solids: Solids,
    training: Training,
    log: Log,
}

impl Job {
    /// Starts a new training. Invalid input is rejected before anything is written.
    pub fn begin(arguments: &Depth, progress: &Progress) -> Result<Self> {
        let settings = Settings::resolve(arguments)?;
        let Some(shapes) = &settings.shapes else {
            return Err(Error::new(ErrorKind::Input, "there are no shapes to learn from")
                .at("--shapes")
                .wanted("a folder with shapes_train.safetensors and shapes_val.safetensors")
                .fix("give it; docs/guide/training.md describes the files"));
        };
        if let Some(out) = &arguments.out {
            RunFolder::can_be_created(out)?;
        }
        let solids = Solids::open(&settings, shapes.found_again(None)?, progress)?;
        let training = training(&settings, arguments.weights())?;
        let folder = match &arguments.out {
            Some(folder) => RunFolder::create(folder)?,
            None => RunFolder::create_free(Path::new("runs"), "depth")?,
        };
        folder.write(SETTINGS, settings.to_toml().as_bytes())?;
        Ok(Self { folder, settings, solids, training, log: Log::new(COLUMNS) })
    }

    /// Resumes the training in a folder.
    pub fn resume(arguments: &Depth, progress: &Progress) -> Result<Self> {
        let decided = [
            ("--config", arguments.config.is_some()),
            ("--steps", arguments.steps.is_some()),
            ("--batch", arguments.batch.is_some()),
            ("--seed", arguments.seed.is_some()),
        ];
        if let Some((option, _)) = decided.iter().find(|(_, given)| *given) {
            return Err(Error::new(ErrorKind::Input, "a run that goes on keeps its settings")
                .at(option)
                .fix("leave it out, or begin another run with --resume WEIGHTS"));
        }
        let Some(out) = &arguments.out else {
            return Err(Error::new(ErrorKind::Input, "it is not said which run goes on")
                .at("--resume")
                .wanted("--out FOLDER, or --resume WEIGHTS to begin a run from weights")
                .fix("give the folder of the run to --out"));
        };
        let folder = RunFolder::resume(out)?;
        let fix = "give the folder of an interrupted training to --out, or begin one without --resume";
        folder.goes_on(SETTINGS, "there is no training to go on with", fix)?;
        let text = folder.read_text(SETTINGS)?;
        let settings = Settings::parse(&text).map_err(|e| e.within(folder.path(SETTINGS).display()))?;
        let Some(shapes) = &settings.shapes else {
            return Err(Error::new(ErrorKind::Input, "the settings of the run do not say where its shapes are")
                .at(folder.path(SETTINGS).display())
                .fix("begin another run"));
        };
        let solids = Solids::open(&settings, shapes.found_again(arguments.shapes.as_deref())?, progress)?;
        let state = folder.has(STATE);
        let weights = match settings.weights.as_ref().filter(|_| !state) {
            Some(source) if source.path != DepthNetwork::BUILT_IN => {
                source.found_again(Path::new(&source.path), "the weights")?;
                Some(Path::new(&source.path))
            }
            source => source.map(|source| Path::new(&source.path)),
        };
        let mut training = training(&settings, weights)?;
        let mut log = Log::new(COLUMNS);
        if state {
            training.resume(folder.path(STATE))?;
            log = Log::open(&folder, COLUMNS, training.steps())?;
        }
        Ok(Self { folder, settings, solids, training, log })
    }

    /// Folder of the results.
    pub fn folder(&self) -> &RunFolder {
        &self.folder
    }

    /// Runs all remaining steps.
    pub fn finish(&mut self, progress: &Progress, told: bool) -> Result<()> {
        let Settings { steps, checkpoint_every, .. } = self.settings;
        let every = self.settings.validation.every;
        let first = self.training.steps();
        let feed = self.solids.feed(&self.settings, first)?;
        let stage = progress.stage("training", steps - first);
        let (begun, mut resting, mut shown) = (Instant::now(), 0.0, None);
        loop {
            let made = self.training.steps();
            let due = made == steps || (every > 0 && made > 0 && made.is_multiple_of(every));
            if due && !self.log.looked(made) {
                let before = Instant::now();
                let found = self.look()?;
                self.log.look(made, &columns(&found));
                self.save()?;
                self.training.export(self.folder.path(MODEL))?;
                self.folder.write("index.html", page(&self.settings, &self.log).as_bytes())?;
                resting += before.elapsed().as_secs_f64();
                if told {
                    progress.stage(&format!("after {made} steps"), 1).finish(&described(&found));
                }
            }
            if made == steps {
                break;
            }
            let step = self.training.step(&feed.next()?)?;
            self.log.step(step.step, &[step.loss, step.front, step.overlap, step.rate, step.gradient_norm]);
            let average = shown.map_or(step.loss, |old: f64| old + NEWEST * (step.loss - old));
            shown = Some(average);
            let done = step.step - first;
            let seconds = (begun.elapsed().as_secs_f64() - resting) / done as f64;
            let pace = self.settings.optimiser.batch as f64 / seconds;
            stage.set(done, &format!("step {}, loss {average:.3}, {pace:.0} pictures a second", step.step));
            let stop = interrupt::requested();
            if stop || step.step.is_multiple_of(checkpoint_every) {
                self.save()?;
            }
            if stop {
                interrupt::check()?;
            }
        }
        self.training.export(self.folder.path(MODEL))?;
        stage.finish(&shown.map_or(String::new(), |loss| format!("loss {loss:.3}")));
        Ok(())
    }

    /// Saves the tables first: rows beyond the saved state are dropped on resuming.
    fn save(&self) -> Result<()> {
        self.log.write(&self.folder)?;
        self.training.save(self.folder.path(STATE))
    }

    /// Agreement on unseen shapes. Writes a preview.
    fn look(&self) -> Result<Agreement> {
        let network = DepthNetwork::new(self.training.sizes(), self.training.averaged());
        let found = agreement(&network, &self.solids.unseen)?;
        let shown: Vec<_> = self.solids.unseen.iter().take(SHOWN).collect();
        let picture = sheet(&[preview(&network, &shown)?], ENLARGED)?;
        self.folder.write(&format!("previews/step_{:07}.png", self.training.steps()), &picture)?;
        Ok(found)
    }
}

/// The training of these settings, before its first step.
fn training(settings: &Settings, weights: Option<&Path>) -> Result<Training> {
    let given = weights.map(DepthNetwork::open).transpose()?;
    Training::new(settings.model, settings.plan(), given.as_ref().map(DepthNetwork::params))
}

fn columns(found: &Agreement) -> [f64; 5] {
    let Agreement { overlap, flat, front, back, wrong_sign } = *found;
    [overlap, flat, front, back, wrong_sign]
}

/// An agreement, for display.
fn described(found: &Agreement) -> String {
    let Agreement { overlap, flat, front, back, wrong_sign } = found;
    format!(
        "unseen shapes: IoU {overlap:.3} (as deep as wide {flat:.3}), front off by {:.1} % of D, back by {:.1} %, \
         wrong sign of {:.0} % of the tilts",
        100.0 * front,
        100.0 * back,
        100.0 * wrong_sign
    )
}

impl fmt::Display for Job {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { settings, solids, training, folder, .. } = self;
        write!(
            f,
            "{} numbers trained, {} real shapes and {} procedural solids, {} pictures a step, step {} of {} → {}",
            training.count(),
            solids.real.len(),
            solids.made.len(),
            settings.optimiser.batch,
            training.steps(),
            settings.steps,
            folder.root().display()
        )
    }
}
