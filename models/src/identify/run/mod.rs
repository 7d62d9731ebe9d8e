//! A run: its folder, its state, and how it goes on after an interruption.

pub(super) mod field_file;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::field::temporal::Flight;
use crate::identify::config::settings_file;
use crate::identify::hypotheses::Hypothesis;
use crate::identify::model::unknowns;
use crate::identify::pipeline::Survey;
use crate::identify::run::field_file::FIELD;
use crate::identify::solve;
use crate::identify::uncertainty::mixture::Marginal;
use crate::identify::{Config, Interval, MaterialConfig, Stage, Unknowns};
use crate::physics::Law;
use crate::runtime::run_folder::RunFolder;
use crate::video::{Bounces, Clip};

/// What a run has reached; `state.json` in its folder.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct State {
    /// The clip it was begun with.
    pub clip: ClipIdentity,
    /// Where that clip was.
    #[serde(default)]
    pub clip_path: Option<PathBuf>,
    /// Stages that are finished.
    pub finished: Vec<Stage>,
    /// Seconds that each finished stage took.
    pub seconds: Vec<f64>,
    /// Where each finished stage that moves unknowns left them.
    #[serde(default)]
    pub ends: BTreeMap<Stage, Unknowns>,
    /// The best unknowns so far.
    pub unknowns: Option<Unknowns>,
    /// What the temporal field says of the flight, if it was asked.
    #[serde(default)]
    pub flight: Option<Flight>,
    /// Height of the ground \[m\], once it was looked for.
    #[serde(default)]
    pub ground: Option<f64>,
    /// Whether the first frame asked for a sharpened surface, once it was asked.
    #[serde(default)]
    pub sharpened: Option<bool>,
    /// First frame in contact with the ground, once known.
    pub contact: Option<usize>,
    /// What the free flights tell of the hits, if the contact is shorter than a frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounces: Option<Bounces>,
    /// Every evaluation of the estimates.
    pub history: Vec<HistoryRow>,
    /// What happened that the user should know.
    pub notes: Vec<String>,
    /// How the families stand, if the run has to choose.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub standings: Vec<Standing>,
    /// The batches of evaluations that the stage under way has had.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) batches: Option<Batches>,
    /// Which hypotheses each finished stage left.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) survivors: BTreeMap<Stage, Vec<Hypothesis>>,
    /// What the clip says of each hypothesis that survived.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) surveys: Vec<Survey>,
    /// How probable each family is: `log p(y | family)`, that of the most probable hypothesis being 0 \[nat\].
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub log_evidence: BTreeMap<String, f64>,
    /// What is known of each unknown, in the coordinates of the search.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) marginals: BTreeMap<String, Marginal>,
    /// How sure the estimates are, once known.
    #[serde(default)]
    pub intervals: Vec<Interval>,
    /// The settings that all this was reached with, as the file says; those of a run are [`Run::config`].
    #[serde(default, skip_serializing)]
    settings: Option<settings_file::Settings>,
}

/// The state as its file has it: with the settings that it was reached with.
#[derive(Serialize)]
struct Saved<'a> {
    #[serde(flatten)]
    state: &'a State,
    settings: &'a Config,
}

impl State {
    /// Nothing is found yet; what the clip makes one assume is noted.
    fn of(clip: &Clip) -> Self {
        Self {
            clip: ClipIdentity::of(clip),
            clip_path: Some(clip.root.canonicalize().unwrap_or_else(|_| clip.root.clone())),
            notes: clip.said().collect(),
            ..Self::default()
        }
    }
}

/// How a family stands after the last stage that it took part in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// Its name.
    pub family: String,
    /// That stage.
    pub stage: Stage,
    /// The loss of its most probable hypothesis there.
    pub loss: f64,
    /// How much less probable that is than the most probable one of all \[nat\].
    pub behind: f64,
}

