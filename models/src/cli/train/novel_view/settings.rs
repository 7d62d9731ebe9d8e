//! Settings of a training, as TOML.

use gradreel::{Device, Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::NovelView;
use super::meshes::Meshes;
use crate::cli::network;
use crate::cli::source::{Place, Source};
use crate::cli::train::toml_file::{merged, read, refused};
use crate::views::objects::SampleSettings;
use crate::views::{Detector, FileWeights, ModelSizes, Plan, SpatialAwareSizes};

/// What is trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Stage {
    /// The model itself, on objects in the middle
    Base,
    /// Its spatial-aware module, on objects anywhere, all else frozen
    SpatialAware,
}

/// Settings of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Settings {
    pub stage: Stage,
    /// Seed of objects, noise and initial weights.
    pub seed: u64,
    pub device: Place,
    pub steps: u64,
    /// Steps between checkpoints.
    pub checkpoint_every: u64,
    pub optimiser: Optimiser,
    pub data: SampleSettings,
    /// Meshes from files that replace procedural objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub objects: Option<Meshes>,
    /// Simulated detection errors in training.
    pub detector: Detector,
    pub validation: Validation,
    pub model: ModelSizes,
    /// File of the initial weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<Source>,
}

/// Settings of the optimiser.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Optimiser {
    /// Prefixes of trained weights.
    pub trained: Vec<String>,
    pub rate: f64,
    /// Steps of the learning-rate warm-up.
    pub warmup: u64,
    /// Whether the learning rate decays to a tenth by the last step.
    pub cooldown: bool,
    pub weight_decay: f64,
    /// Maximum gradient norm.
    pub clip: f64,
    /// Decay of the running average; 0 for none.
    pub average: f64,
    /// Samples per step.
    pub batch: usize,
    /// Predicted views per sample.
    pub targets: usize,
    /// Samples evaluated together; 0 for all.
    pub at_once: usize,
    /// Groups evaluated concurrently on a CPU.
    pub side_by_side: usize,
    /// Recomputes activations: less memory for one more forward pass.
    pub recomputed: bool,
    /// Probability of each of four ways of dropping conditions.
    pub dropped: f64,
}

/// Settings of the validation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Validation {
    /// Steps between validations; 0 validates at the end only.
    pub every: u64,
    /// Number of held-out objects whose loss is computed.
    pub samples: usize,
    /// Number of held-out objects whose views are sampled and scored.
    pub shapes: usize,
    /// Sampling steps.
    pub steps: usize,
    pub guidance: f64,
}

impl Settings {
    /// Default settings of a stage for a model.
    fn of(stage: Stage, model: ModelSizes) -> Self {
        let plan = match stage {
            Stage::Base => Plan::whole(),
            Stage::SpatialAware => Plan::spatial_aware(),
        };
        let centred = SampleSettings { scale: [0.3, 0.7], reach: 0.0, ..SampleSettings::default() };
        let data = if stage == Stage::Base { centred } else { SampleSettings::default() };
        let usual = model.sampler();
        Self {
            stage,
            seed: 0,
            device: Place::Cpu,
            steps: 20_000,
            checkpoint_every: 100,
            optimiser: Optimiser {
                rate: plan.trained[0].1,
                trained: plan.trained.into_iter().map(|(prefix, _)| prefix).collect(),
                warmup: plan.warmup,
                cooldown: true,
                weight_decay: plan.weight_decay,
                clip: plan.clip.unwrap_or(1.0),
                average: plan.average.unwrap_or(0.0),
                batch: 8,
                targets: 4.min(model.denoiser.ring.views),
                at_once: 1,
                side_by_side: 1,
                recomputed: model.image > 64,
                dropped: plan.dropped,
            },
            data: SampleSettings { nodes: (model.image * 3 / 4).clamp(24, 256), ..data },
            objects: None,
            detector: Detector { jitter: 0.02, missed: 0.1, depth_jitter: 0.01, depth_missed: 0.3 },
            validation: Validation {
                every: 1000,
                samples: 16,
                shapes: 4,
                steps: usual.steps.min(25),
                guidance: usual.guidance.min(1.5),
            },
            model,
            weights: None,
        }
    }

    /// Combines arguments, settings file and defaults; also returns the initial weights. Invalid values are
    /// rejected.
    pub fn resolve(arguments: &NovelView) -> Result<(Self, Option<FileWeights>)> {
        Self::resolve_from(arguments, Stage::Base)
    }

