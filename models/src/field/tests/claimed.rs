//! No file of vectors lies there unread: each is named by a test, or read by one that takes all of its kind.

use std::fs;
use std::path::Path;

/// The text of all tests below a folder.
fn sources(folder: &Path) -> String {
    let mut text = String::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            text += &sources(&path);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            text += &fs::read_to_string(&path).unwrap();
        }
    }
    text
}

/// Names of files, without their endings.
fn stems(folder: &Path) -> Vec<String> {
    let files = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path());
    let data = |path: &std::path::PathBuf| {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        ["safetensors", "ckpt", "pt", "npy", "npz", "tsv"].contains(&ending)
    };
    files.filter(data).map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned()).collect()
}

#[test]
fn every_file_of_vectors_is_read() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (ours, cores) = (root.join("tests"), root.join("../tests"));
    let stages = ["field/tests", "views/tests", "depth"].map(|stage| sources(&root.join("src").join(stage)));
    let text = sources(&ours) + &sources(&cores) + &stages.concat();
    let is_named = |stem: &String| {
        [format!("\"{stem}\""), format!("\"{stem}."), format!("/{stem}.")].iter().any(|name| text.contains(name))
    };
    let of_a_kind =
        |stem: &String| ["constitutive_", "substep_", "traj_", "dynamic_"].iter().any(|kind| stem.starts_with(kind));
    let own = ["vectors", "vectors/views", "vectors/depth"].map(|folder| stems(&ours.join(folder)));
    let own: Vec<String> = [own.concat(), stems(&cores.join("vectors"))].concat();
    assert!(own.len() > 50, "the vectors are found: {own:?}");
    let unread: Vec<&String> = own.iter().filter(|stem| !is_named(stem)).collect();
    assert!(unread.is_empty(), "no test reads {unread:?}");
    let Some(given) = std::env::var_os("GRADREEL_VECTORS").map(std::path::PathBuf::from) else { return };
    for folder in ["", "dynamics", "views", "nvs", "../dynamics", "../views", "../nvs"] {
        for stem in stems(&given.join(folder)).iter().filter(|stem| !is_named(stem) && !of_a_kind(stem)) {
            assert!(!own.contains(stem), "no test reads {stem}");
            eprintln!("GRADREEL_VECTORS: no test knows what {folder}/{stem} is");
        }
    }
}
