//! `gradreel bench films --real`: what `check` makes of each film of a folder.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::look::{Looked, brief, holds, looked};
use super::{Arguments, json};
use crate::cli::output::{say, tell};
use crate::folder::{entries, name};
use crate::report::quantity::readable;
use crate::report::results_file::Section;
use crate::runtime::interrupt;
use crate::runtime::run_folder::RunFolder;
use crate::text;
use crate::video::Film;

/// File with what is known.
const KNOWN: &str = "films.json";

/// Number of phases in the table.
const MOST_PHASES: usize = 5;

/// What is known of a film.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Known {
    /// Diameter of the object \[m\].
    diameter_m: Option<f64>,
    /// Number of the first frame of the first contact.
    first_hit: Option<i64>,
}

/// What `check` made of a film.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Row {
    film: String,
    accepted: bool,
    /// Exit status; none if it was given up.
    exit_code: Option<i32>,
    /// Why it was refused.
    reason: Option<String>,
    seconds: f64,
    known: Known,
    /// Whether the known diameter is in the interval.
    holds: Option<bool>,
    /// What `check --json` said.
    seen: Value,
}

/// Looks at each film.
pub(super) fn run(arguments: &Arguments, real: &Path) -> Result<()> {
    let films: Vec<PathBuf> = entries(real, "the films")?.into_iter().filter(|path| Film::is_at(path)).collect();
    if films.is_empty() {
        return Err(Error::new(ErrorKind::Input, "there is no film in the folder")
            .at(real.display())
            .wanted("GIFs, video files, or folders of numbered pictures")
            .fix("name another folder with --real"));
    }
    let known = known(real)?;
    let folder = arguments.folder()?;
    let mut rows = Vec::new();
    for film in &films {
        interrupt::check().map_err(|error| error.fix("start again; films take seconds each"))?;
        let row = look(film, &folder, known.get(&name(film)).cloned().unwrap_or_default(), arguments.limit)?;
        if !arguments.quiet {
            tell!("{}: {}, {:.1} s", row.film, row.verdict(), row.seconds);
        }
        rows.push(row);
    }
    let table = table(&rows);
    let json = json(&rows)?;
    folder.write("films.json", &json)?;
    let section = Section {
        name: "films".into(),
        title: "Films of one camera".into(),
        split: format!("report, {} films that people made", rows.len()),
        body: table,
    };
    arguments.leave(&folder, &section, &json)?;
    say!("  pages: {}", folder.root().display());
    Ok(())
}

/// What is known of the films.
fn known(folder: &Path) -> Result<BTreeMap<String, Known>> {
    let file = folder.join(KNOWN);
    if !file.exists() {
        return Ok(BTreeMap::new());
    }
    let text = text::read(&file, "what is known of the films", "correct it or remove it", text::SETTINGS)?;
    serde_json::from_str(&text).map_err(|e| {
        Error::new(ErrorKind::Input, "cannot read what is known of the films")
            .at(file.display())
            .found(e)
            .wanted("{\"ball.mp4\": {\"diameter_m\": 0.04, \"first_hit\": 203}}")
            .fix("correct it or remove it")
    })
}

/// Looks at one film in a process of its own.
fn look(film: &Path, folder: &RunFolder, known: Known, limit: u64) -> Result<Row> {
    let Looked { accepted, exit_code, reason, seconds, seen } = looked(film, &folder.path(&name(film)), limit)?;
    let holds = known.diameter_m.and_then(|diameter| holds(&seen, diameter));
    Ok(Row { film: name(film), accepted, exit_code, reason, seconds, holds, known, seen })
}

impl Row {
    fn verdict(&self) -> String {
        match &self.reason {
            None => "accepted".into(),
            Some(reason) => format!("refused: {}", brief(reason)),
        }
    }

    /// The frames that are used.
    fn frames(&self) -> Option<String> {
        let (first, count) = (self.seen["first_frame"].as_i64()?, self.seen["frames"].as_i64()?);
        let all = self.seen["frames_of_film"].as_u64().map_or_else(String::new, |all| format!(" of {all}"));
        Some(format!("{count} from {first}{all}"))
    }

    fn diameter(&self) -> Option<String> {
        let value = self.seen["diameter_m"].as_f64()?;
        let ends = &self.seen["interval_90"]["diameter_m"];
        let interval = ends[0].as_f64().zip(ends[1].as_f64());
        let interval = interval.map(|(low, high)| format!(" ({} to {})", readable(low, "m"), readable(high, "m")));
        Some(format!("{}{}", readable(value, "m"), interval.unwrap_or_default()))
    }

    fn phases(&self) -> Option<String> {
        let phase = |phase: &Value| {
            Some(format!("{} {}–{}", phase["kind"].as_str()?, phase["first_frame"], phase["last_frame"]))
        };
        let all: Vec<String> = self.seen["phases"].as_array()?.iter().filter_map(phase).collect();
        let more = all.len().saturating_sub(MOST_PHASES);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        (!all.is_empty()).then(|| format!("{}{more}", all[..all.len().min(MOST_PHASES)].join(", ")))
    }

    fn truth(&self) -> Option<String> {
        let diameter = self.known.diameter_m.map(|diameter| {
            let holds = self.holds.map_or("", |holds| if holds { ", held" } else { ", not held" });
            format!("{}{holds}", readable(diameter, "m"))
        });
        let hit = self.known.first_hit.map(|frame| format!("hit {frame}"));
        let parts: Vec<String> = diameter.into_iter().chain(hit).collect();
        (!parts.is_empty()).then(|| parts.join("; "))
    }
}

fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| film | verdict | frames used | diameter (90 %) | known | phases | seconds | memory |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let or_none = |cell: Option<String>| cell.map_or_else(|| "–".to_owned(), |cell| cell.replace('|', "\\|"));
    for row in rows {
        let memory = row.seen["memory_mib"].as_f64().map(|mib| format!("{mib:.0} MiB"));
        let cells = [row.frames(), row.diameter(), row.truth(), row.phases()].map(or_none).join(" | ");
        let verdict = or_none(Some(row.verdict()));
        writeln!(
            text,
            "| {} | {verdict} | {cells} | {:.1} | {} |",
            or_none(Some(row.film.clone())),
            row.seconds,
            or_none(memory)
        )
        .expect("a string accepts every write");
    }
    let accepted = rows.iter().filter(|row| row.accepted).count();
    write!(text, "\n{accepted} of {} films are accepted.", rows.len()).expect("a string accepts every write");
    let judged: Vec<bool> = rows.iter().filter_map(|row| row.holds).collect();
    if !judged.is_empty() {
        let held = judged.iter().filter(|holds| **holds).count();
        write!(text, " {held} of {} known diameters are within their intervals.", judged.len())
            .expect("a string accepts every write");
    }
    text.push('\n');
    text
}
