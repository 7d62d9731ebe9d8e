//! Where files of vectors are: those of the project, and others of the same form in the folder that `GRADREEL_VECTORS` names.
//!
//! A set of vectors may lie in that folder itself, in one below it, or in one beside it, so that any of `FOLDER`, `FOLDER/views`
//! and `FOLDER/../nvs` serves the tests of views. A file that is in none of them is the project's own.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Folders of the simulator and the radiance field.
#[allow(dead_code)]
pub const DYNAMICS: &[&str] = &["dynamics"];
/// Folders of the multi-view model.
#[allow(dead_code)]
pub const VIEWS: &[&str] = &["views", "nvs"];

/// The folders of a set, those of others first.
fn folders(own: &Path, set: &[&str]) -> Vec<PathBuf> {
    let mut all = Vec::new();
    if let Some(given) = std::env::var_os("GRADREEL_VECTORS") {
        let given = PathBuf::from(given);
        assert!(given.is_dir(), "GRADREEL_VECTORS: there is no folder {}", given.display());
        all.extend(set.iter().map(|name| given.join(name)));
        all.push(given.clone());
        all.extend(set.iter().map(|name| given.join("..").join(name)));
    }
    all.push(own.to_owned());
    all
}

/// The path of a file of vectors; `own` is the folder of the project's.
#[allow(dead_code)]
pub fn path(own: &Path, set: &[&str], file: &str) -> PathBuf {
    let all = folders(own, set);
    let found = all.iter().map(|folder| folder.join(file)).find(|path| path.is_file());
    let found = found.unwrap_or_else(|| panic!("no {file} in any of {all:?}"));
    if all.len() > 1 && found.starts_with(own) {
        eprintln!("GRADREEL_VECTORS has no {file}: the project's own serves");
    }
    found
}

/// The names of all files of a set that begin so, without their ending.
#[allow(dead_code)]
pub fn names(own: &Path, set: &[&str], prefix: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for folder in folders(own, set) {
        for entry in std::fs::read_dir(folder).into_iter().flatten() {
            let file = entry.unwrap().file_name().into_string().unwrap();
            if let Some(name) = file.strip_suffix(".safetensors").filter(|name| name.starts_with(prefix)) {
                found.insert(name.to_owned());
            }
        }
    }
    found
}
