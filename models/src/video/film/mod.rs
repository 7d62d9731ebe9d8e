//! Films: a GIF, a video file or a folder of pictures, from one camera of which nothing is known.

mod backdrop;
mod corrected;
mod gif;
mod grain;
mod lens;
mod lost;
mod matting;
mod network;
mod onnx;
mod pictures;
mod resample;
mod runtime;
mod stream;

use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use self::matting::Found;
pub use self::network::MattingSettings;
use super::clip::{Frame, OpenOptions};
use super::foreground::Foreground;
use super::image::Image;
use super::layout::Format;

/// Endings of the files that are given to ffmpeg.
const VIDEOS: [&str; 12] = ["mp4", "mov", "m4v", "mkv", "webm", "avi", "mpg", "mpeg", "ogv", "wmv", "3gp", "ts"];

/// Most bytes of decoded pictures.
const MOST_BYTES: usize = 1 << 30;

/// What is known of a film besides its pictures; what is not given is read from the file or assumed, and said.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FilmSettings {
    /// Frame rate \[1/s\]; 0 takes the file's.
    pub frames_per_s: f64,
    /// Angle of view along the image's longer side \[degrees\]; 0 takes what the file says of its lens, or 50.
    pub field_of_view: f64,
    /// How far the camera looks down \[degrees\]; if not given, found with the free fall, starting from 10.
    pub elevation: Option<f64>,
    /// A folder with a mask for each frame, white where the object is.
    pub masks: Option<PathBuf>,
    /// A picture of the background without the object.
    pub background: Option<PathBuf>,
    /// A network that tells the object from the background.
    pub matting: Option<MattingSettings>,
}

impl FilmSettings {
    /// Whether the values make sense.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the first that does not.
    pub fn check(&self) -> Result<()> {
        let rules = [
            (
                self.frames_per_s == 0.0 || (0.1..=1e6).contains(&self.frames_per_s),
                "frames_per_s",
                "0, or 0.1 to 1e6 1/s",
            ),
            (
                self.field_of_view == 0.0 || (1.0..=150.0).contains(&self.field_of_view),
                "field_of_view",
                "0, or 1 to 150 degrees",
            ),
            (self.elevation.is_none_or(|e| (-85.0..=85.0).contains(&e)), "elevation", "-85 to 85 degrees"),
            (
                [self.masks.is_some(), self.background.is_some(), self.matting.is_some()]
                    .iter()
                    .filter(|x| **x)
                    .count()
                    <= 1,
                "masks",
                "one of masks, background and matting",
            ),
        ];
        let of_matting = self.matting.iter().flat_map(MattingSettings::rules);
        match rules.into_iter().chain(of_matting).find(|(holds, ..)| !holds) {
            None => Ok(()),
            Some((_, name, wanted)) => {
                Err(Error::new(ErrorKind::Input, format!("the setting clip.film.{name} is outside its range"))
                    .at(format!("clip.film.{name}"))
                    .wanted(wanted)
                    .fix("correct it in the file of --config or on the command line, or leave it out"))
            }
        }
    }
}

/// A film in memory, the object alone on white.
#[derive(Debug, Clone)]
pub struct Film {
    /// The file's name without its ending, or the folder's.
    pub name: String,
    /// The pictures.
    pub frames: Vec<Frame>,
    /// In films of few colours whose object is told by difference: the pictures with those parts, too, that have the hue of the
    /// background. While the object is in the air they are its own; when it has met its shadow they may be that.
    pub hueless: Option<Vec<Frame>>,
    /// Number of the first one in the film.
    pub first: usize,
    /// Their rate \[1/s\].
    pub frames_per_s: f64,
    /// The focal length as a share of the pictures' diagonal, if the film says.
    pub focal: Option<f64>,
    /// What tells the object from the background.
    pub foreground: Foreground,
    /// What had to be assumed.
    pub assumptions: Vec<String>,
}

/// Pictures as they were decoded.
struct Decoded {
    images: Vec<Image>,
    /// Frame rate that the file states \[1/s\].
    frames_per_s: Option<f64>,
    /// Whether it is a GIF: pictures have few colours, and delays are whole hundredths of a second.
    few_colours: bool,
}

