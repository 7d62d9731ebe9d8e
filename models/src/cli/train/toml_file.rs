//! Settings of a training in TOML: read, and merged with defaults.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

use crate::text;

/// The error for settings that are not understood.
pub(super) fn refused(at: &str, found: &dyn std::fmt::Display) -> Error {
    Error::new(ErrorKind::Input, "the settings of the training cannot be read")
        .at(at)
        .found(found)
        .wanted("TOML with the names that --print-config prints")
        .fix("correct the file")
}

/// Reads a file of settings.
pub(super) fn read(path: &Path) -> Result<toml::Table> {
    let fix = "give the path of a TOML file to --config";
    let text = text::read(path, "the settings", fix, text::SETTINGS)?;
    text.parse().map_err(|e: toml::de::Error| refused(&path.display().to_string(), &e))
}

/// Merges two tables; `other` takes precedence.
pub(super) fn merged(mut table: toml::Table, other: toml::Table) -> toml::Table {
    for (name, value) in other {
        let value = match (table.remove(&name), value) {
            (Some(toml::Value::Table(own)), toml::Value::Table(given)) => toml::Value::Table(merged(own, given)),
            (_, value) => value,
        };
        table.insert(name, value);
    }
    table
}
