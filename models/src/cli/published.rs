//! `gradreel reconstruct --method published`: options of the published chain.

use std::path::{Path, PathBuf};

use gradreel::{Device, Error, ErrorKind, Result};

use crate::cli::network;
use crate::cli::source::{Source, whole};
use crate::identify::{Config, GroundContact, Reconstruction, Run};
use crate::published::{self, Chain, Origin, PublishedConfig, ViewMaker};
use crate::report::reconstruction::publish_with;
use crate::runtime::progress::Progress;
use crate::text;
use crate::video::Clip;
use crate::views::FileWeights;

/// Largest size of a file of boxes \[bytes\].
const MOST_BOXES: u64 = 64 << 20;

/// How a clip is reconstructed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub(super) enum Method {
    /// The project's own: shape from silhouettes, a pool of hypotheses, intervals
    Own,
    /// The published chain: views of every frame, temporal field, particles, velocity and material by gradients
    Published,
}

/// Options of the method.
#[derive(clap::Args, Default)]
pub(super) struct PublishedArguments {
    /// own is the project's: shape from silhouettes, a pool of hypotheses, intervals; published is the chain of the paper: views of every
    /// frame by a multi-view model, a temporal field, particles, velocity and material by gradients [default: own]
    #[arg(long, value_name = "METHOD", value_enum, hide_possible_values = true, help_heading = HEADING, conflicts_with = "resume")]
    method: Option<Method>,
    /// Weights of the multi-view model of --method published, a PyTorch checkpoint or a safetensors file [default: built-in, a small model]
    #[arg(long, value_name = "FILE", help_heading = HEADING, conflicts_with = "resume")]
    weights: Option<PathBuf>,
    /// Boxes of the object as a detector leaves them, for --method published (see docs/guide/published.md) [default: those of the masks]
    #[arg(long, value_name = "FILE.json", help_heading = HEADING, conflicts_with = "resume")]
    boxes: Option<PathBuf>,
}

/// Heading of these options.
const HEADING: &str = "Method";

/// What of the command line the published chain has no use for.
pub(super) struct Unfit {
    /// The option as given.
    pub option: &'static str,
    /// Whether it was given.
    pub given: bool,
    /// Why it does not apply.
    pub reason: &'static str,
    pub fix: &'static str,
}

impl PublishedArguments {
    /// Puts the method into the settings: those of a file with a table `[published]` are of that method already.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for options of the published method without it.
    pub fn apply(&self, config: &mut Config, seed: Option<u64>) -> Result<()> {
        match self.method {
            Some(Method::Own) => config.published = None,
            Some(Method::Published) => _ = config.published.get_or_insert_default(),
            None => {}
        }
        let Some(published) = &mut config.published else {
            let given = [("--weights", self.weights.is_some()), ("--boxes", self.boxes.is_some())];
            return match given.iter().find(|(_, given)| *given) {
                None => Ok(()),
                Some((option, _)) => Err(Error::new(ErrorKind::Input, "only the published method has a use for it")
                    .at(*option)
                    .found("the project's own method")
                    .fix("add --method published, or leave it out")),
            };
        };
        published.weights = self.weights.as_deref().map(whole).or(published.weights.take());
        published.boxes = self.boxes.as_deref().map(whole).or(published.boxes.take());
        published.seed = seed.unwrap_or(published.seed);
        if published.weights.is_none() {
            // the built-in model is reliable in silhouettes only
            config.weights.imagined_colour = 0.0;
        }
        Ok(())
    }
}