/// Answers to the batches of a stage, in the order of its requests: gone through again with them, it goes on where it was interrupted
/// and ends as if it had not been.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Batches {
    stage: Stage,
    answers: Vec<solve::Answer>,
}

/// What tells one clip from another when a run goes on.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ClipIdentity {
    /// Name of the clip's folder.
    pub name: String,
    /// Cameras in use.
    pub cameras: Vec<i64>,
    /// Widths and heights of their images \[pixels\].
    pub sizes: Vec<[usize; 2]>,
    /// Number of frames in use.
    pub frames: usize,
}

impl ClipIdentity {
    fn of(clip: &Clip) -> Self {
        Self {
            name: clip.name.clone(),
            cameras: clip.cameras.iter().map(|camera| camera.id).collect(),
            sizes: clip.cameras.iter().map(|camera| [camera.width, camera.height]).collect(),
            frames: clip.frame_count(),
        }
    }
}

impl std::fmt::Display for ClipIdentity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { name, cameras, sizes, frames } = self;
        write!(f, "`{name}`: {frames} frames of cameras {cameras:?}, {sizes:?} pixels")
    }
}

/// One evaluation of an estimate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HistoryRow {
    /// The stage it belongs to.
    pub stage: Stage,
    /// The loss; nothing when the physics broke down there.
    pub loss: Option<f64>,
    /// Where.
    pub unknowns: Unknowns,
}

/// A folder with the state of a reconstruction.
pub struct Run {
    /// Where everything is written.
    pub folder: RunFolder,
    /// The resolved configuration.
    pub config: Config,
    /// What has been reached.
    pub state: State,
    /// What its file goes on to say of the material while another is tried.
    pub(super) open: Option<MaterialConfig>,
    /// Whether somebody has edited the file of its settings.
    edited: bool,
}

const STATE: &str = "state.json";
const CONFIG: &str = "config.toml";

/// Writes a law of the run's own beside its settings, which name the file.
fn write_law(folder: &RunFolder, config: &Config) -> Result<()> {
    let material = &config.material;
    match (&material.law, material.own.law().and_then(crate::physics::Law::text)) {
        (Some(path), Some(text)) => folder.write(&path.to_string_lossy(), text.as_bytes()),
        _ => Ok(()),
    }
}

impl Run {
    /// A new run in an empty folder.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the folder holds something.
    pub fn create(folder: RunFolder, config: Config, clip: &Clip) -> Result<Self> {
        write_law(&folder, &config)?;
        folder.write(CONFIG, settings_file::text(&config)?.as_bytes())?;
        let run = Self { folder, config, state: State::of(clip), open: None, edited: false };
        run.save()?;
        Ok(run)
    }

    /// A run that was begun before.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the folder holds no run, or its files are damaged.
    pub fn open(folder: RunFolder) -> Result<Self> {
        let text = |name: &str| -> Result<String> {
            let fix = "give the folder of an interrupted run to --out, or leave --resume out";
            folder.goes_on(name, "there is no run in this folder", fix)?;
            folder.read_text(name)
        };
        let written = text(CONFIG)?;
        let settings = |e: gradreel::Error| e.at(folder.path(CONFIG).display());
        let mut config = Config::read(&written).map_err(settings)?;
        config.read_law(folder.root())?;
        config.check().map_err(settings)?;
        if let Some(lost) = lost_setting(&written, &config.to_toml()?) {
            return Err(damaged(&folder, CONFIG, &format!("no setting {lost}")));
        }
        // an interruption between the first two files leaves a run that knows its settings and nothing else
        let state: State = match folder.has(STATE) {
            true => serde_json::from_str(&text(STATE)?).map_err(|e| damaged(&folder, STATE, &e))?,
            false => State::default(),
        };
        let parameters = config.law()?.parameters().len();
        // a family that is still to be chosen may leave any number
        if !config.chooses_family() && state.unknowns.as_ref().is_some_and(|u| u.parameters.len() != parameters) {
            return Err(damaged(&folder, STATE, &"another number of parameters than the material has"));
        }
        if state.seconds.len() != state.finished.len() {
            return Err(damaged(&folder, STATE, &"stages without their times"));
        }
        let edited = settings_file::is_edited(&written, &config)?;
        Ok(Self { folder, config, state, open: None, edited })
    }

