//! `gradreel train depth`: training of the network that tells front and back depth from one masked picture.

mod data;
mod job;
mod page;
mod settings;

use std::path::{Path, PathBuf};

use gradreel::{ErrorKind, Result};

use self::job::Job;
use self::settings::Settings;
use crate::cli::output::{self, say, tell};
use crate::cli::source::LARGEST_SEED;
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;

/// Arguments of `gradreel train depth`.
#[derive(clap::Args)]
#[command(after_long_help = LONG_HELP)]
pub(super) struct Depth {
    /// Folder with shapes_train.safetensors and shapes_val.safetensors; when a run goes on, where they are now
    #[arg(long, value_name = "FOLDER")]
    shapes: Option<PathBuf>,
    /// Settings as TOML; what it does not name keeps its default (see --print-config)
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print the settings as TOML, with what --config and other options say, and stop
    #[arg(long)]
    print_config: bool,
    /// Folder for the results [default: runs/depth, runs/depth-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the run in --out where it was interrupted; with WEIGHTS, begin a run from these instead: `built-in`, or the
    /// model.safetensors of a run
    #[arg(long, value_name = "WEIGHTS", num_args = 0..=1)]
    resume: Option<Option<PathBuf>>,
    /// Steps in all
    #[arg(long, value_name = "COUNT")]
    steps: Option<u64>,
    /// Pictures of a step
    #[arg(long, value_name = "COUNT")]
    batch: Option<usize>,
    /// Decides pictures, procedural solids and starting weights
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u64).range(..=LARGEST_SEED))]
    seed: Option<u64>,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

const LONG_HELP: &str = "\
Pictures are drawn here, afresh for every step: real shapes and procedural solids, half of them upright and half in all attitudes, in
random light, with noise and wrong silhouettes. No picture repeats. The files of shapes are described in docs/guide/training.md.
Validation uses the shapes of shapes_val.safetensors alone; those of shapes_test.safetensors are not read.

Results, all in the folder of --out:
  index.html            the curves, renewed at every validation
  settings.toml         everything that decided the result
  log.csv               loss, front error [D], overlap along parallel rays, rate and gradient of every step
  validation.csv        on unseen shapes: IoU along rays, that of the body as deep as wide, errors of front and back [D], share of
                        tilts above 20 degrees with the wrong sign; one picture without its mirror image
  previews/             picture, and true and predicted front and back
  state.safetensors     where --resume goes on, bit for bit
  model.safetensors     the averaged weights

Examples:
  gradreel train depth --shapes shapes --print-config > depth.toml
  gradreel train depth --shapes shapes --config depth.toml --out runs/depth
  gradreel train depth --out runs/depth --resume                             after Ctrl-C
  gradreel train depth --shapes shapes --resume built-in --steps 2000        learn on from the weights of the program";

impl Depth {
    /// The weights from which a new run begins.
    fn weights(&self) -> Option<&Path> {
        self.resume.as_ref().and_then(Option::as_deref)
    }
}

/// Trains the network.
pub(super) fn run(arguments: &Depth) -> Result<()> {
    interrupt::install()?;
    if arguments.print_config {
        let settings = Settings::resolve(arguments)?;
        output::print(format_args!("{}", settings.to_toml()));
        return output::arrived();
    }
    let progress = Progress::new(arguments.quiet);
    let mut job = match arguments.resume {
        Some(None) => Job::resume(arguments, &progress)?,
        _ => Job::begin(arguments, &progress)?,
    };
    if !arguments.quiet {
        tell!("{job}");
    }
    let root = job.folder().root().display().to_string();
    job.finish(&progress, !arguments.quiet).map_err(|error| match error.kind() {
        ErrorKind::Interrupted => error.fix(format!("go on with `gradreel train depth --out {root} --resume`")),
        _ => error,
    })?;
    say!("\n  model {}", job.folder().path("model.safetensors").display());
    say!("  open  {}", job.folder().path("index.html").display());
    Ok(())
}
