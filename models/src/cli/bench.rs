//! `gradreel bench`: what the parts of the method are worth.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::ablation::{AblationSettings, Cell, CellResult, ClipResults, Truth, markdown};
use crate::identify::Config;
use crate::report::interrupt;
use crate::report::progress::Progress;
use crate::report::run_folder::RunFolder;
use crate::video::Clip;

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
}

#[derive(clap::Args)]
#[command(after_long_help = LONG_HELP)]
struct AblationArguments {
    /// Folders of clips whose views are all real (see `gradreel check --help`)
    #[arg(required_unless_present = "resume", conflicts_with = "resume")]
    clips: Vec<PathBuf>,
    /// Folder for the results [default: runs/ablation, runs/ablation-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the ablation in --out; cells that are finished are not run again
    #[arg(long, requires = "out")]
    resume: bool,
    /// Only these cells of the table [default: all]
    #[arg(long, value_delimiter = ',', value_name = "NAMES", conflicts_with = "resume")]
    cells: Vec<Cell>,
    /// A tiny budget, to see that everything runs; the numbers mean nothing
    #[arg(long, conflicts_with = "resume")]
    quick: bool,
    /// Settings of the reconstructions as TOML, as for `gradreel reconstruct`
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    config: Option<PathBuf>,
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
    /// Use the first so many frames only
    #[arg(long, value_name = "COUNT", conflicts_with = "resume")]
    frames: Option<usize>,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

const LONG_HELP: &str = "\
Cells of the table:
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
        What::Ablation(arguments) => ablation(arguments),
    }
}

/// What was asked for, as the folder keeps it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Plan {
    clips: Vec<PathBuf>,
    cells: Vec<Cell>,
    /// Whether the material is that of the truth.
    material_of_truth: bool,
    settings: AblationSettings,
}

const PLAN: &str = "ablation.toml";

fn ablation(arguments: &AblationArguments) -> Result<()> {
    interrupt::install()?;
    let progress = Progress::new(arguments.quiet);
    let (plan, folder) = if arguments.resume { go_on(arguments)? } else { begin(arguments)? };
    let mut results = Vec::new();
    for (number, path) in plan.clips.iter().enumerate() {
        let clip = label(path, plan.clips.iter().take(number));
        let mut cells = BTreeMap::new();
        for cell in plan.cells.iter().map(|cell| cell.name()) {
            if let Some(result) = finished(&folder, &format!("{clip}/{cell}"))? {
                cells.insert(cell.to_owned(), result);
            }
        }
        results.push(ClipResults { clip, truth: Truth::beside(path), cells });
    }
    let bar = progress.stage("cells", (plan.clips.len() * plan.cells.len()) as u64);
    for (number, path) in plan.clips.iter().enumerate() {
        let ClipResults { clip: name, truth, cells } = &mut results[number];
        let settings = plan.settings_of(truth.as_ref());
        let clip = open(path, &settings)?;
        for (position, &cell) in plan.cells.iter().enumerate() {
            bar.set((number * plan.cells.len() + position) as u64, &format!("{name}: {}", cell.label()));
            let place = format!("{name}/{}", cell.name());
            if !cells.contains_key(cell.name()) {
                let run = settings.run(cell, &clip, truth.as_ref(), &folder.path(&place), &progress);
                let result = run.map_err(|error| with_way_on(error, &folder))?;
                folder.write(&format!("{place}.json"), &serde_json::to_vec_pretty(&result).map_err(unwritable)?)?;
                cells.insert(cell.name().to_owned(), result);
            }
        }
        folder.write("ablation.json", &serde_json::to_vec_pretty(&results).map_err(unwritable)?)?;
        folder.write("ablation.md", markdown(&results).as_bytes())?;
    }
    bar.finish(&folder.path("ablation.md").display().to_string());
    println!("{}", markdown(&results));
    println!("  {}", folder.path("ablation.md").display());
    Ok(())
}

fn begin(arguments: &AblationArguments) -> Result<(Plan, RunFolder)> {
    let mut settings = if arguments.quick { quick() } else { AblationSettings::default() };
    if let Some(path) = &arguments.config {
        settings.config = super::reconstruct::read_config(path)?;
    }
    if let Some(material) = &arguments.material {
        settings.config.material.name.clone_from(material);
    }
    settings.config.clip.frames = arguments.frames.unwrap_or(settings.config.clip.frames);
    settings.config.check()?;
    settings.primary = arguments.primary;
    let imagined = &mut settings.perturbation;
    imagined.shift = arguments.shift.unwrap_or(imagined.shift);
    imagined.tint = arguments.tint.unwrap_or(imagined.tint);
    imagined.seed = arguments.seed.map_or(imagined.seed, u64::from);
    for (name, value, most) in [("--shift", imagined.shift, 1000.0), ("--tint", imagined.tint, 1.0)] {
        if !(0.0..=most).contains(&value) {
            return Err(Error::new(ErrorKind::Input, "views cannot be imagined like this")
                .at(name)
                .found(value)
                .wanted(format!("0 to {most}"))
                .fix("leave it out for the default"));
        }
    }
    let clips = arguments.clips.iter().map(|path| path.canonicalize().unwrap_or_else(|_| path.clone())).collect();
    let mut cells = if arguments.cells.is_empty() { Cell::ALL.to_vec() } else { arguments.cells.clone() };
    cells.sort();
    cells.dedup();
    let material_of_truth = arguments.material.is_none() && settings.config.material == Config::default().material;
    let plan = Plan { clips, cells, material_of_truth, settings };
    // clips that cannot be used leave no trace
    for path in &plan.clips {
        open(path, &plan.settings_of(Truth::beside(path).as_ref()))?;
    }
    let text = toml::to_string_pretty(&plan).map_err(unwritable)?;
    let folder = match &arguments.out {
        Some(folder) => RunFolder::create(folder)?,
        None => RunFolder::create_free(Path::new("runs"), "ablation")?,
    };
    folder.write(PLAN, text.as_bytes())?;
    Ok((plan, folder))
}

