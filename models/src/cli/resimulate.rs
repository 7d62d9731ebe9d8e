//! `gradreel simulate --from RUN`: resimulates a reconstruction under different conditions.

use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

use crate::cli::output::say;
use crate::cli::unit::{self, Named, number_in};
use crate::identify::{Changes, Reconstruction, Run};
use crate::report::reconstruction::publish;
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;

/// What to simulate again, and what to change.
#[derive(clap::Args, Default)]
#[group(skip)] // `simulate` has a group of this name
#[command(next_help_heading = "What was reconstructed, again")]
pub(super) struct Arguments {
    /// Simulate what the run in this folder has found, instead of a scene; filmed beside its clip
    #[arg(long, value_name = "RUN", conflicts_with_all = ["scene", "resume", "plan", "duration", "precision", "film", "no_gif"])]
    pub from: Option<PathBuf>,
    /// Other parameters of the material, for example young=1MPa,poisson=0.4, in SI units if without a unit
    #[arg(long, value_delimiter = ',', value_name = "NAME=VALUE", value_parser = Named::read, requires = "from")]
    set: Vec<Named>,
    /// Another initial velocity [m/s]
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, requires = "from")]
    velocity: Option<[f64; 3]>,
    /// Another initial spin about its centre of mass [rad/s]
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, requires = "from")]
    spin: Option<[f64; 3]>,
    /// Another gravity [m/s²], for example 0,-1.62,0 for the moon
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true, requires = "from")]
    gravity: Option<[f64; 3]>,
    /// Another height of the ground [m]
    #[arg(long, value_name = "M", value_parser = |text: &str| number_in(text, "m"))]
    #[arg(allow_negative_numbers = true, requires = "from")]
    ground: Option<f64>,
    /// Where the run's clip is now, if it was moved
    #[arg(long, value_name = "FOLDER", requires = "from")]
    clip: Option<PathBuf>,
}

/// Resimulates and renders into a new folder, which is itself a run.
pub(super) fn run(arguments: &Arguments, from: &Path, out: Option<&Path>, quiet: bool) -> Result<()> {
    interrupt::install()?;
    if let Some(folder) = out {
        super::place::check(folder, None)?;
    }
    let progress = Progress::new(quiet);
    out.map_or(Ok(()), RunFolder::can_be_created)?;
    let before = Run::open(RunFolder::open(from)?)?;
    let path = arguments.clip.clone().or_else(|| before.state.clip_path.clone()).ok_or_else(|| {
        Error::new(ErrorKind::Input, "the run does not say where its clip is")
            .at(from.display())
            .fix("give its folder with --clip")
    })?;
    let clip = super::reconstruct::open(&path, &before.config, quiet)
        .map_err(|e| e.fix(format!("if the clip of {} was moved, give its folder with --clip", from.display())))?;
    before.belongs_to(&clip)?;
    let mut found = Reconstruction::of(&before, &clip)?;
    let changes = Changes {
        parameters: unit::of_law(&arguments.set, &found.law, "--set")?,
        velocity: arguments.velocity,
        spin: arguments.spin,
        gravity: arguments.gravity,
        ground: arguments.ground,
    };
    let mut again = before.copied();
    let words = changes.apply(&mut found, &mut again)?;
    // create no folder for a simulation that fails
    found.motion(&again)?;
    again.folder = match out {
        Some(folder) => RunFolder::create(folder)?,
        None => RunFolder::create_free(Path::new("runs"), &format!("{}-again", clip.name))?,
    };
    again.begin_from(&before)?;
    publish(&found, &again, &clip, &progress)?;
    if !quiet {
        words.iter().for_each(|change| say!("  {change}"));
        say!("\n  open {}", again.folder.path("index.html").display());
    }
    Ok(())
}

/// Parses three numbers.
fn vector(text: &str) -> std::result::Result<[f64; 3], String> {
    let numbers: std::result::Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let numbers = numbers.map_err(|e| format!("{text:?}: {e}; three numbers are wanted, such as 0,-9.8,0"))?;
    <[f64; 3]>::try_from(numbers).map_err(|_| format!("{text:?}: three numbers are wanted, such as 0,-9.8,0"))
}
