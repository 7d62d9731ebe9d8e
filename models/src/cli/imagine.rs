//! Synthesized or given views that complement a single camera.

use std::path::{Path, PathBuf};

use gradreel::{Device, Error, ErrorKind, Result};

use crate::cli::network;
use crate::cli::source::{Source, whole};
use crate::cli::synthesize;
use crate::field::bounding_sphere;
use crate::identify::{Config, Run};
use crate::monocular;
use crate::report::png_file::png_with_alpha;
use crate::report::reconstruction::VIEWS;
use crate::runtime::progress::Progress;
use crate::vector::minus;
use crate::video::{Clip, Frame, OpenOptions};
use crate::views::FileWeights;

/// What is known of the unseen sides.
#[derive(clap::Args)]
pub(super) struct ImagineArguments {
    /// Imagine the sides of the object that nobody saw, by a multi-view model: the one that comes with gradreel, or --imagine=FILE (see
    /// `gradreel synthesize --help`)
    #[arg(long, value_name = "WEIGHTS", help_heading = HEADING, conflicts_with = "views")]
    #[arg(num_args = 0..=1, require_equals = true, default_missing_value = FileWeights::BUILT_IN)]
    imagine: Option<PathBuf>,
    /// Views of the first frame as a clip of one frame, the first from the azimuth of the real camera, such as `gradreel synthesize`
    /// leaves
    #[arg(long, value_name = "FOLDER", help_heading = HEADING)]
    views: Option<PathBuf>,
    /// Other seeds guess other backs
    #[arg(long, value_name = "NUMBER", help_heading = HEADING)]
    #[arg(value_parser = clap::value_parser!(u64).range(..=super::source::LARGEST_SEED))]
    seed: Option<u64>,
}

/// Heading of these options.
const HEADING: &str = "What a single camera did not see";

/// File in the run's folder with the picture that the views are synthesized from.
const PICTURE: &str = "first_frame.png";

impl ImagineArguments {
    /// Whether any option was given.
    pub fn are_given(&self) -> bool {
        self.imagine.is_some() || self.views.is_some()
    }

    /// The seed, if it was given.
    pub fn seed(&self) -> Option<u64> {
        self.seed
    }

    /// Refuses a seed where nothing is imagined.
    pub fn check_seed(&self) -> Result<()> {
        match (self.seed, &self.imagine) {
            (Some(seed), None) => Err(Error::new(ErrorKind::Input, "a seed, and nothing that is imagined with it")
                .at("--seed")
                .found(seed)
                .wanted("--imagine or --method published beside it")
                .fix("add one of them, or leave --seed out")),
            _ => Ok(()),
        }
    }

    /// Overrides the settings with the given options.
    pub fn apply(&self, config: &mut Config) {
        if self.imagine.is_some() || self.views.is_some() {
            config.imagine.weights = self.imagine.as_deref().map(whole);
            config.imagine.views = self.views.as_deref().map(whole);
            if config.imagine.weights.as_deref() == Some(Path::new(FileWeights::BUILT_IN)) {
                // the built-in model is reliable in silhouettes only
                config.weights.imagined_colour = 0.0;
            }
        }
        config.imagine.seed = self.seed.unwrap_or(config.imagine.seed);
    }
}

/// Rejects clips that cannot be complemented, and adds given views to the clip.
pub(super) fn given(clip: &mut Clip, config: &Config) -> Result<()> {
    let imagine = &config.imagine;
    if let (Some(_), true) = (&imagine.weights, clip.cameras.len() > 1) {
        return Err(Error::new(ErrorKind::Input, "there are several cameras already")
            .at("--imagine")
            .found(format!("{} cameras", clip.cameras.len()))
            .wanted("a film, or a single calibrated camera (--cameras)")
            .fix("leave it out"));
    }
    // reject unusable weights before anything is written
    if let Some(weights) = &imagine.weights {
        Source::of(weights, "the weights")?;
        let weights = network::open(weights, &Device::Cpu)?;
        weights.check(&weights.sizes()?.weights()?).into_result()?;
    }
    match &imagine.views {
        Some(folder) => put_around(clip, folder.clone()),
        None => Ok(()),
    }
}

/// Synthesizes views of the clip's first frame in the folder of the run, or resumes this, and adds them to the
/// clip.
pub(super) fn imagined(clip: &mut Clip, run: &mut Run, progress: &Progress) -> Result<()> {
    let imagine = &run.config.imagine;
    let Some(weights) = &imagine.weights else { return Ok(()) };
    let folder = run.folder.path(VIEWS);
    let sphere = bounding_sphere(clip, 0)?;
    let up = minus(clip.cameras[0].centre(), sphere.centre);
    let elevation = up[1].atan2(up[0].hypot(up[2])).to_degrees();
    if !run.folder.has(PICTURE) {
        let frame = &clip.frames[0][0];
        let (height, width) = frame.alpha.dim();
        run.folder.write(PICTURE, &png_with_alpha(width, height, &pixels(frame))?)?;
    }
    synthesize::within(&folder, run.folder.path(PICTURE), weights, elevation, imagine, progress)?;
    put_around(clip, folder)?;
    run.state.notes.retain(|note| !note.starts_with("assumed: shape:"));
    clip.said().for_each(|line| run.note(line));
    run.save()
}

fn put_around(clip: &mut Clip, folder: PathBuf) -> Result<()> {
    let views = Clip::open(&folder, &OpenOptions { max_frames: Some(1), ..OpenOptions::default() })?;
    let alike = monocular::surround(clip, &views)?;
    clip.assumptions.retain(|line| !line.starts_with("shape:"));
    let dissent = clip.around.as_ref().map_or(0, |around| around.dissent);
    clip.assumptions.push(format!(
        "shape: what the imagined views of the first frame show in {} ({} of {} may be wrong about a point); silhouettes agree by \
         {alike:.2}",
        folder.display(),
        dissent,
        views.cameras.len()
    ));
    Ok(())
}

/// Colour and coverage as bytes, with straight alpha.
fn pixels(frame: &Frame) -> Vec<u8> {
    let byte = |x: f32| (255.0 * x).round().clamp(0.0, 255.0) as u8;
    let pixel = |((row, column), &alpha): ((usize, usize), &f32)| {
        let colour = |channel: usize| match alpha > 0.0 {
            true => byte((frame.rgb[[row, column, channel]] - (1.0 - alpha)) / alpha),
            false => 0,
        };
        [colour(0), colour(1), colour(2), byte(alpha)]
    };
    frame.alpha.indexed_iter().flat_map(pixel).collect()
}
