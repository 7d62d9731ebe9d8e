//! `gradreel bench coverage`: many small random clips against their truth.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::cli::output::say;
use crate::coverage::{Line, Split, Summary, fit, ranks};
use crate::identify::Config;
use crate::physics::{Law, law_file, name_of};
use crate::report::results_file::{self, Measured, Section};
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;

/// Arguments of `gradreel bench coverage`.
#[derive(clap::Args)]
#[command(after_long_help = HELP)]
pub(super) struct Arguments {
    /// Clips, a fifth of each family of materials unless there is a law
    #[arg(long, value_name = "COUNT", default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    #[arg(conflicts_with = "resume")]
    clips: u64,
    /// Cameras that film each clip
    #[arg(long, value_name = "COUNT", default_value_t = 7, value_parser = clap::value_parser!(u64).range(1..=16))]
    #[arg(conflicts_with = "resume")]
    cameras: u64,
    /// Which clips: develop on the one split, report the other
    #[arg(long, value_name = "SPLIT", default_value = "development", conflicts_with = "resume")]
    split: Split,
    /// Clips that are fitted side by side [default: one a processor core]
    #[arg(long, value_name = "COUNT")]
    threads: Option<usize>,
    /// Folder for the results [default: runs/coverage, runs/coverage-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the bench in --out; clips that are fitted are not fitted again
    #[arg(long, requires = "out")]
    resume: bool,
    /// A law of your own in WGSL (see docs/guide/laws.md): all clips are of it, with parameters from its priors
    #[arg(long, value_name = "FILE.wgsl", conflicts_with = "resume")]
    law: Option<PathBuf>,
    /// Settings of the fits, in place of the defaults
    #[arg(long, value_name = "FILE", conflicts_with_all = ["resume", "quick"])]
    config: Option<PathBuf>,
    /// A tiny budget, to see that everything runs; the numbers then mean nothing
    #[arg(long, conflicts_with_all = ["resume", "markdown"])]
    quick: bool,
    /// Keep the pictures and the run of every clip
    #[arg(long)]
    keep: bool,
    /// Write the figures into this JSON file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the table with the machine, the commit and the date into its section of this Markdown file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

const HELP: &str = "\
Each clip is a procedural body in a random attitude, of a material drawn from the priors of its law, that falls and lands. It is
simulated on another grid and with another step than those of the fit, drawn by rays against a surface (64 to 96 pixels), and
fitted with the default settings. The table says how far each unknown is off, how often its intervals hold the truth, and how much
the clip told (mean log density of the truth, less the prior's).

With one camera, half of the clips are films of which the fit does not know where the camera was; with several, all are
calibrated. In half of the clips there is a background with a floor and a shadow.

The folder holds clips.jsonl (a line a clip, as it ends), coverage.json, coverage.md and ranks.svg (rank histograms).

Examples:
  gradreel bench coverage --clips 20                              twenty clips of the development split
  gradreel bench coverage --cameras 1 --split report --clips 200  what is reported of one camera
  gradreel bench coverage --law foam.wgsl --clips 40              clips of a law of your own
  gradreel bench coverage --out runs/coverage --resume            go on after Ctrl-C";

/// What was asked for, as the folder keeps it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Plan {
    split: Split,
    clips: u64,
    cameras: u64,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    quick: bool,
    /// The file in this folder with the law of all clips.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    law: Option<String>,
    /// The file of --config.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    settings: Option<String>,
}

const PLAN: &str = "coverage.toml";
const LINES: &str = "clips.jsonl";

/// The figures with where they were measured.
#[derive(Serialize)]
struct Report<'a> {
    commit: String,
    machine: String,
    isa: String,
    date: String,
    split: Split,
    cameras: u64,
    threads: usize,
    #[serde(flatten)]
    summary: &'a Summary,
    peak_mib: Option<f64>,
}

