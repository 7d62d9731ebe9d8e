//! `gradreel bench`: ablations and benchmarks of the method.

mod calibrate;
mod coverage;
mod depth;
mod figure5;
mod film;
mod films;
mod job;
mod laws;

use std::path::PathBuf;

use gradreel::Result;

use crate::ablation::{Cell, Published};
use crate::cli::published::Method;
use films::Films;

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
    /// Ten films of the five families of materials, searched from afar: errors, and how often the stated intervals hold the truth
    Families(FamilyArguments),
    /// Many small random clips: errors, and how often intervals hold the truth
    Coverage(coverage::Arguments),
    /// The error budget from clips that were fitted: what errs together, and by how much
    Calibrate(calibrate::Arguments),
    /// Front and back depth from one picture, beside simpler bodies: IoU, signs of tilts, errors, how well they are stated
    Depth(depth::Arguments),
    /// Laws in WGSL beside the same laws in Rust: the time of a rollout
    Laws(laws::Arguments),
    /// Films of phones, made here or by people: which `check` accepts, what it finds in them, and how long it takes
    Films(film::Arguments),
    /// Table 1 of the paper: one view against all views, on clips of the five families of materials
    Table1(TableArguments),
    /// Table 2 of the paper: imagined views with and without the view-adaptive loss, on clips of the five families
    Table2(TableArguments),
    /// Figure 5 of the paper: views with and without the spatial-aware module, and how far the object is from its place in them
    Figure5(FigureArguments),
}

#[derive(clap::Args, Clone)]
#[command(after_long_help = TABLES)]
struct TableArguments {
    /// Folders of clips whose views are all real [default: a film of each family of materials, which is made first]
    #[arg(conflicts_with = "resume")]
    clips: Vec<PathBuf>,
    /// The reconstructions: own, or the published chain of `gradreel reconstruct --method published`
    #[arg(long, value_name = "METHOD", value_enum, default_value = "own", hide_possible_values = true)]
    method: Method,
    #[command(flatten)]
    common: Common,
}

#[derive(clap::Args, Clone)]
#[command(after_long_help = FIGURE)]
struct FigureArguments {
    /// Folders of clips whose views are all real [default: a film of each family of materials, which is made first]
    #[arg(conflicts_with = "resume")]
    clips: Vec<PathBuf>,
    #[command(flatten)]
    common: Common,
}

const FIGURE: &str = "\
Of each clip one camera is the film. Of three of its frames the views are made three times: with the module, which is told the box
and the distance; without it, from the same picture; and of the object in the middle, moved to its place. Where the object really is
tells the hull of all cameras. Results: figure5.svg, figure5.md, and the views of each film.

With --out FOLDER --resume, the films of a table that was made there are used. The model is that of [published] weights in the file of
--config [default: built-in].";

#[derive(clap::Args, Clone)]
#[command(after_long_help = FAMILIES)]
struct FamilyArguments {
    /// Folders of clips beside which their truth lies [default: two films of each family, which are made first]
    #[arg(conflicts_with = "resume")]
    clips: Vec<PathBuf>,
    /// Let each family try as well, as `reconstruct --material auto` does
    #[arg(long, conflicts_with = "resume")]
    auto: bool,
    /// Let each family try, and do not tell any clip's
    #[arg(long, conflicts_with_all = ["resume", "auto"])]
    only_auto: bool,
    /// Start magnitudes so many times below and above the truth, in turn, where the family is told
    #[arg(long, value_name = "FACTOR", default_value_t = 30.0, value_parser = factor)]
    off: f64,
    /// Film on a finer grid with shorter steps than reconstructions use (0.014 m in place of 0.02 m)
    #[arg(long, conflicts_with_all = ["resume", "clips", "quick"])]
    fine: bool,
    #[command(flatten)]
    common: Common,
}

