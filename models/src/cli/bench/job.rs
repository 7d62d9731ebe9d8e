//! One benchmark: its plan, its cells in sequence, and its table.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::AblationArguments;
use super::films::{self, Films};
use crate::ablation::{AblationSettings, Cell, CellResult, ClipResults, Published, Truth, markdown};
use crate::cli::output::say;
use crate::identify::Config;
use crate::report::results_file::{self, Measured, Section};
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::video::Clip;

/// The plan as saved in the folder.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Plan {
    pub clips: Vec<PathBuf>,
    cells: Vec<Cell>,
    /// Whether the true material is given.
    material_of_truth: bool,
    /// The published table for comparison.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    published: Option<Published>,
    /// Factor between the starting values and the truth, unless the default starting values are used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    off: Option<f64>,
    /// Rendered clips, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub films: Option<Films>,
    /// Whether it is the coarse variant.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub coarse: bool,
    settings: AblationSettings,
}

const PLAN: &str = "ablation.toml";

/// Runs all remaining cells; `name` and `title` are those of the section in a results file.
pub(super) fn run(arguments: &AblationArguments, (name, title): (&str, &str)) -> Result<()> {
    interrupt::install()?;
    let progress = Progress::new(arguments.common.quiet);
    let (plan, folder) = if arguments.common.resume { go_on(arguments)? } else { begin(arguments)? };
    if let Some(wanted) = plan.films {
        films::make(&folder, wanted, &progress).map_err(|error| with_way_on(error, &folder))?;
    }
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
        folder.write("ablation.md", plan.table(&results).as_bytes())?;
    }
    bar.finish(&folder.path("ablation.md").display().to_string());
    if let Some(file) = &arguments.common.markdown {
        let split = match plan.films {
            Some(_) => "development: films of examples/scenes/families",
            None => "clips that were given on the command line",
        };
        let own = results.iter().any(|result| result.truth.as_ref().is_some_and(|truth| truth.law.is_some()));
        let [name, title] = match (own, plan.coarse) {
            (true, _) => [format!("{name}-own-laws"), "Films of laws of one's own".to_owned()],
            (_, true) => [format!("{name}-quick"), format!("{title}, coarsely")],
            _ => [name.to_owned(), title.to_owned()],
        };
        let split = split.to_owned();
        let section = Section { name, title, split, body: below(&plan.table(&results)) };
        results_file::replace(file, &section, &Measured::here("gradreel"))?;
    }
    say!("{}", plan.table(&results));
    say!("  {}", folder.path("ablation.md").display());
    Ok(())
}

pub(super) fn begin(arguments: &AblationArguments) -> Result<(Plan, RunFolder)> {
    if let Some(folder) = &arguments.common.out {
        crate::cli::place::check(folder, None)?;
    }
    if arguments.common.quick && arguments.common.markdown.is_some() {
        return Err(Error::new(ErrorKind::Input, "numbers of so tiny a budget are no results")
            .at("--markdown")
            .found("--quick")
            .fix("leave one of them out, or measure with `gradreel bench families --quick`"));
    }
    let of_chain = arguments.cells.iter().any(|cell| cell.is_published());
    let mut settings = match (arguments.coarse, arguments.common.quick) {
        (true, _) if of_chain => coarse_chain(),
        (true, _) => coarse(),
        (_, true) => quick(),
        _ => AblationSettings::default(),
    };
    if let Some(path) = &arguments.common.config {
        settings.config = crate::cli::reconstruct::read_config(path)?;
    }
    if of_chain {
        settings.config.published.get_or_insert_default();
    }
    if let Some(material) = &arguments.material {
        settings.config.material.name.clone_from(material);
    }
    settings.config.clip.frames = arguments.common.frames.unwrap_or(settings.config.clip.frames);
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
    let films = arguments.films.unwrap_or(Films::ONE_EACH);
    let films = arguments.clips.is_empty().then_some(if arguments.common.quick { films.quick() } else { films });
    let usual = Cell::ALL.into_iter().filter(|cell| *cell != Cell::Auto);
    let mut cells = if arguments.cells.is_empty() { usual.collect() } else { arguments.cells.clone() };
    cells.sort();
    cells.dedup();
    let material_of_truth = arguments.material.is_none() && settings.config.material == Config::default().material;
    let clips = arguments.clips.iter().map(|path| path.canonicalize().unwrap_or_else(|_| path.clone())).collect();
    let AblationArguments { published, off, .. } = *arguments;
    let coarse = arguments.coarse;
    let mut plan = Plan { clips, cells, material_of_truth, published, off, films, coarse, settings };
    // reject unusable clips before anything is written
    for path in &plan.clips {
        let truth = Truth::beside(path);
        if off.is_some() && truth.is_none() {
            return Err(Error::new(ErrorKind::Input, "nobody wrote down what the clip is made of")
                .at(path.display())
                .wanted("truth.json in its folder, or the scene.toml of the simulation that filmed it beside it")
                .fix("write one like that of examples/clips/bird, or use `gradreel reconstruct`"));
        }
        open(path, &plan.settings_of(truth.as_ref()))?;
    }
    let folder = match &arguments.common.out {
        Some(folder) => RunFolder::create(folder)?,
        None => RunFolder::create_free(Path::new("runs"), "ablation")?,
    };
    if let Some(films) = films {
        plan.clips = films.places(&folder);
    }
    let text = toml::to_string_pretty(&plan).map_err(unwritable)?;
    folder.write(PLAN, text.as_bytes())?;
    Ok((plan, folder))
}

