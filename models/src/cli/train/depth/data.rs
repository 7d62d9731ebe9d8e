//! Pictures of a training and of its validation, determined by the seed.

use std::path::Path;
use std::sync::Arc;

use gradreel::{Error, ErrorKind, Key, Result};

use super::settings::Settings;
use crate::cli::train::feed::Feed;
use crate::depth::{Batch, Sample, Solid, Split, made_solids, read_shapes, training_sample, two_views};
use crate::runtime::progress::Progress;

/// Key folds that separate the uses of the seed.
const SEEN: u64 = 100;
const MADE: u64 = 104;
/// Key of the validation's pictures: the same ones for all seeds, so that trainings compare.
const UNSEEN: u64 = 101;

/// Solids to learn from, and pictures to validate with.
pub(super) struct Solids {
    pub real: Arc<Vec<Arc<Solid>>>,
    pub made: Arc<Vec<Arc<Solid>>>,
    pub unseen: Vec<Sample>,
}

impl Solids {
    /// Reads the shapes in a folder and makes the procedural solids.
    pub fn open(settings: &Settings, folder: &Path, progress: &Progress) -> Result<Self> {
        let stage = progress.stage("reading shapes", 0);
        let real = read_shapes(folder, Split::Train)?;
        let held = read_shapes(folder, Split::Val)?;
        stage.finish(&format!("{} to learn from", real.len()));
        let views = two_views(&held, Key::new(UNSEEN), settings.validation.pictures);
        let unseen: Vec<Sample> = views.into_iter().map(|view| view.sample).collect();
        if unseen.is_empty() {
            return Err(Error::new(ErrorKind::Input, "no shape for validation can be seen")
                .at(folder.join(Split::Val.file()).display())
                .fix("give shapes with more than a few visible triangles"));
        }
        let count = if settings.data.procedural > 0.0 { settings.data.solids } else { 0 };
        let stage = progress.stage("making procedural solids", 0);
        let made = made_solids(Key::new(settings.seed).fold(MADE), count, settings.data.nodes);
        stage.finish(&format!("{count}"));
        Ok(Self { real: Arc::new(real), made: Arc::new(made), unseen })
    }

    /// The batches of all steps from this one.
    pub fn feed(&self, settings: &Settings, first: u64) -> Result<Feed<Batch>> {
        let (real, made) = (self.real.clone(), self.made.clone());
        let (batch, share) = (settings.optimiser.batch as u64, settings.data.procedural);
        let key = Key::new(settings.seed).fold(SEEN);
        Feed::new(first..settings.steps, move |step| {
            let key = key.fold(step);
            let samples: Vec<Sample> =
                (0..batch).map(|place| training_sample(key.fold(place), &real, &made, share)).collect();
            Ok(Batch::of(&samples))
        })
    }
}
