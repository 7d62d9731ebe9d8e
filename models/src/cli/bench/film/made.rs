//! `gradreel bench films`: films that are made, against their truth.

use std::fmt::Write as _;
use std::path::Path;

use gradreel::{Error, ErrorKind, Key, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::look::{Looked, brief, holds, looked};
use super::{Arguments, json};
use crate::cli::output::{say, tell};
use crate::coverage::Split;
use crate::phone::{self, Degradation, Truth};
use crate::report::results_file::Section;
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;

/// File with what was asked for.
const PLAN: &str = "bench.json";

/// Frames by which the first hit may be off.
const FRAMES: i64 = 2;

/// What was asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Plan {
    scenes: u64,
    split: Split,
    degrade: Vec<Degradation>,
}

/// What `check` made of a film.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Row {
    film: String,
    /// `None` without any.
    degradation: Option<Degradation>,
    accepted: bool,
    reason: Option<String>,
    seconds: f64,
    truth: Truth,
    seen: Value,
}

/// Makes films and looks at them.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let (plan, folder) = if arguments.resume { go_on(arguments)? } else { begin(arguments)? };
    let progress = Progress::new(true);
    let mut rows = Vec::new();
    for number in 0..plan.scenes {
        for degradation in std::iter::once(None).chain(plan.degrade.iter().copied().map(Some)) {
            let film = format!("{number:03}-{}", degradation.map_or_else(|| "clean".to_owned(), Degradation::name));
            let place = format!("rows/{film}.json");
            let row = if folder.has(&place) {
                serde_json::from_str(&folder.read_text(&place)?).map_err(|e| damaged(&folder.path(&place), &e))?
            } else {
                interrupt::check().map_err(|error| {
                    error.fix(format!("go on with `gradreel bench films --out {} --resume`", folder.root().display()))
                })?;
                let row = look(&folder, &film, plan.split.scene(number), degradation, arguments.limit, &progress)?;
                folder.write(&place, &json(&row)?)?;
                row
            };
            if !arguments.quiet {
                tell!("{film}: {}", row.verdict());
            }
            rows.push(row);
        }
    }
    let table = table(&rows);
    let split = match plan.split {
        Split::Development => "development",
        Split::Report => "report",
    };
    let section = Section {
        name: format!("films-{split}"),
        title: "Films as phones make them".into(),
        split: format!("{split}, {} scenes", plan.scenes),
        body: table,
    };
    arguments.leave(&folder, &section, &json(&rows)?)?;
    say!("  films and pages: {}", folder.root().display());
    Ok(())
}

fn begin(arguments: &Arguments) -> Result<(Plan, RunFolder)> {
    let mut degrade = arguments.degrade.clone();
    if degrade.is_empty() {
        degrade = Degradation::ALL.to_vec();
    }
    degrade.sort();
    degrade.dedup();
    let plan = Plan { scenes: arguments.scenes, split: arguments.split, degrade };
    let folder = arguments.folder()?;
    folder.write(PLAN, &json(&plan)?)?;
    Ok((plan, folder))
}

fn go_on(arguments: &Arguments) -> Result<(Plan, RunFolder)> {
    let folder = RunFolder::resume(arguments.out.as_deref().unwrap_or(Path::new(".")))?;
    folder.goes_on(PLAN, "there are no films to go on with", "give the folder of an interrupted bench to --out")?;
    let plan = serde_json::from_str(&folder.read_text(PLAN)?).map_err(|e| damaged(&folder.path(PLAN), &e))?;
    Ok((plan, folder))
}

fn damaged(path: &Path, error: &serde_json::Error) -> Error {
    Error::new(ErrorKind::Input, "a file of the bench is damaged")
        .at(path.display())
        .found(error)
        .fix("remove it, or begin again in another folder")
}

/// Makes a film and looks at it.
fn look(
    folder: &RunFolder,
    film: &str,
    key: Key,
    degradation: Option<Degradation>,
    limit: u64,
    progress: &Progress,
) -> Result<Row> {
    let path = folder.path(&format!("films/{film}.mp4"));
    let scene = phone::scenes::scene(key);
    let truth = phone::film(&scene, Path::new("."), degradation.as_slice(), key.fold(1), &path, progress)
        .map_err(|error| error.within(film))?;
    let Looked { accepted, reason, seconds, seen, .. } = looked(&path, &folder.path(&format!("pages/{film}")), limit)?;
    Ok(Row { film: film.to_owned(), degradation, accepted, reason, seconds, truth, seen })
}

impl Row {
    /// Diameter found over the true one.
    fn ratio(&self) -> Option<f64> {
        Some(self.seen["diameter_m"].as_f64()? / self.truth.diameter_m).filter(|_| self.accepted)
    }

