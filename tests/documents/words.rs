//! Words that the project has left behind, and what it says instead. CHANGELOG and decisions may quote them.

use std::path::Path;

use crate::markdown::{files, shown};

/// What is no longer said, by the word that is.
const LEFT: [(&str, &[&str]); 7] = [
    ("silhouette", &["outline", "outlines", "outlined"]),
    ("camera", &["eye", "eyes"]),
    ("seeding", &["sow", "sows", "sown", "sowed", "sowing"]),
    ("grid", &["lattice", "lattices"]),
    ("depth shear", &["lean", "leans", "leaning", "leant"]),
    ("depth scale, or further", &["farther"]),
    ("memory estimate", &["footprint", "footprints"]),
];

/// The same of phrases.
const PHRASES: [(&str, &str); 4] = [
    ("fluid-like", "bodies that flow"),
    ("solid", "bodies that stay"),
    ("fluid-like and solid", "flows and stays"),
    ("boundary", "rim of the silhouette"),
];

/// The same of files and folders.
const MODULES: [(&str, &str); 2] = [("resimulate", "again"), ("cache", "recent")];

/// Where they may stand.
const EXEMPT: [&str; 3] = ["CHANGELOG.md", "docs/decisions/", "tests/documents/words.rs"];

/// The words of a line: `SilhouetteOutline`, `outline_of` and `outline-of` hold the word `outline`. The identity matrix is `eye()` in
/// linear algebra, and `eye_m` is a key of scene files, which users have.
fn words(line: &str) -> Vec<String> {
    let line = line.replace("eye()", " ").replace("eye_m", " ").replace("EYE", " ");
    let (mut found, mut word, mut before) = (Vec::new(), String::new(), ' ');
    for c in line.chars().chain([' ']) {
        if !c.is_alphabetic() || (c.is_uppercase() && before.is_lowercase()) {
            found.extend((!word.is_empty()).then(|| std::mem::take(&mut word)));
        }
        if c.is_alphabetic() {
            word.extend(c.to_lowercase());
        }
        before = c;
    }
    found
}

/// What a line says that is no longer said, and the word for it.
fn left(line: &str) -> Vec<(String, &'static str)> {
    let instead = |word: &str| LEFT.iter().find(|(_, old)| old.contains(&word)).map(|(new, _)| *new);
    let single = words(line).into_iter().filter_map(|word| instead(&word).map(|new| (word, new)));
    let phrases = PHRASES.iter().filter(|(_, old)| line.contains(old)).map(|(new, old)| ((*old).to_owned(), *new));
    single.chain(phrases).collect()
}

/// The word for the name of a file or folder that is no longer used.
fn module(path: &str) -> Option<&'static str> {
    let old = |part: &str| MODULES.iter().find(|(_, old)| part == *old || part.strip_suffix(".rs") == Some(old));
    path.split('/').find_map(|part| old(part).map(|(new, _)| *new))
}

#[test]
fn old_words_are_gone() {
    let mut found = Vec::new();
    for file in files(&["rs", "wgsl", "md", "toml", "py", "sh"]) {
        let path = shown(&file);
        if EXEMPT.iter().any(|exempt| path.starts_with(exempt)) {
            continue;
        }
        found.extend(module(&path).map(|new| format!("{path}: call it `{new}`")));
        let name = Path::new(&path).file_stem().unwrap().to_string_lossy().into_owned();
        found.extend(left(&name).into_iter().map(|(old, new)| format!("{path}: the name has `{old}`, say `{new}`")));
        for (at, line) in std::fs::read_to_string(&file).unwrap().lines().enumerate() {
            let say = |(old, new): (String, &str)| format!("{path}:{}: `{old}`, say `{new}`", at + 1);
            found.extend(left(line).into_iter().map(say));
        }
    }
    assert!(found.is_empty(), "{} places:\n{}", found.len(), found.join("\n"));
}

#[test]
fn words_are_found_within_names() {
    let old = |line: &str| left(line).into_iter().map(|(old, _)| old).collect::<Vec<_>>();
    assert_eq!(old("let x = cut_outline(LatticeOf::Eye)"), ["outline", "lattice", "eye"]);
    assert_eq!(old("pub mod sowing; // of bodies that flow"), ["sowing", "bodies that flow"]);
    assert!(old("Mat3::eye() is clean; eye_m = 1; const EYE; a boolean").is_empty());
    assert_eq!(module("models/tests/cli/again.rs"), Some("resimulate"));
    assert_eq!(module("models/src/against.rs"), None);
}