    /// The settings as its file has them.
    fn settings(&self) -> Config {
        let material = self.open.as_ref().unwrap_or(&self.config.material).clone();
        Config { material, ..self.config.clone() }
    }

    /// Takes over settings that were edited since the run stopped, if nothing that is done hangs on them, and notes them.
    fn take_over_edits(&mut self) -> Result<()> {
        let (true, Some(before)) = (std::mem::take(&mut self.edited), &self.state.settings) else { return Ok(()) };
        let [other, effort] = settings_file::changes(before, &settings_file::of(&self.config)?);
        let begun = !self.state.finished.is_empty()
            || self.state.batches.is_some()
            || self.folder.has(FIELD)
            || self.folder.has(crate::published::STATE);
        if begun && !other.is_empty() {
            return Err(settings_file::refused(&self.folder.path(CONFIG).display(), &other));
        }
        for change in other.iter().chain(&effort) {
            self.note(format!("changed before the run went on: {change}"));
        }
        self.save_config()?;
        self.save()
    }

    /// Writes the configuration as it is now.
    pub(crate) fn save_config(&self) -> Result<()> {
        self.folder.write(CONFIG, settings_file::text(&self.settings())?.as_bytes())
    }

    /// The same run, to be changed and written to another folder.
    #[must_use]
    pub fn copied(&self) -> Self {
        let (folder, config, state) = (self.folder.clone(), self.config.clone(), self.state.clone());
        Self { folder, config, state, open: None, edited: false }
    }

    /// Writes a changed copy of a run, with that run's voxels, to its own empty folder.
    ///
    /// # Errors
    /// What reading and writing return.
    pub fn begin_from(&self, other: &Self) -> Result<()> {
        write_law(&self.folder, &self.config)?;
        self.save_config()?;
        self.folder.write(FIELD, &other.folder.read(FIELD)?)?;
        self.save()
    }

    /// Makes the run go on with a clip: clears away what an interrupted write left, and checks that the clip is the one that the
    /// run was begun with.
    ///
    /// # Errors
    /// As [`Run::belongs_to`]; [`ErrorKind::Input`] when settings were edited that finished stages have used; what writing
    /// returns.
    pub fn go_on(&mut self, clip: &Clip) -> Result<()> {
        if self.state.clip == ClipIdentity::default() {
            self.state = State::of(clip);
            self.save()?;
        }
        self.belongs_to(clip)?;
        self.folder.sweep();
        self.take_over_edits()
    }

