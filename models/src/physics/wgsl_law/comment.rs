//! What the `///` comment of a member says: unit, map, prior and usual value.
//!
//! ```text
//! /// Young's modulus E [Pa], log10, 1e3 to 1e7, usually 1e5 +- 0.5
//! /// Poisson's ratio ν [-], between -0.45 and 0.45, 0 to 0.45, usually 0.3 +- 0.11
//! /// Shear modulus μ [Pa], log10, 1e2 to 1e6, usually 10 times yield_stress +- 0.5
//! /// Cohesion c [-], linear, 0 to 0.01, start 0
//! ```
//!
//! The text before the unit names the quantity; its last word is the symbol.

use crate::physics::names::name;
use crate::physics::parameters::Parameter;

/// The form, for errors.
pub(super) const FORM: &str = "a comment such as `/// Young's modulus E [Pa], log10, 1e3 to 1e7` above the member: what it is, \
                               symbol, unit, map (log10, linear, or between A and B), plausible range (A to B), and if \
                               known: start A, usually A +- B, usually A times OTHER +- B, compression A";

/// The form for history, for errors.
pub(super) const HISTORY_FORM: &str = "a comment such as `/// Plastic volume [-], start 1` above the member: what it is, unit, \
                                       and its value at rest, for a matrix also `start identity`; or without a start, which `fn rest` says";

/// A comment in parts.
struct Parts<'a> {
    symbol: Option<&'a str>,
    unit: &'a str,
    clauses: Vec<&'a str>,
}

fn parts(text: &str) -> Result<Parts<'_>, String> {
    let (head, rest) = text.split_once('[').ok_or("no unit in brackets, such as [Pa] or [-]")?;
    let (unit, rest) = rest.split_once(']').ok_or("no `]` after the unit")?;
    let unit = unit.trim();
    if unit.is_empty() {
        return Err("an empty unit; `[-]` is no unit".to_owned());
    }
    let mut words = head.split_whitespace().rev();
    let symbol = words.next();
    let clauses = rest.split(',').map(|clause| clause.trim().trim_end_matches('.')).filter(|clause| !clause.is_empty());
    Ok(Parts { symbol, unit, clauses: clauses.collect() })
}

fn number(text: &str) -> Result<f64, String> {
    let number: f64 = text.trim().parse().map_err(|_| format!("`{}`, which is no number", text.trim()))?;
    if number.is_finite() { Ok(number) } else { Err(format!("`{}`", text.trim())) }
}

fn pair(text: &str, between: &str) -> Result<[f64; 2], String> {
    let (low, high) = text.split_once(between).ok_or_else(|| format!("`{text}`, without `{}`", between.trim()))?;
    let pair = [number(low)?, number(high)?];
    if pair[0] < pair[1] { Ok(pair) } else { Err(format!("`{text}`, whose first number is not the smaller")) }
}

enum Usual<'a> {
    Around(f64, f64),
    Times(&'a str, f64, f64),
}

/// `A +- B`, `A times NAME +- B`
fn usual(text: &str) -> Result<Usual<'_>, String> {
    let (middle, deviation) = text
        .split_once("+-")
        .or_else(|| text.split_once('±'))
        .ok_or_else(|| format!("`usually {text}`, without a deviation `+- B`"))?;
    let deviation = number(deviation.trim().trim_end_matches("decades"))?;
    if deviation <= 0.0 {
        return Err(format!("a deviation of {deviation}"));
    }
    match middle.split_once(" times ") {
        Some((ratio, other)) => Ok(Usual::Times(other.trim(), number(ratio)?, deviation)),
        None => Ok(Usual::Around(number(middle)?, deviation)),
    }
}

/// The parameter that a comment describes.
///
/// # Errors
///
/// What was found in place of the form.
pub(super) fn parameter(member: &str, text: &str) -> Result<Parameter, String> {
    let Parts { symbol, unit, clauses } = parts(text)?;
    let (mut log, mut linear, mut limits, mut prior) = (false, false, None, None);
    let (mut start, mut usually, mut compression) = (None, None, None);
    for clause in clauses {
        let after = |word: &str| clause.strip_prefix(word).map(str::trim);
        if clause == "log10" {
            log = true;
        } else if clause == "linear" {
            linear = true;
        } else if let Some(rest) = after("between ") {
            limits = Some(pair(rest, " and ")?);
        } else if let Some(rest) = after("start ") {
            start = Some(number(rest)?);
        } else if let Some(rest) = after("usually ") {
            usually = Some(usual(rest)?);
        } else if let Some(rest) = after("compression ") {
            compression = Some(number(rest)?);
        } else if clause.contains(" to ") {
            prior = Some(pair(clause, " to ")?);
        } else {
            return Err(format!("`{clause}`"));
        }
    }
    let prior = prior.ok_or("no plausible range `A to B`")?;
    let inside = |value: f64| match limits {
        Some([low, high]) => low < value && value < high,
        None => !log || value > 0.0,
    };
    let named = name(member);
    let (symbol, unit) = (name(symbol.unwrap_or(member)), name(unit));
    let mut parameter = match (log, linear, limits) {
        (true, false, None) if prior[0] <= 0.0 => return Err(format!("log10 with a range from {}", prior[0])),
        (true, false, None) => Parameter::log10(named, symbol, unit, prior),
        (false, true, None) => Parameter::linear(named, symbol, unit, 0.5 * (prior[0] + prior[1]), prior),
        (false, false, Some([low, high])) if prior[0] < low || prior[1] > high => {
            return Err(format!("a range of {} to {} that exceeds the limits {low} and {high}", prior[0], prior[1]));
        }
        (false, false, Some(limits)) => Parameter::bounded(named, symbol, unit, limits, prior),
        (false, false, None) => return Err("no map".to_owned()),
        _ => return Err("more than one map".to_owned()),
    };
    if let Some(start) = start {
        if !inside(start) {
            return Err(format!("`start {start}`, which the map cannot reach"));
        }
        parameter.start = start;
    }
    match usually {
        None => {}
        Some(Usual::Around(middle, deviation)) if inside(middle) => parameter = parameter.usually(middle, deviation),
        Some(Usual::Around(middle, _)) => return Err(format!("`usually {middle}`, which the map cannot reach")),
        Some(Usual::Times(other, ratio, deviation)) if log && ratio > 0.0 => {
            parameter = parameter.usually_times(name(other), ratio, deviation);
        }
        Some(Usual::Times(..)) => {
            return Err("a multiple of another parameter that is not positive and log10".to_owned());
        }
    }
    if let Some(times) = compression {
        if times <= 0.0 {
            return Err(format!("`compression {times}`"));
        }
        parameter = parameter.told_by_compression(times);
    }
    Ok(parameter)
}

/// What a history variable starts from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Start {
    Value(f64),
    Identity,
    /// `fn rest` says it.
    Unsaid,
}

/// Unit and start of a history variable.
///
/// # Errors
///
/// What was found in place of the form.
pub(super) fn history(text: &str) -> Result<(&'static str, Start), String> {
    let Parts { unit, clauses, .. } = parts(text)?;
    let mut start = Start::Unsaid;
    for clause in clauses {
        start = match clause.strip_prefix("start ").map(str::trim) {
            Some("identity") => Start::Identity,
            Some(value) => Start::Value(number(value)?),
            None => return Err(format!("`{clause}`")),
        };
    }
    Ok((name(unit), start))
}
