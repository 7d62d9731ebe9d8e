//! `config.toml` of a run: the settings with a mark that tells whether somebody has edited them since.

use gradreel::{Error, ErrorKind, Result};
use serde_json::Value;

use crate::fnv1a::fnv1a;
use crate::identify::Config;

/// What stands before the mark in the file.
const MARK: &str = "# written by the run, edited if this differs from the settings above: ";

/// Settings that only say how much effort is still spent, by their paths.
const EFFORT: [&str; 9] = [
    "estimate.velocity",
    "estimate.points",
    "estimate.survivors",
    "estimate.steps",
    "estimate.rounds",
    "flowing.in_motion",
    "geometry.fit.iterations",
    "geometry.fit.in_motion",
    "world.memory_mib",
];

/// All settings by name.
pub(in crate::identify) type Settings = serde_json::Map<String, Value>;

/// The settings as a file has them.
///
/// # Errors
/// Never for values that passed [`Config::check`].
pub(in crate::identify) fn of(config: &Config) -> Result<Settings> {
    // through its text, which has the fewest digits that tell a number
    let text = serde_json::to_string(config).and_then(|text| serde_json::from_str(&text));
    text.map_err(|e| Error::new(ErrorKind::Io, "the configuration cannot be read again").found(e))
}

/// The text of the file.
///
/// # Errors
/// As [`Config::to_toml`].
pub(in crate::identify) fn text(config: &Config) -> Result<String> {
    let settings = config.to_toml()?;
    Ok(format!("{settings}\n{MARK}{:016x}\n", fnv1a(settings.as_bytes())))
}

/// Whether the settings that a file holds are other ones than it was written with.
///
/// # Errors
/// As [`Config::to_toml`].
pub(in crate::identify) fn is_edited(written: &str, config: &Config) -> Result<bool> {
    let Some(mark) = written.lines().rev().find_map(|line| line.strip_prefix(MARK)) else { return Ok(false) };
    Ok(mark.trim() != format!("{:016x}", fnv1a(config.to_toml()?.as_bytes())))
}

/// Every setting that differs, as `name: before → now`: those that say what is computed, and those of effort alone.
pub(in crate::identify) fn changes(before: &Settings, now: &Settings) -> [Vec<String>; 2] {
    let mut all = Vec::new();
    compare("", before, now, &mut all);
    let effort = |(name, _): &(String, String)| EFFORT.contains(&name.as_str());
    let (effort, other): (Vec<_>, Vec<_>) = all.into_iter().partition(effort);
    [other, effort].map(|list| list.into_iter().map(|(name, values)| format!("{name}: {values}")).collect())
}

fn compare(path: &str, before: &Settings, now: &Settings, found: &mut Vec<(String, String)>) {
    let names = before.keys().chain(now.keys().filter(|name| !before.contains_key(*name)));
    for name in names {
        let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        match (before.get(name), now.get(name)) {
            (Some(Value::Object(before)), Some(Value::Object(now))) => compare(&path, before, now, found),
            (before, now) if before.unwrap_or(&Value::Null) == now.unwrap_or(&Value::Null) => {}
            (before, now) => {
                let [before, now] = [before, now].map(|value| value.map_or("nothing".to_owned(), ToString::to_string));
                found.push((path, format!("{before} → {now}")));
            }
        }
    }
}

/// Refuses settings that were edited after stages had used them.
pub(in crate::identify) fn refused(place: &dyn std::fmt::Display, changed: &[String]) -> Error {
    Error::new(ErrorKind::Input, "settings of the run were changed after it had used them")
        .at(place)
        .found(changed.join("; "))
        .wanted("the settings that the run was begun with")
        .fix("undo the change, or begin another run with --config and another --out")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_seen_and_named() {
        let config = Config::default();
        let written = text(&config).unwrap();
        assert!(!is_edited(&written, &Config::parse(&written).unwrap()).unwrap());
        // layout and comments are no settings
        let commented = format!("# mine\n\n{written}");
        assert!(!is_edited(&commented, &Config::parse(&commented).unwrap()).unwrap());
        let edited = written.replace("dx = 0.0", "dx = 0.03").replace("points = 32", "points = 48");
        let now = Config::parse(&edited).unwrap();
        assert!(is_edited(&edited, &now).unwrap());
        let [other, effort] = changes(&of(&config).unwrap(), &of(&now).unwrap());
        assert_eq!(other, ["geometry.dx: 0.0 → 0.03"]);
        assert_eq!(effort, ["estimate.points: 32 → 48"]);
    }

    #[test]
    fn names_of_effort_are_settings() {
        let settings = Value::Object(of(&Config::default()).unwrap());
        for path in EFFORT {
            let found = path.split('.').try_fold(&settings, |table, name| table.get(name));
            assert!(found.is_some_and(Value::is_u64), "{path}");
        }
    }
}