    /// As [`Settings::resolve`], with the stage to use if neither arguments nor file give one.
    pub fn resolve_from(arguments: &NovelView, stage: Stage) -> Result<(Self, Option<FileWeights>)> {
        let given = arguments.config.as_deref().map(read).transpose()?.unwrap_or_default();
        let stage = match (arguments.stage, given.get("stage")) {
            (Some(stage), _) => stage,
            (None, None) => stage,
            (None, Some(named)) => named.clone().try_into().map_err(|e| refused("stage", &e))?,
        };
        let source = arguments.weights.as_deref().map(|path| Source::of(path, "the weights")).transpose()?;
        let weights = arguments.weights.as_deref().map(|path| network::open(path, &Device::Cpu)).transpose()?;
        let mut model = match (&weights, stage) {
            (Some(weights), _) => weights.sizes()?,
            (None, _) => ModelSizes::small(),
        };
        match stage {
            Stage::Base => model.denoiser.spatial_aware = None,
            Stage::SpatialAware => {
                let volume = model.denoiser.volume;
                model.denoiser.spatial_aware.get_or_insert_with(|| SpatialAwareSizes::suiting(&volume));
            }
        }
        let defaults = toml::Table::try_from(Self::of(stage, model)).expect("settings are numbers and text");
        let mut settings: Self =
            toml::Value::Table(merged(defaults, given)).try_into().map_err(|e| refused("--config", &e))?;
        settings.stage = stage;
        settings.steps = arguments.steps.unwrap_or(settings.steps);
        settings.optimiser.batch = arguments.batch.unwrap_or(settings.optimiser.batch);
        settings.seed = arguments.seed.unwrap_or(settings.seed);
        settings.device = arguments.device.unwrap_or(settings.device);
        settings.weights = source;
        if arguments.objects.is_some() {
            settings.objects.get_or_insert_default();
        }
        settings.objects.iter_mut().for_each(|meshes| meshes.begin(arguments.objects.as_deref()));
        settings.check()?;
        Ok((settings, weights))
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
        let Self { optimiser, validation, detector, .. } = self;
        let share = |x: f64| (0.0..=1.0).contains(&x);
        for (name, fits, wanted) in [
            ("seed", self.seed <= i64::MAX as u64, "below 2^63"),
            ("steps", self.steps > 0, "at least 1"),
            ("checkpoint_every", self.checkpoint_every > 0, "at least 1"),
            ("optimiser.rate", optimiser.rate > 0.0 && optimiser.rate.is_finite(), "above 0"),
            ("optimiser.clip", optimiser.clip > 0.0, "above 0"),
            ("optimiser.average", (0.0..1.0).contains(&optimiser.average), "0 to below 1"),
            ("optimiser.batch", (1..=1 << 16).contains(&optimiser.batch), "1 to 65536"),
            ("optimiser.side_by_side", (1..=1 << 10).contains(&optimiser.side_by_side), "1 to 1024"),
            ("optimiser.dropped", (0.0..=0.25).contains(&optimiser.dropped), "0 to 0.25"),
            ("optimiser.weight_decay", (0.0..1.0).contains(&optimiser.weight_decay), "0 to below 1"),
            ("detector", share(detector.missed) && share(detector.depth_missed), "shares"),
            ("detector.jitter", (0.0..=0.5).contains(&detector.jitter), "0 to 0.5"),
            ("detector.depth_jitter", (0.0..=0.3).contains(&detector.depth_jitter), "0 to 0.3"),
            ("validation.steps", (1..=1000).contains(&validation.steps), "1 to 1000"),
            ("validation.guidance", validation.guidance.is_finite(), "a number"),
            (
                "optimiser.targets",
                (1..=self.model.denoiser.ring.views).contains(&optimiser.targets),
                "1 to the number of views",
            ),
        ] {
            if !fits {
                return Err(Error::new(ErrorKind::Input, "a setting of the training makes no sense")
                    .at(name)
                    .wanted(wanted)
                    .fix("correct it in the file of --config"));
            }
        }
        if let Some((name, wanted)) = self.objects.as_ref().and_then(Meshes::wrong) {
            return Err(Error::new(ErrorKind::Input, "a setting of the training makes no sense")
                .at(name)
                .found(format!("{:?}", self.objects))
                .wanted(wanted)
                .fix("correct it in the file of --config, or give --objects"));
        }
        self.data.check()?;
        self.model.check()
    }

    /// The plan of the training.
    pub fn plan(&self) -> Plan {
        let Optimiser { rate, weight_decay, warmup, clip, average, targets, side_by_side, recomputed, dropped, .. } =
            self.optimiser;
        Plan {
            trained: self.optimiser.trained.iter().map(|prefix| (prefix.clone(), rate)).collect(),
            weight_decay,
            warmup,
            cooldown: self.optimiser.cooldown.then_some(self.steps),
            clip: Some(clip),
            targets,
            at_once: match self.optimiser.at_once {
                0 => self.optimiser.batch,
                count => count,
            },
            side_by_side: if self.device == Place::Cpu { side_by_side } else { 1 },
            recomputed,
            average: Some(average).filter(|decay| *decay > 0.0),
            dropped,
            seed: self.seed,
        }
    }
}