pub(super) fn go_on(arguments: &AblationArguments) -> Result<(Plan, RunFolder)> {
    let folder = RunFolder::resume(arguments.common.out.as_deref().unwrap_or(Path::new(".")))?;
    let fix = "give the folder of an interrupted ablation to --out, or begin one without --resume";
    folder.goes_on(PLAN, "there is no ablation to go on with", fix)?;
    let text = folder.read_text(PLAN)?;
    let mut plan: Plan = toml::from_str(&text).map_err(|e| damaged(&folder, PLAN, &e))?;
    // another table of the same clips: films and cells that both have are there already
    if let Some(published) = arguments.published {
        (plan.published, plan.cells) = (Some(published), arguments.cells.clone());
        if plan.cells.iter().any(|cell| cell.is_published()) {
            plan.settings.config.published.get_or_insert_default();
        }
    }
    plan.settings.config.check().map_err(|e| e.at(folder.path(PLAN).display()))?;
    Ok((plan, folder))
}

impl Plan {
    /// The table, followed by the published one if there is one.
    fn table(&self, results: &[ClipResults]) -> String {
        markdown(results) + self.published.map_or("", Published::markdown)
    }

    /// The settings for a clip with this truth.
    pub fn settings_of(&self, truth: Option<&Truth>) -> AblationSettings {
        let mut settings = self.settings.clone();
        if let (true, Some(truth)) = (self.material_of_truth, truth) {
            let law = truth.law();
            settings.config.material.name.clone_from(&truth.family);
            if let (Some(_), Some(law)) = (&truth.law, &law) {
                settings.config = settings.config.with_law(law.clone());
            }
            if let (Some(factor), Some(law)) = (self.off, law) {
                let held = settings.config.held(&law).unwrap_or_default();
                settings.config.material.start = truth.off(factor, &held);
            }
        }
        settings
    }
}

/// A table without its title and with headings one level deeper, for use in a section.
fn below(table: &str) -> String {
    let down = |line: &str| if line.starts_with('#') { format!("#{line}\n") } else { format!("{line}\n") };
    table.lines().filter(|line| !line.starts_with("# ")).map(down).collect()
}

/// Default settings on a coarse grid.
fn coarse() -> AblationSettings {
    let mut settings = AblationSettings::default();
    settings.config.geometry.dx = 0.03;
    settings
}

/// Settings of the published chain on a coarse grid, with fewer frames.
fn coarse_chain() -> AblationSettings {
    let mut settings = AblationSettings::default();
    let Config { clip, geometry, published, .. } = &mut settings.config;
    (clip.frames, geometry.dx, geometry.fit.iterations) = (12, 0.04, 40);
    let chain = published.get_or_insert_default();
    (chain.field, chain.rays, chain.nodes) = (600, 768, 30_000);
    (chain.velocity, chain.starts, chain.material) = (8, 4, 14);
    settings
}

/// Settings of a minimal budget.
pub(super) fn quick() -> AblationSettings {
    let mut settings = AblationSettings::default();
    let Config { geometry, estimate, .. } = &mut settings.config;
    (geometry.dx, geometry.fit.iterations, geometry.fit.in_motion) = (0.08, 6, 2);
    (estimate.velocity, estimate.points, estimate.survivors) = (2, 1, 1);
    (estimate.steps, estimate.rounds) = (1, 0);
    settings.config.temporal.iterations = 12;
    settings
}

pub(super) fn open(path: &Path, settings: &AblationSettings) -> Result<Clip> {
    let clip = crate::cli::reconstruct::open(path, &settings.config, true)?;
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

/// A unique label: the clip's name, or its folder's if the clip is called `clip`.
pub(super) fn label<'a>(path: &Path, before: impl Iterator<Item = &'a PathBuf>) -> String {
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

pub(super) fn damaged(folder: &RunFolder, name: &str, found: &dyn std::fmt::Display) -> Error {
    Error::new(ErrorKind::Input, "a file of the ablation is damaged")
        .at(folder.path(name).display())
        .found(found)
        .fix("remove the file of a cell to run it again, or begin again with another --out")
}

pub(super) fn unwritable(error: impl std::fmt::Display) -> Error {
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
