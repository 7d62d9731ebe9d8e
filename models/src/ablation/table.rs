//! The table of all cells.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::summary::{held_by, summary};
use super::{Cell, CellResult, Truth};
use crate::identify::VELOCITY;
use crate::physics::{Map, Parameter};
use crate::report::quantity::Quantity;

/// The cells of one clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClipResults {
    /// Name of the clip.
    pub clip: String,
    /// The truth, if it is known.
    pub truth: Option<Truth>,
    /// The completed cells, by name.
    pub cells: BTreeMap<String, CellResult>,
}

/// Tables of all clips in Markdown, aligned for a terminal: estimates with their errors in brackets.
pub fn markdown(results: &[ClipResults]) -> String {
    let mut text = String::from("# Ablations\n");
    for clip in results {
        let truth = clip.truth.as_ref();
        let known = truth.map_or("its truth is not known".to_owned(), |truth| truth.family.replace('_', "-"));
        write!(text, "\n## {} ({known})\n", clip.clip).expect("a string accepts every write");
        let of = |wanted: bool| {
            let cells = Cell::ALL.into_iter().filter(move |cell| cell.reconstructs() == wanted);
            cells.filter_map(|cell| Some((cell, clip.cells.get(cell.name())?))).collect::<Vec<_>>()
        };
        let (reconstructions, fits) = (of(true), of(false));
        if !reconstructions.is_empty() {
            text.push_str(&aligned(&reconstructed(truth, &reconstructions)));
        }
        if !fits.is_empty() {
            text.push_str(&aligned(&encoded(&fits)));
        }
    }
    text.push_str(&summary(results));
    text.push_str(
        "\nIn brackets: the error, in decades for what is known to an order of magnitude only, as a share of the true speed for \
         the velocity; ! where the 90 % interval does not hold the truth.\nPSNR and IoU compare with all views as they were filmed.\n",
    );
    writeln!(text, "Instruction set: {}.", gradreel::isa()).expect("a string accepts every write");
    text
}

fn reconstructed(truth: Option<&Truth>, cells: &[(Cell, &CellResult)]) -> Vec<Vec<String>> {
    let law = truth.and_then(Truth::law);
    let every = || cells.iter().flat_map(|(_, result)| result.estimates.keys().cloned());
    let parameters: Vec<Parameter> = match &law {
        Some(law) => law.parameters().to_vec(),
        None => crate::physics::materials::all()
            .iter()
            .flat_map(|law| law.parameters().to_vec())
            .filter(|p| every().any(|name| name == p.name))
            .fold(Vec::new(), |mut kept, p| {
                if kept.iter().all(|other: &Parameter| other.name != p.name) {
                    kept.push(p);
                }
                kept
            }),
    };
    let mut head = vec![String::new()];
    head.extend(parameters.iter().map(|p| p.symbol.to_owned()));
    head.extend(["velocity", "PSNR", "IoU", "time"].map(str::to_owned));
    let mut rows = vec![head];
    if let Some(truth) = truth {
        let mut row = vec!["truth".to_owned()];
        row.extend(parameters.iter().map(|p| truth.parameters.get(p.name).map_or(String::new(), |v| readable(p, *v))));
        row.push(truth.velocity.map_or(String::new(), vector));
        rows.push(row);
    }
    for (cell, result) in cells {
        let family = if *cell == Cell::Auto { format!(": {}", result.family.replace('_', "-")) } else { String::new() };
        let mut row = vec![cell.label().to_owned() + &family];
        if let Some(why) = &result.failed {
            row.push(failure(why));
            rows.push(row);
            continue;
        }
        let held = truth.map_or(Vec::new(), |truth| held_by(truth, result));
        let missed = |name: &str| held.iter().any(|(other, holds)| other == name && !holds);
        for p in &parameters {
            let mark = if missed(p.name) { " !" } else { "" };
            let places = if p.map == Map::Log10 { 2 } else { 3 };
            let error = |e: &f64| format!(" ({e:+.places$}{mark})");
            let value = result.estimates.get(p.name).map_or(String::new(), |value| readable(p, *value));
            row.push(value + &result.errors.get(p.name).map_or(String::new(), error));
        }
        row.push(velocity(result, if VELOCITY.iter().any(|name| missed(name)) { " !" } else { "" }));
        row.push(result.quality.get("psnr_on_object_db").map_or(String::new(), |x| format!("{x:.1} dB")));
        row.push(result.quality.get("silhouette_iou").map_or(String::new(), |x| format!("{x:.3}")));
        row.push(format!("{:.0} s", result.seconds));
        rows.push(row);
    }
    rows
}

