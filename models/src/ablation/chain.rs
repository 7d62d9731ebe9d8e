//! Reconstructions by the published chain.

use std::path::Path;

use gradreel::{Device, Result};

use super::{AblationSettings, Cell, CellResult};
use crate::identify::{Config, Run};
use crate::monocular;
use crate::published::{self, Chain, Origin, PublishedConfig};
use crate::report::reconstruction::{publish_with, quantities};
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::video::Clip;
use crate::views::FileWeights;

impl PublishedConfig {
    /// The weights as they are opened for a bench.
    ///
    /// # Errors
    /// As [`FileWeights::open`].
    pub(crate) fn open_weights(&self) -> Result<FileWeights> {
        FileWeights::open(self.weights.as_deref().unwrap_or(Path::new(FileWeights::BUILT_IN)), &Device::Cpu)
    }
}

impl AblationSettings {
    /// The configuration of a cell of the published chain.
    fn config_of_chain(&self, cell: Cell, clip: &Clip) -> Config {
        let mut config = self.config.clone();
        let published = config.published.get_or_insert_default();
        if published.weights.is_none() {
            config.weights.imagined_colour = 0.0;
        }
        config.clip.cameras = clip.cameras.iter().map(|camera| camera.id).collect();
        if cell == Cell::PublishedWithoutLva {
            config.loss.views.alpha = 0.0;
        }
        config
    }

    /// Reconstructs by the published chain, and compares with all views as filmed. `beside` is the folder of a cell that has made the
    /// same views, if there is one.
    pub(super) fn chain(
        &self,
        cell: Cell,
        clip: &Clip,
        folder: &Path,
        beside: Option<&Path>,
        progress: &Progress,
    ) -> Result<CellResult> {
        let seen = match cell {
            Cell::PublishedViews => Clip { imagined: vec![false; clip.cameras.len()], ..clip.clone() },
            _ => {
                let mut seen = clip.single(self.primary_of(clip));
                monocular::sight(&mut seen, self.config.world.gravity)?;
                seen
            }
        };
        let config = self.config_of_chain(cell, &seen);
        let published = config.published.clone().unwrap_or_default();
        let mut run = match folder.join("config.toml").is_file() {
            true => Run::open(RunFolder::resume(folder)?)?,
            false => {
                let run = Run::create(RunFolder::create(folder)?, config, &seen)?;
                if let Some(beside) = beside.filter(|_| cell != Cell::PublishedViews) {
                    published::State::share_views(&RunFolder::open(beside)?, &run.folder)?;
                }
                run
            }
        };
        run.go_on(&seen)?;
        let weights = if cell == Cell::PublishedViews { None } else { Some(published.open_weights()?) };
        let fingerprint = published.weights.map_or(FileWeights::BUILT_IN.to_owned(), |path| path.display().to_string());
        let origin = match &weights {
            Some(weights) => Origin::Film { weights, fingerprint: &fingerprint, boxes: None },
            None => Origin::Views,
        };
        let chain = Chain::new(&mut run, origin, progress, true)?;
        let stages = chain.stages();
        let (found, state) = chain.finish(&seen)?;
        let shown = published::report::beside(&state, &found.law, &run.folder, stages)?;
        let quality = publish_with(&found, &run, clip, progress, Some(shown))?;
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