    /// Whether a clip is the one that the run was begun with.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when its name, cameras, image sizes or number of frames differ.
    pub fn belongs_to(&self, clip: &Clip) -> Result<()> {
        let given = ClipIdentity::of(clip);
        if given == self.state.clip {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "the run was begun with another clip")
            .at(clip.root.display())
            .found(given)
            .wanted(&self.state.clip)
            .fix("give the clip of the run, or start a new run with another --out"))
    }

    /// Writes the state.
    ///
    /// # Errors
    /// What writing returns.
    pub fn save(&self) -> Result<()> {
        let saved = Saved { state: &self.state, settings: &self.settings() };
        let json = serde_json::to_vec_pretty(&saved)
            .map_err(|e| Error::new(ErrorKind::Io, "cannot write the state of the run").found(e))?;
        self.folder.write(STATE, &json)
    }

    /// Whether a stage is finished.
    pub fn has_finished(&self, stage: Stage) -> bool {
        self.state.finished.contains(&stage)
    }

    /// The answers that a stage has had before it was interrupted.
    pub(super) fn answers_of(&self, stage: Stage) -> Vec<solve::Answer> {
        let batches = self.state.batches.as_ref().filter(|batches| batches.stage == stage);
        batches.map(|batches| batches.answers.clone()).unwrap_or_default()
    }

    /// Keeps the answers to a batch of requests of a stage, and saves.
    ///
    /// # Errors
    /// What writing returns.
    pub(super) fn keep_answers(&mut self, stage: Stage, answers: &[solve::Answer]) -> Result<()> {
        self.state.batches.take_if(|batches| batches.stage != stage);
        let empty = || Batches { stage, answers: Vec::new() };
        self.state.batches.get_or_insert_with(empty).answers.extend_from_slice(answers);
        self.save()
    }

    /// The hypotheses that a finished stage left.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if the run does not say.
    pub(super) fn survivors_of(&self, stage: Stage) -> Result<Vec<Hypothesis>> {
        let lost = || damaged(&self.folder, STATE, &format!("no survivors of the stage \"{stage}\""));
        self.state.survivors.get(&stage).filter(|all| !all.is_empty()).cloned().ok_or_else(lost)
    }

    /// What the clip says of each hypothesis that survived.
    pub(crate) fn surveys(&self) -> &[Survey] {
        &self.state.surveys
    }

    /// What the posterior says of an unknown at a value, in its unit: the share below it, and the logarithm of the density
    /// there; nothing of what was not estimated, or a value that it cannot take.
    pub fn known(&self, law: &Law, name: &str, value: f64) -> Option<(f64, f64)> {
        let marginal = self.state.marginals.get(name)?;
        let (x, slope) = unknowns::coordinate(law, name, value)?;
        Some((marginal.below(x), marginal.log_density(x) + slope.abs().ln()))
    }

    /// Marks a stage as finished.
    ///
    /// # Errors
    /// What writing returns.
    pub fn finish(&mut self, stage: Stage, since: Instant) -> Result<()> {
        self.state.finished.push(stage);
        self.state.seconds.push(since.elapsed().as_secs_f64());
        self.state.batches = None;
        self.save()
    }

    /// Marks a stage as finished that leaves the unknowns here.
    ///
    /// # Errors
    /// What writing returns.
    pub fn finish_at(&mut self, unknowns: &Unknowns, stage: Stage, since: Instant) -> Result<()> {
        self.state.ends.insert(stage, unknowns.clone());
        self.state.unknowns = Some(unknowns.clone());
        self.finish(stage, since)
    }

    /// Keeps something the user should know, once.
    pub fn note(&mut self, text: String) {
        if !self.state.notes.contains(&text) {
            self.state.notes.push(text);
        }
    }

    /// Where a finished stage left the unknowns: what it weighs besides the pictures may have moved them away from the least loss.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if the run does not say.
    pub fn end_of(&self, stage: Stage) -> Result<Unknowns> {
        let lost = || damaged(&self.folder, STATE, &format!("no end of the stage \"{stage}\""));
        self.state.ends.get(&stage).cloned().ok_or_else(lost)
    }
}

/// The first setting of a resolved configuration that its file does not hold: a run's file holds them all.
fn lost_setting(written: &str, resolved: &str) -> Option<String> {
    fn lost(written: &toml::Table, resolved: &toml::Table) -> Option<String> {
        resolved.iter().find_map(|(name, value)| match (written.get(name), value) {
            (None, _) => Some(name.clone()),
            (Some(toml::Value::Table(written)), toml::Value::Table(resolved)) => {
                lost(written, resolved).map(|inner| format!("{name}.{inner}"))
            }
            _ => None,
        })
    }
    lost(&written.parse().ok()?, &resolved.parse().ok()?)
}

pub(super) fn damaged(folder: &RunFolder, name: &str, found: &dyn std::fmt::Display) -> Error {
    Error::new(ErrorKind::Input, "a file of the run is damaged")
        .at(folder.path(name).display())
        .found(found)
        .fix("start again with another --out; nothing here was changed")
}