fn encoded(cells: &[(Cell, &CellResult)]) -> Vec<Vec<String>> {
    let mut rows = vec![["temporal field", "PSNR of a view held out", "velocity", "time"].map(str::to_owned).to_vec()];
    for (cell, result) in cells {
        let mut row = vec![cell.label().to_owned()];
        match &result.failed {
            Some(why) => row.push(failure(why)),
            None => {
                row.push(result.quality.get("psnr_held_out_db").map_or(String::new(), |x| format!("{x:.1} dB")));
                row.push(velocity(result, ""));
                row.push(format!("{:.0} s", result.seconds));
            }
        }
        rows.push(row);
    }
    rows
}

fn readable(parameter: &Parameter, value: f64) -> String {
    let quantity = Quantity {
        name: parameter.name.into(),
        label: String::new(),
        symbol: parameter.symbol.into(),
        unit: parameter.unit.into(),
        value,
        start: None,
        source: "fitted".into(),
        interval_90: None,
        determined: None,
    };
    quantity.readable()
}

fn velocity(result: &CellResult, mark: &str) -> String {
    let found = VELOCITY.map(|name| result.estimates.get(name).copied());
    let [Some(x), Some(y), Some(z)] = found else { return String::new() };
    let error = result.errors.get("velocity").map_or(String::new(), |e| format!(" ({:.1} %{mark})", 100.0 * e));
    vector([x, y, z]) + &error
}

fn vector([x, y, z]: [f64; 3]) -> String {
    format!("{x:.2}, {y:.2}, {z:.2} m/s")
}

/// A failed cell, formatted as in the published table, with the reason.
fn failure(why: &str) -> String {
    format!("fails: {}", why.lines().next().unwrap_or_default())
}

/// A table with aligned columns.
fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    // a long sentence in place of numbers must not widen its column
    let cell = |row: &[String], k: usize| row.get(k).map_or(String::new(), |text| text.replace('|', "/"));
    let width = |k: usize| {
        let lengths = rows.iter().filter(|row| row.len() > 2 || k == 0).map(|row| cell(row, k).chars().count());
        lengths.max().unwrap_or(0).max(3)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::from("\n");
    for (number, row) in rows.iter().enumerate() {
        let cells: Vec<String> =
            widths.iter().enumerate().map(|(k, w)| format!("{:<w$}", cell(row, k), w = *w)).collect();
        writeln!(text, "| {} |", cells.join(" | ")).expect("a string accepts every write");
        if number == 0 {
            let rules: Vec<String> = widths.iter().map(|w| "-".repeat(*w)).collect();
            writeln!(text, "| {} |", rules.join(" | ")).expect("a string accepts every write");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_as_it_is_printed() {
        let numbers = |list: &[(&str, f64)]| list.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        let truth = Truth {
            law: None,
            family: "elastic".into(),
            parameters: numbers(&[("young", 3e5), ("poisson", 0.3)]),
            velocity: Some([0.0, -1.0, 0.0]),
        };
        let mut good = CellResult {
            estimates: numbers(&[
                ("young", 3e6),
                ("poisson", 0.25),
                ("velocity_x", 0.0),
                ("velocity_y", -0.98),
                ("velocity_z", 0.0),
            ]),
            quality: numbers(&[("psnr_on_object_db", 21.26), ("silhouette_iou", 0.9)]),
            intervals: [("young", [1e6, 1e7]), ("poisson", [0.1, 0.4]), ("velocity_y", [-1.1, -0.9])]
                .map(|(name, ends)| (name.to_owned(), ends))
                .into(),
            seconds: 3.4,
            ..CellResult::default()
        };
        good.errors = truth.errors(&good.estimates);
        let bad = CellResult { failed: Some("it | broke\nat once".into()), ..CellResult::default() };
        let still = CellResult { quality: numbers(&[("psnr_held_out_db", 17.0)]), ..CellResult::default() };
        let cells = [("with_lva", good), ("without_lva", bad), ("still", still)];
        let cells = cells.into_iter().map(|(name, result)| (name.to_owned(), result)).collect();
        let text = markdown(&[ClipResults { clip: "bird".into(), truth: Some(truth), cells }]);
        for line in [
            "## bird (elastic)",
            "|                              | E               | ν              | velocity                   | PSNR    | IoU   | time |",
            "| imagined views, with L_va    | 3.00 MPa (+1.00 !) | 0.250 (-0.050) | 0.00, -0.98, 0.00 m/s (2.0 %) | 21.3 dB | 0.900 | 3 s  |",
            "fails: it / broke",
            "with L_va: the 90 % intervals of 2 of 3 numbers hold the truth, those of all numbers of a clip in 0 of 1 clips.",
            "17.0 dB",
        ] {
            let squeeze = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(squeeze(&text).contains(&squeeze(line)), "{line}\n{text}");
        }
    }
}
