//! What `gradreel check --json` prints.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use serde::Serialize;

use crate::cli::output::say;
use crate::video::{Clip, Inventory, WARNING};

/// A clip as a program reads it. What is not known is `null`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(super) struct Seen {
    /// Its name.
    pub name: String,
    /// Where it is.
    pub path: String,
    /// Whether a reconstruction can begin with it.
    pub ready: bool,
    /// Frames of each camera.
    pub frames: usize,
    /// Number of the first frame.
    pub first_frame: Option<i64>,
    /// Cameras.
    pub cameras: usize,
    /// Width and height of the first camera's pictures \[pixels\].
    pub pixels: Option<[usize; 2]>,
    /// Frames per second \[1/s\].
    pub fps: Option<f64>,
    /// How far away the object is, where a single camera saw it fall \[m\].
    pub distance_m: Option<f64>,
    /// The standard deviation of that, as a share of it.
    pub distance_deviation: Option<f64>,
    /// How large the object is then \[m\].
    pub diameter_m: Option<f64>,
    /// Frames of free fall.
    pub falling_frames: Option<usize>,
    /// Where it is first, y up, the ground at 0 \[m\].
    pub start_m: Option<[f64; 3]>,
    /// How fast it is there \[m/s\].
    pub velocity_m_per_s: Option<[f64; 3]>,
    /// What tells the object from the background, camera by camera.
    pub foreground: Vec<String>,
    /// What had to be assumed.
    pub assumptions: Vec<String>,
    /// What is hardly so.
    pub warnings: Vec<String>,
    /// What keeps it from being used.
    pub problems: Vec<String>,
}

impl Seen {
    /// A clip that is ready.
    pub fn of(clip: &Clip, path: &Path) -> Self {
        let flight = clip.flight.as_ref();
        let (warnings, assumptions) = told(&clip.assumptions);
        Self {
            name: clip.name.clone(),
            path: path.display().to_string(),
            ready: true,
            frames: clip.frame_count(),
            first_frame: clip.frame_numbers.first().copied(),
            cameras: clip.cameras.len(),
            pixels: clip.cameras.first().map(|camera| [camera.width, camera.height]),
            fps: Some(1.0 / clip.frame_dt()).filter(|rate| rate.is_finite()),
            distance_m: flight.map(|flight| flight.distance),
            distance_deviation: flight.map(|flight| flight.deviation),
            diameter_m: flight.map(|flight| flight.diameter),
            falling_frames: flight.map(|flight| flight.frames),
            start_m: flight.map(|flight| flight.centre),
            velocity_m_per_s: flight.map(|flight| flight.velocity),
            foreground: clip.foreground.iter().map(ToString::to_string).collect(),
            assumptions,
            warnings,
            problems: vec![],
        }
    }

    /// A calibrated clip that can be opened, and what else keeps a reconstruction from it.
    pub fn of_opened(clip: &Clip, inventory: &Inventory, path: &Path) -> Self {
        let ready = inventory.is_complete() && clip.frame_count() > 1;
        Self { ready, problems: inventory.problems.clone(), ..Self::of(clip, path) }
    }

    /// What the folder of a calibrated clip holds that cannot be opened.
    pub fn of_inventory(inventory: &Inventory, path: &Path) -> Self {
        let cameras = &inventory.cameras;
        let (warnings, assumptions) = told(&inventory.assumptions);
        Self {
            name: inventory.name.clone(),
            path: path.display().to_string(),
            ready: inventory.is_complete(),
            frames: cameras.iter().map(|camera| camera.usable.len()).max().unwrap_or(0),
            first_frame: cameras.iter().filter_map(|camera| camera.usable.first().copied()).min(),
            cameras: cameras.len(),
            pixels: cameras.first().and_then(|camera| camera.size).map(|(width, height)| [width, height]),
            fps: inventory.frame_dt.map(|dt| 1.0 / dt).filter(|rate| rate.is_finite()),
            foreground: cameras.iter().filter_map(|camera| camera.foreground).map(|f| f.to_string()).collect(),
            assumptions,
            warnings,
            problems: inventory.problems.clone(),
            ..Self::default()
        }
    }

    /// A clip that cannot be used.
    pub fn refused(path: &Path, error: &Error) -> Self {
        let name = path.file_stem().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Self { name, path: path.display().to_string(), problems: vec![error.to_string()], ..Self::default() }
    }

    /// Prints it.
    pub fn print(&self) -> Result<()> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|e| Error::new(ErrorKind::Io, "cannot write what was seen as JSON").found(e))?;
        say!("{text}");
        Ok(())
    }
}

/// Warnings, without the word, and assumptions.
fn told(lines: &[String]) -> (Vec<String>, Vec<String>) {
    let warning = |line: &&String| line.starts_with(WARNING);
    let warnings = lines.iter().filter(warning).map(|line| line[WARNING.len()..].to_owned()).collect();
    (warnings, lines.iter().filter(|line| !warning(line)).cloned().collect())
}
