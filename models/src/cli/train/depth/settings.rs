//! Settings of a training of the depth network, as TOML.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::Depth;
use crate::cli::source::{Source, whole};
use crate::cli::train::toml_file::{merged, read, refused};
use crate::depth::{DepthNetwork, DepthSizes, Plan, Split};

/// Settings of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Settings {
    /// Seed of pictures, procedural solids and initial weights.
    pub seed: u64,
    pub steps: u64,
    /// Steps between checkpoints.
    pub checkpoint_every: u64,
    pub optimiser: Optimiser,
    pub data: Data,
    pub validation: Validation,
    pub model: DepthSizes,
    /// The files of shapes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shapes: Option<Shapes>,
    /// File of the initial weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<Source>,
}

/// Settings of the optimisers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Optimiser {
    /// Pictures of a step.
    pub batch: usize,
    /// Rate of Muon, for the convolutions inside.
    pub muon_rate: f64,
    /// Rate of Adam, for the first and the last layer and for vectors.
    pub adam_rate: f64,
    /// Weight decays of both.
    pub muon_decay: f64,
    pub adam_decay: f64,
    /// Steps of the learning-rate warm-up.
    pub warmup: u64,
    /// Share of the steps after which the rates fall.
    pub hold: f64,
    /// Maximum gradient norm of each optimiser.
    pub clip: f64,
    /// Decay of the running average of the weights.
    pub average: f64,
}

/// What pictures are drawn of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Data {
    /// Share of the pictures that show procedural solids.
    pub procedural: f64,
    /// Number of procedural solids, and grid nodes along their longest sides.
    pub solids: usize,
    pub nodes: usize,
}

/// Settings of the validation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Validation {
    /// Steps between validations; 0 validates at the end only.
    pub every: u64,
    /// Number of pictures, two of each shape: upright and in any attitude.
    pub pictures: usize,
}

/// The files of shapes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Shapes {
    pub train: Source,
    pub val: Source,
}

impl Shapes {
    fn of(folder: &Path) -> Result<Self> {
        let file = |split: Split| Source::of(&whole(&folder.join(split.file())), "the shapes (--shapes)");
        Ok(Self { train: file(Split::Train)?, val: file(Split::Val)? })
    }

    /// The folder of the same files at their present location.
    pub fn found_again<'p>(&'p self, moved: Option<&'p Path>) -> Result<&'p Path> {
        let begun = Path::new(&self.train.path).parent().unwrap_or(Path::new("."));
        let folder = moved.unwrap_or(begun);
        for (source, split) in [(&self.train, Split::Train), (&self.val, Split::Val)] {
            source.found_again(&folder.join(split.file()), "the shapes (--shapes)")?;
        }
        Ok(folder)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            seed: 0,
            steps: 12_000,
            checkpoint_every: 100,
            optimiser: Optimiser {
                batch: 48,
                muon_rate: 0.02,
                adam_rate: 2e-3,
                muon_decay: 0.01,
                adam_decay: 0.02,
                warmup: 100,
                hold: 0.4,
                clip: 5.0,
                average: 0.999,
            },
            data: Data { procedural: 1.0 / 6.0, solids: 1024, nodes: 24 },
            validation: Validation { every: 500, pictures: 400 },
            model: DepthSizes::default(),
            shapes: None,
            weights: None,
        }
    }
}

impl Settings {
    /// Combines arguments, settings file and defaults. Invalid values are rejected.
    pub fn resolve(arguments: &Depth) -> Result<Self> {
        let given = arguments.config.as_deref().map(read).transpose()?.unwrap_or_default();
        let mut defaults = Self::default();
        if let Some(weights) = arguments.weights() {
            defaults.model = DepthNetwork::open(weights)?.sizes();
            defaults.weights = Some(source_of(weights)?);
        }
        let defaults = toml::Table::try_from(defaults).expect("settings are numbers and text");
        let mut settings: Self =
            toml::Value::Table(merged(defaults, given)).try_into().map_err(|e| refused("--config", &e))?;
        settings.steps = arguments.steps.unwrap_or(settings.steps);
        settings.optimiser.batch = arguments.batch.unwrap_or(settings.optimiser.batch);
        settings.seed = arguments.seed.unwrap_or(settings.seed);
        settings.check()?;
        if let Some(folder) = &arguments.shapes {
            settings.shapes = Some(Shapes::of(folder)?);
        }
        Ok(settings)
    }

    /// Parses the output of [`Settings::to_toml`].
    pub fn parse(text: &str) -> Result<Self> {
        let settings: Self = toml::from_str(text).map_err(|e| refused("settings.toml", &e))?;
        settings.check().map(|()| settings)
    }

    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("settings are numbers and text")
    }

    fn check(&self) -> Result<()> {
        let Self { optimiser, data, validation, .. } = self;
        let share = |x: f64| (0.0..=1.0).contains(&x);
        let rate = |x: f64| x > 0.0 && x.is_finite();
        for (name, fits, wanted) in [
            ("seed", self.seed <= i64::MAX as u64, "below 2^63"),
            ("steps", (1..=1 << 40).contains(&self.steps), "1 to 2^40"),
            ("checkpoint_every", self.checkpoint_every > 0, "at least 1"),
            ("optimiser.batch", (1..=1 << 12).contains(&optimiser.batch), "1 to 4096"),
            ("optimiser.muon_rate", rate(optimiser.muon_rate), "above 0"),
            ("optimiser.adam_rate", rate(optimiser.adam_rate), "above 0"),
            ("optimiser.muon_decay", (0.0..1.0).contains(&optimiser.muon_decay), "0 to below 1"),
            ("optimiser.adam_decay", (0.0..1.0).contains(&optimiser.adam_decay), "0 to below 1"),
            ("optimiser.hold", share(optimiser.hold), "a share, 0 to 1"),
            ("optimiser.clip", optimiser.clip > 0.0, "above 0"),
            ("optimiser.average", (0.0..1.0).contains(&optimiser.average), "0 to below 1"),
            ("data.procedural", share(data.procedural), "a share, 0 to 1"),
            ("data.solids", data.solids <= 1 << 16, "at most 65536"),
            ("data.solids", data.procedural == 0.0 || data.solids > 0, "at least 1, or data.procedural = 0"),
            ("data.nodes", (8..=64).contains(&data.nodes), "8 to 64"),
            ("validation.pictures", (2..=1 << 16).contains(&validation.pictures), "2 to 65536"),
        ] {
            if !fits {
                return Err(Error::new(ErrorKind::Input, "a setting of the training makes no sense")
                    .at(name)
                    .wanted(wanted)
                    .fix("correct it in the file of --config"));
            }
        }
        self.model.check()
    }

    /// How the network is trained.
    pub fn plan(&self) -> Plan {
        let Optimiser { muon_rate, adam_rate, muon_decay, adam_decay, warmup, hold, clip, average, .. } =
            self.optimiser;
        Plan {
            rates: [muon_rate, adam_rate],
            decays: [muon_decay, adam_decay],
            warmup,
            hold: (hold * self.steps as f64) as u64,
            steps: self.steps,
            clip,
            average,
            seed: self.seed,
        }
    }
}

/// The weights a run begins from; those of the program have no file.
fn source_of(weights: &Path) -> Result<Source> {
    match weights == DepthNetwork::BUILT_IN {
        true => Ok(Source::of_bytes(DepthNetwork::BUILT_IN, DepthNetwork::built_in_weights())),
        false => Source::of(&whole(weights), "the weights"),
    }
}
