//! `gradreel synthesize`: views around an object from a single picture.

mod job;
mod size;

use std::path::{Path, PathBuf};

use gradreel::{ErrorKind, Result};

use self::job::Job;
use self::size::Size;
use super::source::{LARGEST_SEED, Place};
use crate::cli::output::{say, tell};
use crate::identify::ImagineConfig;
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::views::FileWeights;

/// Arguments of `gradreel synthesize`.
#[derive(clap::Args, Default)]
#[command(after_help = WEIGHTS, after_long_help = LONG_HELP)]
pub(super) struct Arguments {
    /// Picture of the object: PNG or JPEG, with transparency or on white
    image: PathBuf,
    /// Weights of the model, a PyTorch checkpoint or a safetensors file [default: built-in, a small model]
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Elevation of the camera that took the picture, above the horizon [degrees]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true)]
    #[arg(required_unless_present = "resume", conflicts_with = "resume")]
    elevation: Option<f64>,
    /// Folder for the results [default: runs/<image>, runs/<image>-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the run in --out where it was interrupted
    #[arg(long, requires = "out")]
    resume: bool,
    /// Sampling steps; 50 are usual, 200 thorough [default: 50; 12 for the built-in model]
    #[arg(long, value_name = "COUNT", conflicts_with = "resume")]
    steps: Option<usize>,
    /// Strength of the guidance by the picture; 1 is none, at half the work [default: 2; 1 for the built-in model]
    #[arg(long, value_name = "STRENGTH", allow_negative_numbers = true, conflicts_with = "resume")]
    guidance: Option<f64>,
    /// Other seeds guess other backs; the same seed gives the same views on any number of threads [default: 0]
    #[arg(long, value_name = "NUMBER", conflicts_with = "resume")]
    #[arg(value_parser = clap::value_parser!(u64).range(..=LARGEST_SEED))]
    seed: Option<u64>,
    /// Longer side of the object as the model sees it, in pixels of 256; 0 keeps the picture's own framing [default: that of the model,
    /// 200 for the published one]
    #[arg(long, value_name = "PIXELS", conflicts_with = "resume")]
    crop: Option<usize>,
    /// Distance of the object's middle along the camera's axis, for a model with a spatial-aware module: in units in which the
    /// model's cameras are 1.5 from the middle. With --crop 0, which keeps the picture's framing, the object appears where the picture
    /// has it, and this far away; cropped, in the middle [default: not known]
    #[arg(long, value_name = "UNITS", conflicts_with = "resume")]
    distance: Option<f64>,
    /// Memory for sampling, beside the weights; decides how many views run at once, not what they show [default: 4GB]
    #[arg(long, value_name = "SIZE")]
    memory: Option<Size>,
    /// Where the model runs [default: cpu]
    #[arg(long, value_name = "DEVICE", conflicts_with = "resume")]
    device: Option<Place>,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

const WEIGHTS: &str = "Weights: a small model of 64² pixels comes with gradreel; at 256² runs the checkpoint \
`syncdreamer-pretrain.ckpt` that the authors of SyncDreamer offer at https://github.com/liuyuan-pal/SyncDreamer (5 GB).";

const LONG_HELP: &str = "\
What it does: a multi-view diffusion model (SyncDreamer, Liu et al. 2023) starts from noise in sixteen views, 22.5 degrees \
apart and 30 degrees above the ground, and takes it away step by step, all views together, so that they show one object \
that looks like the picture from where the picture was taken. The back is a guess: look at several seeds.

Weights: a small model comes with gradreel, trained on procedural objects on a processor: 64² pixels, silhouettes rather than \
detail. The checkpoint `syncdreamer-pretrain.ckpt` (5 GB) is offered by the model's authors at \
https://github.com/liuyuan-pal/SyncDreamer and is read as it is; look at their terms first. Weights of a model of other \
sizes say so in the file's metadata, under `gradreel.sizes`.

The picture: the object alone, whole, in the middle, its background removed (transparent, or white). Elevation 0 is a \
camera level with the object, 90 one straight above; −10 to 40 suit the published model.

Results, all in the folder of --out:
  index.html            what was made, from what, and how
  views.png             all views on one sheet
  around.gif            once around the object
  data/, all_data.json  the views as a clip of one frame with its cameras: `gradreel check <folder>`
  latents.safetensors   the latents that were decoded
  preview.png           while sampling: what the views will be, as far as it is known

Weights above 1 GiB are not copied into memory: leave their file alone while a run uses it.

Examples:
  gradreel synthesize cup.png --elevation 20
  gradreel synthesize cup.png --elevation 20 --weights syncdreamer-pretrain.ckpt
  gradreel synthesize cup.png --elevation 20 --weights syncdreamer-pretrain.ckpt --seed 1 --steps 100 --out runs/cup-1
  gradreel synthesize cup.png --weights syncdreamer-pretrain.ckpt --out runs/cup-1 --resume     after Ctrl-C";

/// Synthesizes the views of a picture into a folder.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    interrupt::install()?;
    let progress = Progress::new(arguments.quiet);
    let weights = arguments.weights.as_deref().unwrap_or(Path::new(FileWeights::BUILT_IN));
    let job = if arguments.resume { Job::resume(arguments, weights)? } else { Job::begin(arguments, weights)? };
    if !arguments.quiet {
        tell!("{job}");
    }
    job.finish(&progress).map_err(|error| match error.kind() {
        ErrorKind::Interrupted => error.fix(format!(
            "go on with `gradreel synthesize {}{} --out {} --resume`",
            arguments.image.display(),
            arguments.weights.as_ref().map_or(String::new(), |weights| format!(" --weights {}", weights.display())),
            job.folder().root().display()
        )),
        _ => error,
    })?;
    say!("\n  open {}", job.folder().path("index.html").display());
    Ok(())
}

/// Synthesizes the views of a picture taken from this elevation in degrees, as part of another run, in a subfolder:
/// a new, interrupted or finished synthesis is started, resumed or reused.
pub(super) fn within(
    folder: &Path,
    picture: PathBuf,
    weights: &Path,
    elevation: f64,
    asked: &ImagineConfig,
    progress: &Progress,
) -> Result<()> {
    let begun = folder.join(job::SETTINGS).exists();
    let ImagineConfig { steps, guidance, seed, .. } = asked.clone();
    let arguments = Arguments {
        image: picture,
        elevation: Some(elevation),
        out: Some(folder.to_owned()),
        steps,
        guidance,
        seed: Some(seed),
        ..Arguments::default()
    };
    let job = if begun { Job::resume(&arguments, weights)? } else { Job::begin(&arguments, weights)? };
    if job.is_published() { Ok(()) } else { job.finish(progress) }
}
