//! Reconstructions from imagined views.

use std::path::Path;

use gradreel::Result;

use super::{AblationSettings, Cell, CellResult};
use crate::identify::{Config, MaterialConfig, Run, reconstruct};
use crate::monocular;
use crate::report::reconstruction::{publish, quantities};
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::video::Clip;

impl AblationSettings {
    /// The configuration of a cell.
    fn config_of(&self, cell: Cell, clip: &Clip) -> Config {
        let mut config = self.config.clone();
        let imagined = clip.cameras.iter().zip(&clip.imagined).filter(|(_, imagined)| **imagined);
        config.clip.cameras = clip.cameras.iter().map(|camera| camera.id).collect();
        config.clip.imagined = Some(imagined.map(|(camera, _)| camera.id).collect());
        if matches!(cell, Cell::WithoutLva | Cell::Plain) {
            config.loss.views.alpha = 0.0;
        }
        if cell == Cell::Auto {
            config.material = MaterialConfig { name: "auto".into(), ..MaterialConfig::default() };
        }
        if cell == Cell::Plain {
            config.loss.pixels.robust = false;
            config.loss.ranges.enabled = false;
        }
        config
    }

    /// Reconstructs, and compares with all views as filmed.
    pub(super) fn identify(&self, cell: Cell, clip: &Clip, folder: &Path, progress: &Progress) -> Result<CellResult> {
        let seen = match cell {
            Cell::Single => {
                let mut seen = clip.single(self.primary_of(clip));
                monocular::sight(&mut seen, self.config.world.gravity)?;
                seen
            }
            Cell::Real | Cell::Auto => Clip { imagined: vec![false; clip.cameras.len()], ..clip.clone() },
            _ => self.perturbation.of(clip, self.primary_of(clip)),
        };
        let mut run = match folder.join("config.toml").is_file() {
            true => Run::open(RunFolder::resume(folder)?)?,
            false => Run::create(RunFolder::create(folder)?, self.config_of(cell, &seen), &seen)?,
        };
        run.go_on(&seen)?;
        let found = reconstruct(&seen, &mut run, progress)?;
        let quality = publish(&found, &run, clip, progress)?;
        // fixed parameters are not estimates
        let mut quantities = quantities(&found, &run);
        quantities.retain(|quantity| quantity.source == "fitted");
        let intervals = quantities.iter().filter_map(|quantity| Some((quantity.name.clone(), quantity.interval_90?)));
        Ok(CellResult {
            intervals: intervals.collect(),
            family: run.config.material.name.clone(),
            estimates: quantities.into_iter().map(|quantity| (quantity.name, quantity.value)).collect(),
            quality,
            ..CellResult::default()
        })
    }
}