    fn holds(&self) -> Option<bool> {
        holds(&self.seen, self.truth.diameter_m).filter(|_| self.accepted)
    }

    /// Frames by which the first contact is late.
    fn late(&self) -> Option<i64> {
        let first = self.seen["phases"].as_array()?.iter().find(|phase| phase["kind"] == "contact")?;
        let wanted = self.truth.hits.first()?.frame;
        Some(first["first_frame"].as_i64()? - i64::try_from(wanted).ok()?)
    }

    fn verdict(&self) -> String {
        let Some(reason) = &self.reason else {
            let ratio = self.ratio().map_or("–".into(), |ratio| format!("{ratio:.2}"));
            let held = if self.holds() == Some(true) { "held" } else { "not held" };
            let late = self.late().map_or("no hit".into(), |late| format!("hit {late:+}"));
            return format!("diameter {ratio} of the true one ({held}), {late}, {:.1} s", self.seconds);
        };
        format!("refused: {}", brief(reason))
    }
}

fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| films | n | accepted | median factor of the diameter | in 90 % | wider than a factor of 2 | first hit within 2 | seconds |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    let mut line = |name: &str, rows: &[&Row]| {
        let accepted = rows.iter().filter(|row| row.accepted).count();
        let held = rows.iter().filter_map(|row| row.holds()).filter(|holds| *holds).count();
        let wide = |row: &&&Row| {
            let ends = &row.seen["interval_90"]["diameter_m"];
            ends[0].as_f64().zip(ends[1].as_f64()).is_some_and(|(low, high)| high > 2.0 * low)
        };
        let wide = rows.iter().filter(wide).count();
        let hits = rows.iter().filter(|row| row.late().is_some_and(|late| late.abs() <= FRAMES)).count();
        let factor = median(rows.iter().filter_map(|row| row.ratio()).map(|ratio| ratio.ln().abs()));
        let factor = factor.map_or("–".into(), |log| format!("{:.3}", log.exp()));
        let seconds = median(rows.iter().map(|row| row.seconds)).unwrap_or(0.0);
        writeln!(text, "| {name} | {} | {accepted} | {factor} | {held} | {wide} | {hits} | {seconds:.1} |", rows.len())
            .expect("a string accepts every write");
    };
    for kind in std::iter::once(None).chain(Degradation::ALL.map(Some)) {
        let own: Vec<&Row> = rows.iter().filter(|row| row.degradation == kind).collect();
        if !own.is_empty() {
            line(&kind.map_or_else(|| "clean".to_owned(), |kind| kind.name().replace('_', " ")), &own);
        }
    }
    let decided = |row: &&Row| !row.degradation.is_some_and(Degradation::may_ask);
    line("all that may not ask", &rows.iter().filter(decided).collect::<Vec<_>>());
    text
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    fn row(found: f64, first_contact: i64) -> Row {
        let hit = phone::Contact { frame: 12, begin_s: 0.4, end_s: None, restitution: None };
        let truth = Truth {
            title: String::new(),
            degradations: vec![],
            fps: 30.0,
            stored_fps: 30.0,
            frames: 30,
            times_s: vec![],
            first_free: 0,
            hits: vec![hit],
            diameter_m: 0.1,
            distance_m: 1.0,
            pitch_deg: 10.0,
            velocity_m_per_s: [0.0; 3],
            law: "neo_hookean".into(),
            parameters: BTreeMap::new(),
            ground_friction: None,
            exposure_s: 0.0,
            readout_s: 0.0,
        };
        let seen = serde_json::json!({
            "diameter_m": found,
            "interval_90": { "diameter_m": [0.9 * found, 1.1 * found] },
            "phases": [{ "kind": "flight", "first_frame": 0 }, { "kind": "contact", "first_frame": first_contact }],
        });
        Row { film: "a".into(), degradation: None, accepted: true, reason: None, seconds: 1.0, truth, seen }
    }

    #[test]
    fn films_are_judged_by_their_truth() {
        let [right, wrong] = [row(0.105, 13), row(0.2, 8)];
        assert_eq!((right.holds(), right.late()), (Some(true), Some(1)));
        assert_eq!((wrong.holds(), wrong.late()), (Some(false), Some(-4)));
        assert!((wrong.ratio().unwrap() - 2.0).abs() < 1e-12);
        let refused = Row { accepted: false, reason: Some("no".into()), ..right.clone() };
        assert_eq!((refused.ratio(), refused.holds()), (None, None));
        let text = table(&[right, wrong, refused]);
        assert!(text.contains("| clean | 3 | 2 | 2.000 | 1 | 0 | 2 | 1.0 |"), "{text}");
    }
}
