//! `gradreel bench films`: what `check` makes of films from one camera.

mod look;
mod made;
mod real;

use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde::Serialize;

use crate::cli::output::say;
use crate::coverage::Split;
use crate::phone::Degradation;
use crate::report::results_file::{Measured, Section, replace};
use crate::runtime::interrupt;
use crate::runtime::run_folder::RunFolder;

/// Arguments of `gradreel bench films`.
#[derive(clap::Args, Clone)]
#[command(after_long_help = AFTER)]
pub(super) struct Arguments {
    /// Folder with films that people made [default: films that are made here]
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["scenes", "split", "degrade", "resume"])]
    real: Option<PathBuf>,
    /// Scenes, each of which is filmed once without and once with each degradation
    #[arg(long, value_name = "COUNT", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    #[arg(conflicts_with = "resume")]
    scenes: u64,
    /// Which scenes: develop on the one split, report the other
    #[arg(long, value_name = "SPLIT", default_value = "development", conflicts_with = "resume")]
    split: Split,
    /// Only these degradations
    #[arg(long, value_name = "NAMES", value_delimiter = ',', conflicts_with = "resume")]
    degrade: Vec<Degradation>,
    /// Folder for films and pages [default: runs/films, runs/films-2, …]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Go on with the films in --out
    #[arg(long, requires = "out")]
    resume: bool,
    /// Write the table with the machine, the commit and the date into its section of this Markdown file
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Write everything as JSON into this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Give a film up after so many seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 300, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    limit: u64,
    /// No progress on stderr
    #[arg(long, short)]
    quiet: bool,
}

const AFTER: &str = "\
Each film is looked at by `gradreel check` in a process of its own.

By itself it makes the films: something elastic falls onto a floor, filmed by one camera, once as in a studio and once with each of
thirteen things that films of phones have (see `gradreel simulate --help`, --degrade). The table says for each how many films are
accepted, how far the diameter is off and how often its interval of 90 % holds it, and how often the first hit is found within two
frames. With slow motion that the file does not tell and with a second object, a film may be refused with the option that decides.

With --real, the table says of each film whether it is accepted or refused and why, which frames are used, how large the object is and
the interval of 90 %, the phases, the seconds, and the memory at its peak (of gradreel alone, without ffmpeg). What is known of the
films may stand in films.json in the folder, by the names of their files:
  {\"ball.mp4\": {\"diameter_m\": 0.04, \"first_hit\": 203}}

Examples:
  gradreel bench films --scenes 3 --degrade shake,blur
  gradreel bench films --split report --markdown results.md
  gradreel bench films --out runs/films --resume               go on after Ctrl-C
  gradreel bench films --real my/films --json films.json";

/// Looks at films.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    interrupt::install()?;
    match &arguments.real {
        Some(folder) => real::run(arguments, folder),
        None => made::run(arguments),
    }
}

impl Arguments {
    /// A new folder for films and pages.
    fn folder(&self) -> Result<RunFolder> {
        match &self.out {
            Some(folder) => RunFolder::create(folder),
            None => RunFolder::create_free(Path::new("runs"), "films"),
        }
    }

    /// Leaves a table and what was seen where they are wanted, and prints the table.
    fn leave(&self, folder: &RunFolder, section: &Section, json: &[u8]) -> Result<()> {
        folder.write("films.md", section.body.as_bytes())?;
        if let Some(file) = &self.json {
            std::fs::write(file, json)
                .map_err(|e| Error::io(file, "write the results", &e).fix("name another file with --json"))?;
        }
        if let Some(file) = &self.markdown {
            replace(file, section, &Measured::here("gradreel"))?;
        }
        say!("{}", section.body);
        Ok(())
    }
}

/// What was seen, as JSON.
fn json(value: &impl Serialize) -> Result<Vec<u8>> {
    serde_json::to_vec_pretty(value)
        .map_err(|e| Error::new(ErrorKind::Io, "cannot write what was seen as JSON").found(e))
}
