//! Output of `gradreel check --json`.

use std::collections::BTreeMap;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use serde::Serialize;
use serde_json::{Value, json};

use crate::cli::output::say;
use crate::physics::NINETY;
use crate::report::film::{lengths, option_of};
use crate::runtime::memory;
use crate::video::{Bounces, Clip, Inventory, Phase, WARNING};

/// A clip in machine-readable form. Unknown values are `null`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(super) struct Seen {
    /// Its name.
    pub name: String,
    /// Path.
    pub path: String,
    /// Whether it can be reconstructed.
    pub ready: bool,
    /// Number of frames per camera.
    pub frames: usize,
    /// Number of the first frame.
    pub first_frame: Option<i64>,
    /// Number of cameras.
    pub cameras: usize,
    /// Width and height of the first camera's pictures \[pixels\].
    pub pixels: Option<[usize; 2]>,
    /// Frame rate \[1/s\].
    pub fps: Option<f64>,
    /// Distance of the object, for single-camera drops \[m\].
    pub distance_m: Option<f64>,
    /// Relative standard deviation of the distance.
    pub distance_deviation: Option<f64>,
    /// Size of the object at this distance \[m\].
    pub diameter_m: Option<f64>,
    /// Speed after a hit as a share of that before, where the contact is shorter than a frame.
    pub restitution: Option<f64>,
    /// The longest contact for which such a film leaves room \[s\].
    pub contact_below_s: Option<f64>,
    /// Number of ballistic frames.
    pub falling_frames: Option<usize>,
    /// Initial position, y up, with the ground at 0 \[m\].
    pub start_m: Option<[f64; 3]>,
    /// Initial velocity \[m/s\].
    pub velocity_m_per_s: Option<[f64; 3]>,
    /// Foreground source of each camera.
    pub foreground: Vec<String>,
    /// Assumptions made.
    pub assumptions: Vec<String>,
    /// Implausible values.
    pub warnings: Vec<String>,
    /// Problems that prevent a reconstruction.
    pub problems: Vec<String>,
    /// 90 % intervals of the fields of these names; of a velocity, one per axis.
    pub interval_90: BTreeMap<&'static str, Value>,
    /// What the object does in a film.
    pub phases: Vec<SeenPhase>,
    /// Number of pictures in a film.
    pub frames_of_film: Option<usize>,
    /// The assumptions, each with the options that replace it.
    pub assumed: Vec<Assumed>,
    /// Path of the page.
    pub page: Option<String>,
    /// Memory of the process at its peak \[MiB\].
    pub memory_mib: Option<f64>,
}

/// A phase of a film.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct SeenPhase {
    /// `held`, `flight`, `contact` or `rest`.
    pub kind: &'static str,
    /// Number of its first frame.
    pub first_frame: usize,
    /// Number of its last frame.
    pub last_frame: usize,
    /// Time of its beginning in the film \[s\].
    pub begin_s: f64,
    /// Time of its end in the film \[s\].
    pub end_s: f64,
    /// 90 % intervals of these times.
    pub interval_90: BTreeMap<&'static str, Value>,
}

/// An assumption.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Assumed {
    /// What is assumed.
    pub what: String,
    /// The options that replace it, if there are any.
    pub option: Option<&'static str>,
}

impl Seen {
    /// A usable clip.
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
            restitution: bounces(clip).map(|bounces| bounces.restitution.value),
            contact_below_s: bounces(clip).map(|bounces| bounces.contact),
            falling_frames: flight.map(|flight| flight.frames),
            start_m: flight.map(|flight| flight.centre),
            velocity_m_per_s: flight.map(|flight| flight.velocity),
            foreground: clip.foreground.iter().map(ToString::to_string).collect(),
            interval_90: intervals(clip),
            phases: clip.story.iter().flat_map(|story| story.phases.iter().map(SeenPhase::of)).collect(),
            frames_of_film: clip.story.as_ref().map(|story| story.count),
            assumed: assumptions.iter().map(|line| Assumed { what: line.clone(), option: option_of(line) }).collect(),
            assumptions,
            warnings,
            problems: vec![],
            page: None,
            memory_mib: None,
        }
    }

    /// A calibrated clip that can be opened, with any other problems that prevent a reconstruction.
    pub fn of_opened(clip: &Clip, inventory: &Inventory, path: &Path) -> Self {
        let ready = inventory.is_complete() && clip.frame_count() > 1;
        Self { ready, problems: inventory.problems.clone(), ..Self::of(clip, path) }
    }

    /// The inventory of a calibrated clip that cannot be opened.
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
        let seen = Self { memory_mib: memory::peak_mib(), ..self.clone() };
        let text = serde_json::to_string_pretty(&seen)
            .map_err(|e| Error::new(ErrorKind::Io, "cannot write what was seen as JSON").found(e))?;
        say!("{text}");
        Ok(())
    }
}

impl SeenPhase {
    fn of(phase: &Phase) -> Self {
        let within =
            |(seconds, deviation): (f64, f64)| json!([seconds - NINETY * deviation, seconds + NINETY * deviation]);
        Self {
            kind: phase.doing.name(),
            first_frame: *phase.frames.start(),
            last_frame: *phase.frames.end(),
            begin_s: phase.begin.0,
            end_s: phase.end.0,
            interval_90: BTreeMap::from([("begin_s", within(phase.begin)), ("end_s", within(phase.end))]),
        }
    }
}

/// What the flights of a film tell of its hits.
fn bounces(clip: &Clip) -> Option<&Bounces> {
    clip.story.as_ref()?.bounces.as_ref()
}

/// 90 % intervals of what is known of a film. The rate and the number of frames are taken as exact.
fn intervals(clip: &Clip) -> BTreeMap<&'static str, Value> {
    let mut known = BTreeMap::new();
    let Some(flight) = clip.flight.as_ref() else { return known };
    let rate = 1.0 / clip.frame_dt();
    known.insert("fps", json!([rate, rate]));
    known.insert("frames", json!([clip.frame_count(), clip.frame_count()]));
    known.insert("distance_m", json!(lengths(flight.distance, flight.deviation)));
    known.insert("diameter_m", json!(lengths(flight.diameter, flight.deviation)));
    if let Some(bounces) = bounces(clip) {
        known.insert("restitution", json!(bounces.restitution.interval_90()));
    }
    let deviations = flight.velocity_deviation();
    let axis = |k: usize| [-1.0, 1.0].map(|sign| flight.velocity[k] + sign * NINETY * deviations[k]);
    known.insert("velocity_m_per_s", json!([axis(0), axis(1), axis(2)]));
    known
}

/// Splits into warnings, without their prefix, and assumptions.
fn told(lines: &[String]) -> (Vec<String>, Vec<String>) {
    let warning = |line: &&String| line.starts_with(WARNING);
    let warnings = lines.iter().filter(warning).map(|line| line[WARNING.len()..].to_owned()).collect();
    (warnings, lines.iter().filter(|line| !warning(line)).cloned().collect())
}
