//! `gradreel train novel-view`: training of the multi-view model.

mod evaluate;
mod job;
mod meshes;
mod page;
mod sampled;
mod samples;
mod settings;

use std::path::PathBuf;

use gradreel::{ErrorKind, Result};

use self::job::Job;
use self::settings::{Settings, Stage};
use crate::cli::output::{self, say, tell};
use crate::cli::source::{LARGEST_SEED, Place};
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;

/// Arguments of `gradreel train novel-view`.
#[derive(clap::Args)]
#[command(after_long_help = LONG_HELP)]
pub(super) struct NovelView {
    /// What is trained: the model itself, or its spatial-aware module with everything else frozen [default: base]
    #[arg(long, value_name = "STAGE", conflicts_with = "resume")]
    stage: Option<Stage>,
    /// Weights to start from: needed for the module; without, a base model starts afresh. A file is read while it is used: leave
    /// it as it is until the command ends
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Settings as TOML; what it does not name keeps its default (see --print-config)
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    config: Option<PathBuf>,
    /// Print the settings as TOML, with what --config and other options say, and stop
    #[arg(long, conflicts_with = "resume")]
    print_config: bool,
    /// Folder for the results [default: runs/novel-view, runs/novel-view-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the run in --out where it was interrupted
    #[arg(long, requires = "out")]
    resume: bool,
    /// Train on (or evaluate with) the textured meshes below this folder (.obj with .mtl, .glb, .gltf) in place of
    /// procedural objects; with --resume, where the folder is now
    #[arg(long, value_name = "FOLDER")]
    objects: Option<PathBuf>,
    /// Steps in all
    #[arg(long, value_name = "COUNT", conflicts_with = "resume")]
    steps: Option<u64>,
    /// Samples of a step
    #[arg(long, value_name = "COUNT", conflicts_with = "resume")]
    batch: Option<usize>,
    /// Decides objects, noise and starting weights
    #[arg(long, value_name = "NUMBER", conflicts_with = "resume")]
    #[arg(value_parser = clap::value_parser!(u64).range(..=LARGEST_SEED))]
    seed: Option<u64>,
    /// Where the model is trained
    #[arg(long, value_name = "DEVICE", conflicts_with = "resume")]
    device: Option<Place>,
    /// Train nothing: show the model in --weights so many unseen objects, with and without its spatial-aware module, and
    /// print how well the views agree
    #[arg(long, value_name = "COUNT", requires = "weights", conflicts_with_all = ["resume", "print_config"])]
    evaluate: Option<usize>,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

const LONG_HELP: &str = "\
Objects are made here: solids with patterns, no two alike, filmed by the sixteen cameras of the model. Nothing is downloaded.

With --objects they are meshes from a folder and all below it instead: .obj with its .mtl (Kd, map_Kd) or colours of corners, .glb \
and .gltf (base colours, their textures, COLOR_0), textures as PNG or JPEG. Surfaces need not be closed. A tenth of the files \
(objects.held_out; 1 for a folder that is only evaluated with), chosen by their names, is never trained on: looks in between and \
--evaluate show these. Every file is read once at the start; those that cannot be used are listed and left out. Meshes stay in memory \
up to objects.memory_mb (1024). Textures and buffers are read from the folder of their mesh alone.

Two stages, as in the paper: the base model learns views of objects in the middle; then the spatial-aware module learns to \
put them where the input image shows them, everything else frozen. The module can also be trained for the public \
SyncDreamer weights.

Results, all in the folder of --out:
  index.html            the curves, renewed at every look at unseen objects
  settings.toml         everything that decided the result
  meshes.csv            with --objects: what each file is used for, or why it is not
  log.csv               loss, rate and gradient of every step
  validation.csv        on objects that are never trained on: loss, and of sampled views the distance between the middles of
                        the objects' boxes (shares of the image), IoU of boxes and of silhouettes, PSNR
  previews/             input, true views, sampled views
  state.safetensors     where --resume goes on, bit for bit
  model.safetensors     the whole model, for `gradreel synthesize --weights`

Examples:
  gradreel train novel-view --print-config > small.toml
  gradreel train novel-view --config small.toml --out runs/base --device gpu
  gradreel train novel-view --out runs/base --resume                     after Ctrl-C
  gradreel train novel-view --stage spatial-aware --weights runs/base/model.safetensors --out runs/aware
  gradreel train novel-view --weights runs/aware/model.safetensors --evaluate 100
  gradreel train novel-view --weights built-in --objects my_meshes --out runs/mine
  gradreel train novel-view --weights runs/mine/model.safetensors --objects my_meshes --evaluate 20
  gradreel weights convert runs/aware/model.safetensors small.safetensors --f16";

/// Trains or evaluates a model.
pub(super) fn run(arguments: &NovelView) -> Result<()> {
    interrupt::install()?;
    if arguments.print_config {
        let (settings, _) = Settings::resolve(arguments)?;
        output::print(format_args!("{}", settings.to_toml()));
        return output::arrived();
    }
    let progress = Progress::new(arguments.quiet);
    if let Some(count) = arguments.evaluate {
        return evaluate::run(arguments, count, &progress);
    }
    let mut job = match arguments.resume {
        true => Job::resume(arguments, &progress)?,
        false => Job::begin(arguments, &progress)?,
    };
    if !arguments.quiet {
        tell!("{job}");
    }
    let root = job.folder().root().display().to_string();
    job.finish(&progress, !arguments.quiet).map_err(|error| match error.kind() {
        ErrorKind::Interrupted => {
            let weights = arguments.weights.as_ref().map_or(String::new(), |w| format!(" --weights {}", w.display()));
            error.fix(format!("go on with `gradreel train novel-view{weights} --out {root} --resume`"))
        }
        _ => error,
    })?;
    say!("\n  model {}", job.folder().path("model.safetensors").display());
    say!("  open  {}", job.folder().path("index.html").display());
    Ok(())
}
