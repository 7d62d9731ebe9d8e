//! A treatment of a clip, and its result.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use gradreel::{ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::{Perturbation, Truth};
use crate::identify::Config;
use crate::runtime::progress::Progress;
use crate::video::Clip;

/// A treatment of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum Cell {
    /// Reconstruction from one real view alone
    Single,
    /// Reconstruction from the views as they were filmed
    Real,
    /// The same, and the family of materials is not told
    Auto,
    /// From one real view and imagined others, with the view-adaptive loss
    WithLva,
    /// The same, but all views count alike
    WithoutLva,
    /// The same, and without robust pixels and ranges of parameters, too
    Plain,
    /// The published chain from one real view, with the view-adaptive loss
    Published,
    /// The same, but all views count alike
    PublishedWithoutLva,
    /// The published chain from views that were all filmed
    PublishedViews,
    /// Temporal field as it is: bent coordinates and merged time features
    Time,
    /// Temporal field that bends coordinates, but does not merge features with positions and time
    Bending,
    /// Temporal field without any encoding of time
    Still,
}

impl Cell {
    /// All cells, in the order of the table.
    pub const ALL: [Self; 12] = [
        Self::Single,
        Self::Real,
        Self::Auto,
        Self::WithLva,
        Self::WithoutLva,
        Self::Plain,
        Self::Published,
        Self::PublishedWithoutLva,
        Self::PublishedViews,
        Self::Time,
        Self::Bending,
        Self::Still,
    ];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Real => "real",
            Self::Auto => "auto",
            Self::WithLva => "with_lva",
            Self::WithoutLva => "without_lva",
            Self::Plain => "plain",
            Self::Published => "published",
            Self::PublishedWithoutLva => "published_without_lva",
            Self::PublishedViews => "published_views",
            Self::Time => "time",
            Self::Bending => "bending",
            Self::Still => "still",
        }
    }

    /// The label in the table.
    pub fn label(self) -> &'static str {
        match self {
            Self::Single => "one real view",
            Self::Real => "real views",
            Self::Auto => "real views, family not told",
            Self::WithLva => "imagined views, with L_va",
            Self::WithoutLva => "imagined views, without L_va",
            Self::Plain => "imagined views, squared residuals alone",
            Self::Published => "as published, one real view, with L_va",
            Self::PublishedWithoutLva => "as published, one real view, without L_va",
            Self::PublishedViews => "as published, real views",
            Self::Time => "bent coordinates, merged time features",
            Self::Bending => "bent coordinates alone",
            Self::Still => "no encoding of time",
        }
    }

    /// Whether the cell is of the published chain.
    pub fn is_published(self) -> bool {
        matches!(self, Self::Published | Self::PublishedWithoutLva | Self::PublishedViews)
    }

    /// Whether the cell is a reconstruction; otherwise it fits a temporal field.
    pub fn reconstructs(self) -> bool {
        !matches!(self, Self::Time | Self::Bending | Self::Still)
    }
}

/// Settings shared by all cells.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AblationSettings {
    /// Id of the camera that stays real; the first camera if not given.
    pub primary: Option<i64>,
    /// Perturbation of the other views.
    pub perturbation: Perturbation,
    /// Settings of the reconstructions and of the temporal fits.
    pub config: Config,
}

/// The result of a cell.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CellResult {
    /// Parameters and components of the velocity by name, in SI units.
    pub estimates: BTreeMap<String, f64>,
    /// The 90 % intervals of those that have one.
    #[serde(default)]
    pub intervals: BTreeMap<String, [f64; 2]>,
    /// The family of materials, or the name of a law, if it was found.
    #[serde(default)]
    pub family: String,
    /// The errors, if the truth is known: in decades for magnitudes, relative for the velocity.
    pub errors: BTreeMap<String, f64>,
    /// Agreement of rendered images with the filmed ones.
    pub quality: BTreeMap<String, f64>,
    /// The error message of a failed cell.
    pub failed: Option<String>,
    /// Duration \[s\].
    pub seconds: f64,
}

impl AblationSettings {
    /// The index of the camera that stays real.
    pub fn primary_of(&self, clip: &Clip) -> usize {
        clip.cameras.iter().position(|camera| Some(camera.id) == self.primary).unwrap_or(0)
    }

    /// Runs a cell on a clip; a reconstruction continues in `folder` if it was begun there.
    ///
    /// # Errors
    /// [`ErrorKind::Interrupted`] and [`ErrorKind::Io`]; any other failure of a reconstruction is a result.
    pub fn run(
        &self,
        cell: Cell,
        clip: &Clip,
        truth: Option<&Truth>,
        folder: &Path,
        progress: &Progress,
    ) -> Result<CellResult> {
        let since = Instant::now();
        let done = match (cell.is_published(), cell.reconstructs()) {
            (true, _) => {
                // cells of a clip lie side by side
                let other = folder.with_file_name(Cell::Published.name());
                let beside =
                    Some(other).filter(|other| cell != Cell::Published && other.join("published.json").is_file());
                self.chain(cell, clip, folder, beside.as_deref(), progress)
            }
            (_, true) => self.identify(cell, clip, folder, progress),
            _ => self.encode(cell, clip, progress),
        };
        let mut result = match done {
            Err(error) if matches!(error.kind(), ErrorKind::Interrupted | ErrorKind::Io) => return Err(error),
            Err(error) => CellResult { failed: Some(error.to_string()), ..CellResult::default() },
            Ok(result) => result,
        };
        if let Some(truth) = truth {
            result.errors = truth.errors(&result.estimates);
        }
        result.seconds = since.elapsed().as_secs_f64();
        Ok(result)
    }
}
