//! Benchmark clips of the five material families, rendered unless clips are given.

use std::fs;
use std::path::PathBuf;

use gradreel::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::scenes::SceneFile;

/// The scenes in the order of the published table's materials, followed by a second one of each family.
const SCENES: [(&str, &str); 10] = [
    ("newtonian", include_str!("../../../../examples/scenes/families/newtonian.toml")),
    ("non_newtonian", include_str!("../../../../examples/scenes/families/non_newtonian.toml")),
    ("elastic", include_str!("../../../../examples/scenes/families/elastic.toml")),
    ("plasticine", include_str!("../../../../examples/scenes/families/plasticine.toml")),
    ("sand", include_str!("../../../../examples/scenes/families/sand.toml")),
    ("newtonian_2", include_str!("../../../../examples/scenes/families/newtonian_2.toml")),
    ("non_newtonian_2", include_str!("../../../../examples/scenes/families/non_newtonian_2.toml")),
    ("elastic_2", include_str!("../../../../examples/scenes/families/elastic_2.toml")),
    ("plasticine_2", include_str!("../../../../examples/scenes/families/plasticine_2.toml")),
    ("sand_2", include_str!("../../../../examples/scenes/families/sand_2.toml")),
];

/// Which clips are rendered, and at which resolution.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Films {
    /// Number of scenes.
    count: usize,
    /// Grid spacing \[m\]; `None` uses the spacing and time step of the scene files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    spacing_m: Option<f64>,
}

/// Substeps per frame if the spacing differs from that of the scenes.
const SUBSTEPS: usize = 200;

impl Films {
    /// One film per family, with the grid spacing and time step of reconstructions.
    pub(super) const ONE_EACH: Self = Self { count: 5, spacing_m: Some(0.02) };
    /// Two films per family.
    pub(super) const TWO_EACH: Self = Self { count: 10, ..Self::ONE_EACH };

    /// The same on a coarse grid for a small budget.
    pub(super) fn quick(self) -> Self {
        Self { spacing_m: Some(0.05), ..self }
    }

    /// The same on a grid between those.
    pub(super) fn coarse(self) -> Self {
        Self { spacing_m: Some(0.03), ..self }
    }

    /// The same with the grid spacing and time step of the scene files, which are finer than those of
    /// reconstructions.
    pub(super) fn fine(self) -> Self {
        Self { spacing_m: None, ..self }
    }

    fn scenes(self) -> &'static [(&'static str, &'static str)] {
        &SCENES[..self.count.min(SCENES.len())]
    }

    /// Paths of the clips.
    pub(super) fn places(self, folder: &RunFolder) -> Vec<PathBuf> {
        self.scenes().iter().map(|(name, _)| folder.path(&format!("films/{name}/clip"))).collect()
    }
}

/// Renders those that do not exist yet.
pub(super) fn make(folder: &RunFolder, films: Films, progress: &Progress) -> Result<()> {
    let scenes = films.scenes();
    let bar = progress.stage("films", scenes.len() as u64);
    for (number, (name, text)) in scenes.iter().enumerate() {
        bar.set(number as u64, name);
        let [done, begun] = ["", ".partial"].map(|ending| folder.path(&format!("films/{name}{ending}")));
        if done.is_dir() {
            continue;
        }
        // interrupted clips are rendered again
        if begun.is_dir() {
            fs::remove_dir_all(&begun).map_err(|e| Error::io(&begun, "remove", &e))?;
        }
        let mut scene = SceneFile::parse(text)?;
        if let Some(spacing) = films.spacing_m {
            scene.grid.spacing_m = spacing;
            scene.time.substeps_per_frame = Some(SUBSTEPS);
        }
        crate::cli::simulate::film(scene, name, &begun)?;
        fs::rename(&begun, &done).map_err(|e| Error::io(&done, "write", &e))?;
    }
    bar.finish("");
    Ok(())
}