fn go_on(arguments: &AblationArguments) -> Result<(Plan, RunFolder)> {
    let folder = RunFolder::open(arguments.out.as_deref().unwrap_or(Path::new(".")))?;
    let fix = "give the folder of an interrupted ablation to --out, or begin one without --resume";
    folder.goes_on(PLAN, "there is no ablation to go on with", fix)?;
    let text = String::from_utf8_lossy(&folder.read(PLAN)?).into_owned();
    let plan: Plan = toml::from_str(&text).map_err(|e| damaged(&folder, PLAN, &e))?;
    plan.settings.config.check().map_err(|e| e.at(folder.path(PLAN).display()))?;
    Ok((plan, folder))
}

impl Plan {
    /// The settings for a clip of this truth.
    fn settings_of(&self, truth: Option<&Truth>) -> AblationSettings {
        let mut settings = self.settings.clone();
        if let (true, Some(truth)) = (self.material_of_truth, truth) {
            settings.config.material.name.clone_from(&truth.family);
        }
        settings
    }
}

/// The tiny budget.
fn quick() -> AblationSettings {
    let mut settings = AblationSettings::default();
    let Config { geometry, estimate, .. } = &mut settings.config;
    (geometry.dx, geometry.fit.iterations, geometry.fit.in_motion) = (0.08, 6, 2);
    (estimate.velocity, estimate.scan, estimate.starts) = (2, 1, 1);
    (estimate.first, estimate.fine, estimate.rounds, estimate.coarse) = (1, 1, 0, 1);
    let encoding = &mut settings.config.temporal.first;
    (encoding.frames, encoding.side) = (3, 24);
    (encoding.field.width, encoding.field.channels) = (8, 2);
    (encoding.fit.iterations, encoding.fit.rays, encoding.fit.nodes, encoding.fit.mask_nodes) = (12, 128, 2000, 500);
    settings
}

fn open(path: &Path, settings: &AblationSettings) -> Result<Clip> {
    let clip = super::reconstruct::open(path, &settings.config)?;
    let refused = |what: &str, found: String, fix: &str| {
        Err(Error::new(ErrorKind::Input, what).at(path.display()).found(found).fix(fix))
    };
    let ids: Vec<String> = clip.cameras.iter().map(|camera| camera.id.to_string()).collect();
    match settings.primary {
        Some(id) if clip.cameras.iter().all(|camera| camera.id != id) => refused(
            "the clip has no such camera to stay real",
            format!("camera {id} of {}", ids.join(", ")),
            "choose one with --primary",
        ),
        _ if clip.cameras.len() < 3 => refused(
            "an ablation imagines views and holds one out",
            format!("cameras {}", ids.join(", ")),
            "give a clip of three cameras or more",
        ),
        _ if clip.imagined.contains(&true) => refused(
            "an ablation imagines views of its own",
            "views that are imagined already".into(),
            "give a clip of real views",
        ),
        _ => Ok(clip),
    }
}

/// The clip's name, or its folder's if the clip is called `clip`; told apart from those before it.
fn label<'a>(path: &Path, before: impl Iterator<Item = &'a PathBuf>) -> String {
    let component = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let name = |path: &Path| match component(path) {
        Some(name) if name != "clip" => name,
        _ => path.parent().and_then(component).unwrap_or_else(|| "clip".into()),
    };
    let own = name(path);
    match before.filter(|other| name(other) == own).count() {
        0 => own,
        more => format!("{own}-{}", more + 1),
    }
}

fn finished(folder: &RunFolder, place: &str) -> Result<Option<CellResult>> {
    let file = format!("{place}.json");
    if !folder.has(&file) {
        return Ok(None);
    }
    serde_json::from_slice(&folder.read(&file)?).map(Some).map_err(|e| damaged(folder, &file, &e))
}

fn damaged(folder: &RunFolder, name: &str, found: &dyn std::fmt::Display) -> Error {
    Error::new(ErrorKind::Input, "a file of the ablation is damaged")
        .at(folder.path(name).display())
        .found(found)
        .fix("remove the file of a cell to run it again, or begin again with another --out")
}

fn unwritable(error: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Io, "the ablation cannot be written").found(error)
}

fn with_way_on(error: Error, folder: &RunFolder) -> Error {
    match error.kind() {
        ErrorKind::Interrupted => {
            error.fix(format!("go on with `gradreel bench ablation --out {} --resume`", folder.root().display()))
        }
        _ => error,
    }
}
