//! Clips of the five families, made where nobody has given any.

use std::fs;
use std::path::PathBuf;

use gradreel::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::report::progress::Progress;
use crate::report::run_folder::RunFolder;
use crate::scenes::SceneFile;

/// The scenes, in the order of the published table's materials.
const SCENES: [(&str, &str); 5] = [
    ("newtonian", include_str!("../../../../examples/scenes/families/newtonian.toml")),
    ("non_newtonian", include_str!("../../../../examples/scenes/families/non_newtonian.toml")),
    ("elastic", include_str!("../../../../examples/scenes/families/elastic.toml")),
    ("plasticine", include_str!("../../../../examples/scenes/families/plasticine.toml")),
    ("sand", include_str!("../../../../examples/scenes/families/sand.toml")),
];

/// Grid spacing of the films \[m\], and substeps of each of their frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Fineness {
    spacing_m: f64,
    substeps_per_frame: usize,
}

/// The grid and step that reconstructions use.
pub(super) const WHOLE: Fineness = Fineness { spacing_m: 0.02, substeps_per_frame: 200 };
/// For a tiny budget.
pub(super) const QUICK: Fineness = Fineness { spacing_m: 0.05, substeps_per_frame: 200 };

/// Where the clips are.
pub(super) fn places(folder: &RunFolder) -> Vec<PathBuf> {
    SCENES.iter().map(|(name, _)| folder.path(&format!("films/{name}/clip"))).collect()
}

/// Makes those that are not there yet.
pub(super) fn make(folder: &RunFolder, fineness: Fineness, progress: &Progress) -> Result<()> {
    let bar = progress.stage("films", SCENES.len() as u64);
    for (number, (name, text)) in SCENES.iter().enumerate() {
        bar.set(number as u64, name);
        let [done, begun] = ["", ".partial"].map(|ending| folder.path(&format!("films/{name}{ending}")));
        if done.is_dir() {
            continue;
        }
        // one that was interrupted is soon made again
        if begun.is_dir() {
            fs::remove_dir_all(&begun).map_err(|e| Error::io(&begun, "remove", &e))?;
        }
        let mut scene = SceneFile::parse(text)?;
        scene.grid.spacing_m = fineness.spacing_m;
        scene.time.substeps_per_frame = Some(fineness.substeps_per_frame);
        crate::cli::simulate::film(scene, name, &begun)?;
        fs::rename(&begun, &done).map_err(|e| Error::io(&done, "write", &e))?;
    }
    bar.finish("");
    Ok(())
}
