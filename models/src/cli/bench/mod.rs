//! `gradreel bench`: what the parts of the method are worth.

mod films;
mod job;

use std::path::PathBuf;

use gradreel::Result;

use crate::ablation::{Cell, Published};

/// Arguments of `gradreel bench`.
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Reconstruct from imagined views with and without the view-adaptive loss, and fit the moving field with and without its
    /// encoding of time
    Ablation(AblationArguments),
    /// Table 1 of the paper: one view against all views, on clips of the five families of materials
    Table1(TableArguments),
    /// Table 2 of the paper: imagined views with and without the view-adaptive loss, on clips of the five families
    Table2(TableArguments),
}

#[derive(clap::Args, Clone)]
#[command(after_long_help = TABLES)]
struct TableArguments {
    /// Folders of clips whose views are all real [default: a film of each family of materials, which is made first]
    #[arg(conflicts_with = "resume")]
    clips: Vec<PathBuf>,
    #[command(flatten)]
    common: Common,
}

/// What all benchmarks are told alike.
#[derive(clap::Args, Clone, Default)]
struct Common {
    /// Folder for the results [default: runs/ablation, runs/ablation-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the benchmark in --out; cells that are finished are not run again
    #[arg(long, requires = "out")]
    resume: bool,
    /// A tiny budget, to see that everything runs; the numbers mean nothing
    #[arg(long, conflicts_with = "resume")]
    quick: bool,
    /// Settings of the reconstructions as TOML, as for `gradreel reconstruct`
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    config: Option<PathBuf>,
    /// Use the first so many frames only
    #[arg(long, value_name = "COUNT", conflicts_with = "resume")]
    frames: Option<usize>,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

const TABLES: &str = "\
The clips are of elastic, plasticine, newtonian, non-newtonian and granular objects, simulated and filmed here by seven
cameras; their truth is known, so that the table has errors. The paper's objects are others (those of PAC-NeRF): its printed
numbers stand below for comparison.

Each cell takes as long as `gradreel reconstruct` does: one to two hours in all on two cores. After Ctrl-C, go on with
--out FOLDER --resume.";

#[derive(clap::Args, Default)]
#[command(after_long_help = LONG_HELP)]
struct AblationArguments {
    /// Folders of clips whose views are all real (see `gradreel check --help`)
    #[arg(required_unless_present = "resume", conflicts_with = "resume")]
    clips: Vec<PathBuf>,
    /// Only these cells of the table [default: all]
    #[arg(long, value_delimiter = ',', value_name = "NAMES", conflicts_with = "resume")]
    cells: Vec<Cell>,
    /// Material of all clips [default: that of the truth beside each clip, or of --config]
    #[arg(long, value_name = "NAME", conflicts_with = "resume")]
    material: Option<String>,
    /// Number of the camera that stays real [default: the first]
    #[arg(long, value_name = "NUMBER", conflicts_with = "resume")]
    primary: Option<i64>,
    /// Largest shift of an imagined picture, half of it alike in all frames [pixels of the clip] [default: 3]
    #[arg(long, value_name = "PIXELS", conflicts_with = "resume")]
    shift: Option<f64>,
    /// Largest change of an imagined view's colours, as a share [default: 0.2]
    #[arg(long, value_name = "SHARE", conflicts_with = "resume")]
    tint: Option<f64>,
    /// Other seeds imagine other views [default: 1]
    #[arg(long, value_name = "NUMBER", conflicts_with = "resume")]
    seed: Option<u32>,
    #[command(flatten)]
    common: Common,
    #[arg(skip)]
    published: Option<Published>,
}

const LONG_HELP: &str = "\
Cells of the table:
  single       reconstruction from one real view alone, as of a film from one camera
  real         reconstruction from all views as they were filmed: what there is to lose
  with_lva     one view stays real, the others are imagined: misregistered by a few pixels, colour-shifted; each counts
               exp(−α Δθ) by its angle Δθ to the real one ([loss.views] alpha = 1 per radian)
  without_lva  the same, but all views count alike (alpha = 0)
  plain        the same, and squared residuals in place of robust ones and no ranges of parameters, too
  time         the moving field, fitted to the first frames of all views but one, and the view that was held out
  bending      the same without merging features with positions and time: coordinates are bent and nothing else
  still        the same without any encoding of time

Where the truth lies beside a clip (truth.json in it, or the scene.toml of `gradreel simulate --film`), the table has
errors, and the material is the true one. A cell takes as long as `gradreel reconstruct` does, those of the field a minute or two.

Results: ablation.md (the table), ablation.json (every number), and a folder a clip with one run a cell: open its
index.html.

Examples:
  gradreel bench ablation examples/clips/bird                            all cells of one clip, about half an hour
  gradreel bench ablation my/a my/b --cells with_lva,without_lva         the published table
  gradreel bench ablation examples/clips/bird --cells time,bending,still
  gradreel bench ablation --out runs/ablation --resume                   go on after Ctrl-C";

/// Runs a benchmark.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.what {
        What::Ablation(arguments) => job::run(arguments),
        What::Table1(table) => job::run(&table.beside(Published::Table1)),
        What::Table2(table) => job::run(&table.beside(Published::Table2)),
    }
}

impl TableArguments {
    /// The ablation that makes the table.
    fn beside(&self, published: Published) -> AblationArguments {
        let Self { clips, common } = self.clone();
        let cells = match published {
            Published::Table1 => vec![Cell::Single, Cell::Real],
            Published::Table2 => vec![Cell::WithLva, Cell::WithoutLva],
        };
        let published = Some(published);
        AblationArguments { clips, common, cells, published, ..AblationArguments::default() }
    }
}