/// Which pictures are decoded: so many from this one on.
#[derive(Clone, Copy)]
struct Wanted {
    first: usize,
    count: usize,
}

impl Film {
    /// Whether a path is a film: a GIF or video file, or a folder of pictures without a list of cameras.
    pub fn is_at(path: &Path) -> bool {
        if path.is_dir() {
            return Format::ALL.iter().all(|format| !format.is_at(path))
                && !pictures::list(path).unwrap_or_default().is_empty();
        }
        path.is_file() && (ending(path) == "gif" || VIDEOS.contains(&ending(path).as_str()))
    }

    /// Decodes a film and finds the object in every picture.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] with the file concerned and a way out for a film that is damaged, too large, has fewer frames than
    /// asked for, or in which nothing tells the object from the background; [`ErrorKind::Io`] for files that cannot be read.
    pub fn read(path: &Path, settings: &FilmSettings, options: &OpenOptions) -> Result<Self> {
        settings.check()?;
        let wanted = Wanted {
            first: options.first_frame.map_or(0, |first| first.max(0) as usize),
            count: options.max_frames.unwrap_or(usize::MAX),
        };
        let mut decoded = match ending(path).as_str() {
            _ if path.is_dir() => pictures::read(path, wanted)?,
            "gif" => gif::read(path, wanted)?,
            _ => stream::read(path, wanted)?,
        };
        if decoded.images.is_empty() {
            return Err(Error::new(ErrorKind::Input, "no frame is selected")
                .at(path.display())
                .found(format!("no frame {} in the film", wanted.first))
                .fix("choose an earlier first frame"));
        }
        let mut assumptions = Vec::new();
        let frames_per_s = match (settings.frames_per_s, decoded.frames_per_s) {
            (0.0, Some(rate)) => {
                let delay = 100.0 / rate;
                let cut_off = match decoded.few_colours && (delay - delay.round()).abs() < 1e-9 {
                    true => format!(
                        " (it counts whole hundredths of a second: more than {:.4} may be meant)",
                        100.0 / (delay + 1.0)
                    ),
                    false => String::new(),
                };
                assumptions.push(format!(
                    "time: {rate:.4} frames per second, as the file says{cut_off}; give --fps if it is slow motion"
                ));
                rate
            }
            (0.0, None) => {
                return Err(Error::new(ErrorKind::Input, "the film does not say how fast it is")
                    .at(path.display())
                    .wanted("a frame rate: the fall of the object gives its size only together with time")
                    .fix("give it as --fps 24, for example"));
            }
            (rate, _) => rate,
        };
        if let Some(smooth) = grain::removed(&decoded.images) {
            assumptions.push("the grain of the pictures is that of a palette of few colours: it was smoothed".into());
            decoded = Decoded { images: smooth, few_colours: false, ..decoded };
        }
        let Found { foreground, frames, hueless, lost, said } = matting::frames(path, &decoded, settings, wanted)?;
        assumptions.push(format!("the object is told from the background by {foreground}"));
        assumptions.extend(said);
        if !lost.is_empty() {
            let numbers: Vec<String> = lost.iter().map(|k| (wanted.first + k).to_string()).collect();
            assumptions.push(format!("nothing in frame {} counts: the object was not found there", numbers.join(", ")));
        }
        let name = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        let name = name.file_stem().map_or_else(|| "film".into(), |name| name.to_string_lossy().into_owned());
        let focal = if ending(path) == "gif" { None } else { lens::focal(path) };
        Ok(Self { name, frames, hueless, first: wanted.first, frames_per_s, focal, foreground, assumptions })
    }
}

fn ending(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// Refuses pictures that would not fit into the memory set aside.
fn check_bytes(path: &Path, width: usize, height: usize, count: usize) -> Result<()> {
    let bytes = width.saturating_mul(height).saturating_mul(4 * count.max(1));
    if width > 0 && height > 0 && bytes <= MOST_BYTES {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "the film is too large")
        .at(path.display())
        .found(format!("{count} frames of {width} × {height} pixels"))
        .wanted(format!("at most {} MiB of decoded pictures", MOST_BYTES >> 20))
        .fix("take fewer frames (--first-frame, --frames), or export the film smaller: 480 pixels are plenty"))
}