const FAMILIES: &str = "\
Each clip is reconstructed from all its views with the settings that `gradreel reconstruct` has by itself. The table says how far
every number is off, and whether the truth is in the interval of 90 % that the run states. Parameters that are no magnitudes
(Poisson's ratio, angles) start at the end of what is plausible that is further from the truth.

It takes about half an hour on two cores, a quarter of one with --quick; with --only-auto a little over an hour, with --auto both. After Ctrl-C, go on with --out FOLDER --resume.

Examples:
  gradreel bench families                                 ten films, families told, starts a factor of 30 off
  gradreel bench families --only-auto                     which family is found
  gradreel bench families --quick --markdown results.md   five films, coarsely; the table becomes a section of the file
  gradreel bench families my/clip --off 100               a clip of one's own with truth.json in it";

fn factor(text: &str) -> Result<f64, String> {
    let wanted = "a factor from 1 to 1000";
    text.parse().ok().filter(|factor| (1.0..=1e3).contains(factor)).ok_or_else(|| wanted.to_owned())
}

/// Options common to all benchmarks.
#[derive(clap::Args, Clone, Default)]
struct Common {
    /// Folder for the results [default: runs/ablation, runs/ablation-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the benchmark in --out; cells that are finished are not run again
    #[arg(long, requires = "out")]
    resume: bool,
    /// A small budget. Of `families`, a coarse form of the table in a quarter of an hour: a film of each family, on a coarser grid. Of
    /// the others a tiny one, to see that everything runs; the numbers then mean nothing
    #[arg(long, conflicts_with = "resume")]
    quick: bool,
    /// Write the table with the machine, the commit and the date into its section of this Markdown file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
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
--out FOLDER --resume. With --resume the other table, and figure5, can be made in the same folder: films, and cells that both
have, are made once.

With --method published, cells are runs of the published chain; those of a film share its views. --quick then is a coarser
form on a grid of 0.04 m with twelve frames, whose numbers mean something.";

#[derive(clap::Args, Default)]
#[command(after_long_help = LONG_HELP)]
struct AblationArguments {
    /// Folders of clips whose views are all real (see `gradreel check --help`)
    #[arg(required_unless_present = "resume", conflicts_with = "resume")]
    clips: Vec<PathBuf>,
    /// Only these cells of the table [default: all but auto]
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
    #[arg(skip)]
    off: Option<f64>,
    #[arg(skip)]
    films: Option<Films>,
    /// A coarse form whose numbers mean something.
    #[arg(skip)]
    coarse: bool,
}

const LONG_HELP: &str = "\
Cells of the table:
  single       reconstruction from one real view alone, as of a film from one camera
  real         reconstruction from all views as they were filmed: what there is to lose
  auto         the same, and the family of materials is not told; only if it is named
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
        What::Ablation(arguments) => job::run(arguments, ("ablation", "What parts of the method are worth")),
        What::Coverage(arguments) => coverage::run(arguments),
        What::Calibrate(arguments) => calibrate::run(arguments),
        What::Depth(arguments) => depth::run(arguments),
        What::Laws(arguments) => laws::run(arguments),
        What::Films(arguments) => film::run(arguments),
        What::Families(families) => job::run(&families.all_views(), ("families", "The five families")),
        What::Table1(table) => {
            job::run(&table.beside(Published::Table1), table.named("table1", "One view against all views"))
        }
        What::Table2(table) => job::run(&table.beside(Published::Table2), table.named("table2", "Imagined views")),
        What::Figure5(figure) => figure5::run(&figure.chain()),
    }
}

impl FamilyArguments {
    /// The benchmark as an ablation with a single, complete variant.
    fn all_views(&self) -> AblationArguments {
        let Self { clips, mut common, .. } = self.clone();
        let coarse = std::mem::take(&mut common.quick);
        let cells = match (self.auto, self.only_auto) {
            (true, _) => vec![Cell::Real, Cell::Auto],
            (_, true) => vec![Cell::Auto],
            _ => vec![Cell::Real],
        };
        let films = Some(match (coarse, self.fine) {
            (true, _) => Films::ONE_EACH,
            (_, true) => Films::TWO_EACH.fine(),
            _ => Films::TWO_EACH,
        });
        AblationArguments { clips, common, cells, off: Some(self.off), films, coarse, ..AblationArguments::default() }
    }
}

impl TableArguments {
    /// The ablation that produces the table.
    fn beside(&self, published: Published) -> AblationArguments {
        let Self { clips, mut common, method } = self.clone();
        let cells = match (published, method) {
            (Published::Table1, Method::Own) => vec![Cell::Single, Cell::Real],
            (Published::Table2, Method::Own) => vec![Cell::WithLva, Cell::WithoutLva],
            (Published::Table1, Method::Published) => vec![Cell::Published, Cell::PublishedViews],
            (Published::Table2, Method::Published) => vec![Cell::Published, Cell::PublishedWithoutLva],
        };
        let coarse = method == Method::Published && std::mem::take(&mut common.quick);
        let films = coarse.then_some(Films::ONE_EACH.coarse());
        let published = Some(published);
        AblationArguments { clips, common, cells, published, films, coarse, ..AblationArguments::default() }
    }

    /// Name and title of the section in a results file.
    fn named(&self, name: &'static str, title: &'static str) -> (&'static str, &'static str) {
        match (self.method, name) {
            (Method::Own, _) => (name, title),
            (Method::Published, "table1") => ("table1-published", "The published chain, one view against all views"),
            (Method::Published, _) => ("table2-published", "The published chain, with and without L_va"),
        }
    }
}

impl FigureArguments {
    /// The plan of a published chain.
    fn chain(&self) -> AblationArguments {
        let Self { clips, mut common } = self.clone();
        let coarse = std::mem::take(&mut common.quick);
        let films = coarse.then_some(Films::ONE_EACH.coarse());
        AblationArguments { clips, common, cells: vec![Cell::Published], films, coarse, ..AblationArguments::default() }
    }
}