/// Fits all clips that are not fitted yet, and writes the figures of all.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    interrupt::install()?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.unwrap_or(cores);
    if !(1..=256).contains(&threads) {
        return Err(Error::new(ErrorKind::Input, "so many threads cannot be used")
            .at("--threads")
            .found(threads)
            .wanted("1 to 256")
            .fix("leave it out for one a processor core"));
    }
    let (plan, folder, lines) =
        if arguments.resume { go_on(arguments.out.as_deref().unwrap_or(Path::new(".")))? } else { begin(arguments)? };
    let waiting: Vec<u64> = (0..plan.clips).filter(|n| lines.iter().all(|line| line.clip != *n)).collect();
    let law = plan.law.as_ref().map(|name| Law::read(folder.path(name))).transpose()?;
    let settings = match &plan.settings {
        _ if plan.quick => super::job::quick().config,
        None => Config::default(),
        Some(text) => Config::parse(text)?,
    };
    let bar = Progress::new(arguments.quiet).stage("clips", plan.clips);
    let (next, done) = (AtomicU64::new(0), Mutex::new((appended(&folder)?, lines)));
    let work = || -> Result<()> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads((cores / threads).max(1)).build();
        let pool = pool.map_err(|e| Error::new(ErrorKind::Io, "no threads can be started").found(e))?;
        while let Some(&number) = waiting.get(next.fetch_add(1, Ordering::Relaxed) as usize) {
            interrupt::check()?;
            let place = folder.path(&format!("clips/{number:05}"));
            clear(&place)?;
            let line =
                pool.install(|| fit(plan.split, number, plan.cameras as usize, law.as_ref(), &settings, &place))?;
            if !arguments.keep {
                clear(&place)?;
            }
            let text = serde_json::to_string(&line).map_err(unwritable)?;
            let mut done = done.lock().unwrap_or_else(|failed| failed.into_inner());
            let (file, lines) = &mut *done;
            writeln!(file, "{text}").map_err(|e| Error::io(folder.path(LINES), "write a line", &e))?;
            bar.set(lines.len() as u64 + 1, &said(&line));
            lines.push(line);
        }
        Ok(())
    };
    let outcomes: Vec<Result<()>> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        let ended = |e| std::panic::resume_unwind(e);
        workers.into_iter().map(|worker| worker.join().unwrap_or_else(ended)).collect()
    });
    let (_, mut lines) = done.into_inner().unwrap_or_else(|failed| failed.into_inner());
    lines.sort_by_key(|line| line.clip);
    publish(arguments, &plan, &folder, &lines, threads)?;
    bar.finish(&folder.path("coverage.md").display().to_string());
    let go_on = format!("go on with `gradreel bench coverage --out {} --resume`", folder.root().display());
    outcomes.into_iter().collect::<Result<()>>().map_err(|error| match error.kind() {
        ErrorKind::Interrupted => error.fix(go_on),
        _ => error,
    })
}

/// What is said of a clip while others go on.
fn said(line: &Line) -> String {
    match &line.refused {
        Some(_) => format!("clip {} ({}): refused", line.clip, line.family),
        None => format!("clip {} ({}): {:.1} s", line.clip, line.family, line.seconds),
    }
}

fn begin(arguments: &Arguments) -> Result<(Plan, RunFolder, Vec<Line>)> {
    if let Some(folder) = &arguments.out {
        crate::cli::place::check(folder, None)?;
    }
    let settings = match &arguments.config {
        Some(file) => {
            let text = fs::read_to_string(file).map_err(|e| Error::io(file, "read the settings", &e))?;
            Config::parse(&text).map_err(|e| e.at(file.display()))?;
            Some(text)
        }
        None => None,
    };
    let law = arguments.law.as_ref().map(Law::read).transpose()?;
    let folder = match &arguments.out {
        Some(folder) => RunFolder::create(folder)?,
        None => RunFolder::create_free(Path::new("runs"), "coverage")?,
    };
    let kept = law.as_ref().map(|law| law_file(law.name()));
    if let (Some(name), Some(text)) = (&kept, law.as_ref().and_then(Law::text)) {
        folder.write(name, text.as_bytes())?;
    }
    let Arguments { split, clips, cameras, quick, .. } = *arguments;
    let plan = Plan { split, clips, cameras, quick, law: kept, settings };
    folder.write(PLAN, toml::to_string_pretty(&plan).map_err(unwritable)?.as_bytes())?;
    Ok((plan, folder, Vec::new()))
}

