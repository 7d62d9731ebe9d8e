//! A result with its name, unit and source, and the file of all results of a run.

use std::collections::BTreeMap;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

/// Valid values of [`Quantity::source`].
const SOURCES: [&str; 3] = ["fitted", "assumed", "given"];

/// Units shown with SI prefixes: kPa is easier to read than 10³ Pa, but mm/s no easier than m/s.
const UNITS_WITH_PREFIX: [&str; 9] = ["Pa", "Pa s", "Pa·s", "N", "J", "W", "Hz", "m", "s"];

/// Prefixes for 10⁻⁹, 10⁻⁶, … 10⁹.
const PREFIXES: [&str; 7] = ["n", "µ", "m", "", "k", "M", "G"];

/// One number of a result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Quantity {
    /// Identifier, such as `young`.
    pub name: String,
    /// Display name, such as `Young's modulus`.
    pub label: String,
    /// Symbol in formulas, such as `E`.
    pub symbol: String,
    /// SI unit without prefix, such as `Pa`; empty or `-` for a pure number.
    pub unit: String,
    /// The number, in `unit`.
    pub value: f64,
    /// Starting value of the fit, in `unit`.
    pub start: Option<f64>,
    /// `fitted`, `assumed` or `given`.
    pub source: String,
    /// 90 % interval in `unit`, if known.
    pub interval_90: Option<[f64; 2]>,
    /// Whether the video constrains the value clearly beyond the prior, if known.
    pub determined: Option<bool>,
}

impl Quantity {
    /// The value rounded to three significant digits with its unit, with a prefix where customary: `301 kPa`,
    /// `0.298`, `-0.402 m/s`. Full precision is in `parameters.json`.
    pub fn readable(&self) -> String {
        self.readable_value(self.value)
    }

    /// The value as shown in results: as [`Quantity::readable`], or `–` if the video does not constrain it, in
    /// which case only the interval is meaningful.
    pub fn shown(&self) -> String {
        if self.determined == Some(false) { "–".to_owned() } else { self.readable() }
    }

    /// The interval in the same form, `295 kPa to 308 kPa`; `None` if unknown.
    pub fn readable_interval(&self) -> Option<String> {
        let [low, high] = self.interval_90?.map(|end| self.readable_value(end));
        Some(format!("{low} to {high}"))
    }

    fn readable_value(&self, value: f64) -> String {
        readable(value, &self.unit)
    }
}

/// A number for messages: full precision, in exponent notation where there would be many zeros.
pub fn compact(value: f64) -> String {
    match value.abs() {
        size if size == 0.0 || !size.is_finite() || (1e-4..1e7).contains(&size) => format!("{value}"),
        _ => format!("{value:e}"),
    }
}

/// A number with three significant digits and its SI unit (`-` for none), with a prefix where customary.
pub fn readable(value: f64, unit: &str) -> String {
    let unit = if unit == "-" { "" } else { unit };
    let (number, prefix) = if UNITS_WITH_PREFIX.contains(&unit) {
        let (digits, exponent) = three_digits(value);
        // zero has no magnitude to choose a prefix by
        let thousands = if value == 0.0 { 0 } else { exponent.div_euclid(3).clamp(-3, 3) };
        let scaled = digits * 10f64.powi(exponent - 3 * thousands);
        (plain(scaled), PREFIXES[(thousands + 3) as usize])
    } else {
        (plain(value), "")
    };
    format!("{number} {prefix}{unit}").trim_end().to_string()
}

/// `value = digits · 10^exponent` with `1 ≤ |digits| < 10`, rounded to three digits; zero, NaN and ∞ are unchanged.
fn three_digits(value: f64) -> (f64, i32) {
    let text = format!("{value:.2e}");
    let split = text.split_once('e').and_then(|(digits, e)| Some((digits.parse().ok()?, e.parse().ok()?)));
    split.unwrap_or((value, 0))
}

/// Three significant digits, in plain notation where that is short.
fn plain(value: f64) -> String {
    let (digits, exponent) = three_digits(value);
    match exponent {
        _ if value == 0.0 => "0".into(),
        _ if !value.is_finite() => format!("{value}"),
        -3..=4 => format!("{:.*}", (2 - exponent).max(0) as usize, digits * 10f64.powi(exponent)),
        _ => format!("{digits:.2}e{exponent}"),
    }
}

/// Contents of `parameters.json`: the results of a run in the given order, with their units.
///
/// ```text
/// {"material": "neo_hookean",
///  "parameters": {"young": {"label", "symbol", "value", "unit", "readable", "start", "source",
///                                 "interval_90": [295e3, 308e3], "determined": true}, …},
///  "assumed": {"density": {…}, …},
///  "quality": {"psnr": 31.2, …}}
/// ```
///
/// `readable` is `–` if the video does not constrain the parameter (`determined` is `false`); `value` is then only
/// the final iterate of the search. `start` is `null` if nothing was fitted; `interval_90` and `determined` are
/// `null` if no interval is known. Values round-trip to the same `f64`.
///
/// # Errors
///
/// [`ErrorKind::NonFinite`] naming a number that is NaN or infinite; an error for a duplicate name or an unknown
/// source.
pub fn parameters_json(
    material: &str,
    quantities: &[Quantity],
    assumed: &[Quantity],
    quality: &BTreeMap<String, f64>,
) -> Result<Vec<u8>> {
    for (name, value) in quality {
        finite(&format!("quality.{name}"), *value)?;
    }
    let whole = json!({
        "material": material,
        "parameters": section("parameters", quantities)?,
        "assumed": section("assumed", assumed)?,
        "quality": quality,
        "isa": gradreel::isa(),
    });
    Ok(format!("{whole:#}\n").into_bytes())
}

fn section(section: &str, quantities: &[Quantity]) -> Result<Map<String, Value>> {
    let mut entries = Map::new();
    for quantity in quantities {
        let Quantity { name, label, symbol, unit, value, start, source, interval_90, determined } = quantity;
        let place = format!("{section}.{name}");
        finite(&place, *value)?;
        if let Some(start) = start {
            finite(&format!("{place}.start"), *start)?;
        }
        for end in interval_90.iter().flatten() {
            finite(&format!("{place}.interval_90"), *end)?;
        }
        if !SOURCES.contains(&source.as_str()) {
            return Err(Error::new(ErrorKind::Input, "a number of the result has no known source")
                .at(place)
                .found(format!("`{source}`"))
                .wanted("`fitted`, `assumed` or `given`"));
        }
        let readable = quantity.shown();
        let entry = json!({
            "label": label, "symbol": symbol, "value": value, "unit": unit,
            "readable": readable, "start": start, "source": source,
            "interval_90": interval_90, "determined": determined,
        });
        if entries.insert(name.clone(), entry).is_some() {
            return Err(Error::new(ErrorKind::Input, "two numbers of the result have one name").at(place));
        }
    }
    Ok(entries)
}

fn finite(place: &str, value: f64) -> Result<()> {
    if value.is_finite() {
        return Ok(());
    }
    Err(Error::new(ErrorKind::NonFinite, "a number of the result is not finite").at(place).found(value))
}
