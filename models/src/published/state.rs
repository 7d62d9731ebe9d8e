//! What a run of the chain has reached: `published.json` in its folder.

use std::collections::BTreeMap;

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::Stage;
use super::descent::Answer;
use crate::runtime::run_folder::RunFolder;
use crate::views::ImageBox;

/// Name of the file.
pub(crate) const STATE: &str = "published.json";

/// What of the chain is done, and what was found on the way.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Finished stages in order, with their times.
    pub finished: Vec<Finished>,
    /// Fingerprint of the weights that the views are made with.
    #[serde(default)]
    pub weights: String,
    /// The object's box in every picture, as shares of its sides.
    #[serde(default)]
    pub boxes: Vec<ImageBox>,
    /// How the object comes to its place in the views.
    #[serde(default)]
    pub placing: Option<Placing>,
    /// The field's motion.
    #[serde(default)]
    pub motion: Option<Motion>,
    /// The initial velocity that fits the pictures of the flight \[m/s\].
    #[serde(default)]
    pub velocity: Option<[f64; 3]>,
    /// Answers of the searches, in the order of their requests: gone through again with them, a search goes on where it was
    /// interrupted and ends as if it had not been.
    #[serde(default)]
    pub answers: BTreeMap<Stage, Vec<Answer>>,
    /// Loss and signal-to-noise ratio of the field \[dB\], every so many updates.
    #[serde(default)]
    pub field: Vec<(usize, f64, f64)>,
}

/// A finished stage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Finished {
    /// Which.
    pub stage: Stage,
    /// How long it took \[s\]; of one that was interrupted, since it went on.
    pub seconds: f64,
}

/// How the object comes to its place in the views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Placing {
    /// The spatial-aware module of the model puts it there.
    Module,
    /// The views show it in the middle and are moved.
    Moved,
}

/// Where the temporal field has the object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Its middle in every frame \[m\].
    pub middles: Vec<[f64; 3]>,
    /// Its lowest point in every frame \[m\].
    pub lowest: Vec<f64>,
    /// The first frame in which it touches the ground, if any.
    pub contact: Option<usize>,
    /// Initial velocity \[m/s\].
    pub velocity: [f64; 3],
    /// Height of the ground \[m\]: the one that is known, or where the object comes to rest.
    pub ground: f64,
}

impl State {
    /// The state in a folder; an empty one if nothing was reached.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the file is damaged.
    pub fn read(folder: &RunFolder) -> Result<Self> {
        if !folder.has(STATE) {
            return Ok(Self::default());
        }
        let damaged = |found: String| {
            Error::new(ErrorKind::Input, "a file of the run is damaged")
                .at(folder.path(STATE).display())
                .found(found)
                .fix("start again with another --out; nothing here was changed")
        };
        let state: Self = serde_json::from_str(&folder.read_text(STATE)?).map_err(|e| damaged(e.to_string()))?;
        let ascending = state.finished.is_sorted_by(|a, b| a.stage < b.stage);
        if !ascending {
            return Err(damaged("stages out of order".into()));
        }
        Ok(state)
    }

    /// Takes boxes and views of another run over, if it has finished them: runs that differ in what follows need them once.
    ///
    /// # Errors
    /// What reading and writing return.
    pub(crate) fn share_views(from: &RunFolder, to: &RunFolder) -> Result<()> {
        let other = Self::read(from)?;
        if !other.has_finished(Stage::Views) {
            return Ok(());
        }
        let names = (0..other.boxes.len()).map(|frame| format!("views/frame_{frame:03}.safetensors"));
        for name in names.chain([super::report::BOXES, super::report::VIEWS].map(str::to_owned)) {
            to.write(&name, &from.read(&name)?)?;
        }
        let finished = other.finished.iter().copied().filter(|done| done.stage <= Stage::Views).collect();
        let Self { weights, boxes, placing, .. } = other;
        Self { finished, weights, boxes, placing, ..Self::default() }.save(to)
    }

    /// Writes the file.
    ///
    /// # Errors
    /// What writing returns.
    pub fn save(&self, folder: &RunFolder) -> Result<()> {
        let text = serde_json::to_vec_pretty(self)
            .map_err(|e| Error::new(ErrorKind::Io, "cannot write the state of the run").found(e))?;
        folder.write(STATE, &text)
    }

    /// Whether a stage is finished.
    pub fn has_finished(&self, stage: Stage) -> bool {
        self.finished.iter().any(|done| done.stage == stage)
    }

    /// Marks a stage as finished.
    ///
    /// # Errors
    /// What writing returns.
    pub fn finish(&mut self, folder: &RunFolder, stage: Stage, seconds: f64) -> Result<()> {
        self.finished.push(Finished { stage, seconds });
        self.save(folder)
    }
}