fn go_on(folder: &Path) -> Result<(Plan, RunFolder, Vec<Line>)> {
    let folder = RunFolder::resume(folder)?;
    let fix = "give the folder of an interrupted bench to --out, or begin one without --resume";
    folder.goes_on(PLAN, "there is no bench of coverage to go on with", fix)?;
    let damaged = |name: &str, found: &dyn std::fmt::Display| {
        Error::new(ErrorKind::Input, "a file of the bench is damaged")
            .at(folder.path(name).display())
            .found(found)
            .fix("begin again with another --out")
    };
    let plan: Plan = toml::from_str(&folder.read_text(PLAN)?).map_err(|e| damaged(PLAN, &e))?;
    let text = if folder.has(LINES) { folder.read_text(LINES)? } else { String::new() };
    // a line that was cut off by the end of the run is made again
    let whole = text.rfind('\n').map_or(0, |end| end + 1);
    let lines = text[..whole].lines().map(|line| serde_json::from_str(line).map_err(|e| damaged(LINES, &e)));
    let lines = lines.collect::<Result<Vec<Line>>>()?;
    if whole < text.len() {
        folder.write(LINES, &text.as_bytes()[..whole])?;
    }
    Ok((plan, folder, lines))
}

/// The lines of a folder whose clips are of the families.
pub(super) fn lines(folder: &Path) -> Result<Vec<Line>> {
    let (plan, _, lines) = go_on(folder)?;
    match plan.law {
        None => Ok(lines),
        Some(law) => Err(Error::new(ErrorKind::Input, "an error budget is of the five families")
            .at(folder.display())
            .found(format!("clips of {law}"))
            .fix("give folders of `gradreel bench coverage` without --law")),
    }
}

/// The file of lines, to write after what is there.
fn appended(folder: &RunFolder) -> Result<File> {
    let path = folder.path(LINES);
    File::options().create(true).append(true).open(&path).map_err(|e| Error::io(&path, "write the lines", &e))
}

fn clear(place: &Path) -> Result<()> {
    match fs::remove_dir_all(place) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(place, "remove a clip", &e)),
        _ => Ok(()),
    }
}

fn publish(arguments: &Arguments, plan: &Plan, folder: &RunFolder, lines: &[Line], threads: usize) -> Result<()> {
    let summary = Summary::of(lines);
    let measured = Measured::here("gradreel");
    let report = Report {
        commit: measured.commit.clone(),
        machine: measured.machine.clone(),
        isa: measured.instruction_set.clone(),
        date: measured.date.clone(),
        split: plan.split,
        cameras: plan.cameras,
        threads,
        summary: &summary,
        peak_mib: peak(),
    };
    let json = serde_json::to_vec_pretty(&report).map_err(unwritable)?;
    folder.write("coverage.json", &json)?;
    folder.write("ranks.svg", ranks(lines).as_bytes())?;
    folder.write("coverage.md", summary.markdown().as_bytes())?;
    if let Some(file) = &arguments.json {
        fs::write(file, &json)
            .map_err(|e| Error::io(file, "write the figures", &e).fix("name another file with --json"))?;
    }
    if let Some(file) = &arguments.markdown {
        let cameras = if plan.cameras == 1 { "one camera".to_owned() } else { format!("{} cameras", plan.cameras) };
        let split = match plan.split {
            Split::Development => "development",
            Split::Report => "report",
        };
        let (name, title, told) = match &plan.settings {
            None => ("", "", String::new()),
            Some(settings) => {
                let told = format!("\n\nSettings other than the defaults:\n\n```toml\n{}\n```", settings.trim());
                ("-settings", ", other settings", told)
            }
        };
        let own = plan.law.as_ref().map(|file| name_of(file));
        let [of, by] = own.map_or([String::new(), String::new()], |law| [format!("-{law}"), format!(" of {law}")]);
        let section = Section {
            name: format!("coverage-{}-{split}{of}{name}", plan.cameras),
            title: format!("Coverage, {cameras}, {split} clips{by}{title}"),
            split: format!("{split}: {} random clips", plan.clips),
            body: format!("{threads} side by side.{told}\n\n{}", summary.markdown()),
        };
        results_file::replace(file, &section, &measured)?;
    }
    say!("{}", summary.markdown());
    Ok(())
}

/// The most memory that the process has held \[MiB\], where the system tells.
fn peak() -> Option<f64> {
    let told = fs::read_to_string("/proc/self/status").ok()?;
    let line = told.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse().ok().map(|kib: f64| kib / 1024.0)
}

fn unwritable(error: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Io, "the bench cannot be written").found(error)
}
