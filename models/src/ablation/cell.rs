//! One way to treat a clip, and what came out of it.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use gradreel::{ErrorKind, Result};
use serde::{Deserialize, Serialize};

use super::{Perturbation, Truth};
use crate::identify::Config;
use crate::report::progress::Progress;
use crate::video::Clip;

/// One way to treat a clip.
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
    /// Temporal field as it is: bent coordinates and merged time features
    Time,
    /// Temporal field that bends coordinates, but does not merge features with positions and time
    Bending,
    /// Temporal field without any encoding of time
    Still,
}

impl Cell {
    /// All of them, in the order of the table.
    pub const ALL: [Self; 9] = [
        Self::Single,
        Self::Real,
        Self::Auto,
        Self::WithLva,
        Self::WithoutLva,
        Self::Plain,
        Self::Time,
        Self::Bending,
        Self::Still,
    ];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Real => "real",
            Self::Auto => "auto",
            Self::WithLva => "with_lva",
            Self::WithoutLva => "without_lva",
            Self::Plain => "plain",
            Self::Time => "time",
            Self::Bending => "bending",
            Self::Still => "still",
        }
    }

    /// What it is, for the table.
    pub fn label(self) -> &'static str {
        match self {
            Self::Single => "one real view",
            Self::Real => "real views",
            Self::Auto => "real views, family not told",
            Self::WithLva => "imagined views, with L_va",
            Self::WithoutLva => "imagined views, without L_va",
            Self::Plain => "imagined views, squared residuals alone",
            Self::Time => "bent coordinates, merged time features",
            Self::Bending => "bent coordinates alone",
            Self::Still => "no encoding of time",
        }
    }

    /// Whether it reconstructs; it fits a temporal field otherwise.
    pub fn reconstructs(self) -> bool {
        !matches!(self, Self::Time | Self::Bending | Self::Still)
    }
}

/// What all cells share.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AblationSettings {
    /// Number of the camera that stays real; the first if not given.
    pub primary: Option<i64>,
    /// How the other views are imagined.
    pub perturbation: Perturbation,
    /// The reconstructions, and the fits of the temporal field.
    pub config: Config,
}

/// What came out of a cell.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CellResult {
    /// Parameters and components of the velocity by name, in SI units.
    pub estimates: BTreeMap<String, f64>,
    /// The ends of the 90 % intervals of those that have one.
    #[serde(default)]
    pub intervals: BTreeMap<String, [f64; 2]>,
    /// The family of materials, or name of a law, where it was found.
    #[serde(default)]
    pub family: String,
    /// Their errors, where the truth is known: decades for magnitudes, a share of the true one for the velocity.
    pub errors: BTreeMap<String, f64>,
    /// How well pictures agree with those that were filmed.
    pub quality: BTreeMap<String, f64>,
    /// Why there is nothing, if there is nothing.
    pub failed: Option<String>,
    /// How long it took \[s\].
    pub seconds: f64,
}

impl AblationSettings {
    /// The position of the camera that stays real.
    pub fn primary_of(&self, clip: &Clip) -> usize {
        clip.cameras.iter().position(|camera| Some(camera.id) == self.primary).unwrap_or(0)
    }

    /// Treats a clip as a cell says; a reconstruction goes on in `folder`, if it was begun there before.
    ///
    /// # Errors
    /// [`ErrorKind::Interrupted`] and [`ErrorKind::Io`]; a reconstruction that fails otherwise is a result, too.
    pub fn run(
        &self,
        cell: Cell,
        clip: &Clip,
        truth: Option<&Truth>,
        folder: &Path,
        progress: &Progress,
    ) -> Result<CellResult> {
        let since = Instant::now();
        let done = match cell.reconstructs() {
            true => self.identify(cell, clip, folder, progress),
            false => self.encode(cell, clip, progress),
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