/// Refuses settings that do not apply to the published chain, with the reason.
///
/// # Errors
/// [`ErrorKind::Input`] naming the first.
pub(super) fn check(config: &Config, more: &[Unfit]) -> Result<()> {
    let contact = config.world.ground_contact;
    let own = [
        Unfit {
            option: "--material auto",
            given: config.chooses_family(),
            reason: "the published method is told the family of the material",
            fix: "name it: --material elastic, plasticine, newtonian, non_newtonian or sand",
        },
        Unfit {
            option: "--spin",
            given: config.estimate.spin,
            reason: "the published method takes the object to begin without spin",
            fix: "leave it out, or use --method own",
        },
        Unfit {
            option: "--ground auto",
            given: config.world.find_ground,
            reason: "the ground is sought in the hulls of several cameras, and the published method has one",
            fix: "leave it out: a film says where the ground is; of a clip, give the height with --ground",
        },
        Unfit {
            option: "--ground-contact",
            given: !matches!(contact, GroundContact::Sticky | GroundContact::Slip),
            reason: "the kind and the friction of the ground are hypotheses of the project's own method",
            fix: "choose sticky or slip, or use --method own",
        },
        Unfit {
            option: "imagine.weights",
            given: config.imagine.weights.is_some() || config.imagine.views.is_some(),
            reason: "the published method makes views of every frame itself",
            fix: "leave it out; the model is chosen with --weights FILE",
        },
    ];
    match more.iter().chain(&own).find(|unfit| unfit.given) {
        None => Ok(()),
        Some(Unfit { option, reason, fix, .. }) => {
            Err(Error::new(ErrorKind::Input, *reason).at(*option).found("--method published").fix(*fix))
        }
    }
}

/// Checks what the chain needs before anything is written: one camera, usable weights, a box in every frame.
///
/// # Errors
/// [`ErrorKind::Input`] for the first that is missing.
pub(super) fn check_clip(clip: &Clip, config: &PublishedConfig) -> Result<()> {
    if clip.cameras.len() != 1 {
        let ids: Vec<String> = clip.cameras.iter().map(|camera| camera.id.to_string()).collect();
        return Err(Error::new(ErrorKind::Input, "the published method has a film of one camera")
            .at(clip.root.display())
            .found(format!("cameras {}", ids.join(", ")))
            .wanted("a film, or one camera of the clip")
            .fix(format!("choose one, for example --cameras {}, or use --method own", ids[0])));
    }
    let weights = opened(config)?;
    weights.check(&weights.sizes()?.weights()?).into_result()?;
    ViewMaker::settings(&weights, config)?;
    match boxes_of(config)? {
        Some((text, name)) => published::boxes::of_text(&text, &name, clip),
        None => published::boxes::of_masks(clip),
    }
    .map(|_| ())
}

/// Runs the chain from where it is, and publishes what it found.
///
/// # Errors
/// As [`Chain::finish`].
pub(super) fn finish(clip: &Clip, run: &mut Run, progress: &Progress, quiet: bool) -> Result<Reconstruction> {
    let config = run.config.published.clone().unwrap_or_default();
    let weights = opened(&config)?;
    let fingerprint = Source::of(place(&config), "the weights")?.mark().to_owned();
    // boxes that the run has read already are its own
    let boxes = if published::State::read(&run.folder)?.boxes.is_empty() { boxes_of(&config)? } else { None };
    let origin = Origin::Film {
        weights: &weights,
        fingerprint: &fingerprint,
        boxes: boxes.as_ref().map(|(text, name)| (text.as_str(), name.as_str())),
    };
    let chain = Chain::new(run, origin, progress, quiet)?;
    let stages = chain.stages();
    let (found, state) = chain.finish(clip)?;
    let beside = published::report::beside(&state, &found.law, &run.folder, stages)?;
    publish_with(&found, run, clip, progress, Some(beside))?;
    Ok(found)
}

fn place(config: &PublishedConfig) -> &Path {
    config.weights.as_deref().unwrap_or(Path::new(FileWeights::BUILT_IN))
}

fn opened(config: &PublishedConfig) -> Result<FileWeights> {
    Source::of(place(config), "the weights")?;
    network::open(place(config), &Device::Cpu)
}

fn boxes_of(config: &PublishedConfig) -> Result<Option<(String, String)>> {
    let Some(path) = &config.boxes else { return Ok(None) };
    let text = text::read(path, "the boxes", "give the path of a JSON file to --boxes", MOST_BOXES)?;
    Ok(Some((text, path.display().to_string())))
}
