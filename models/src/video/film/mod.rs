//! Films: a GIF, a video file or a folder of pictures from one uncalibrated camera.

mod backdrop;
mod chosen;
mod corrected;
mod grain;
mod holds;
mod lost;
mod matting;
mod median;
mod network;
mod objects;
mod onnx;
mod pace;
mod pictures;
mod plate;
mod refuse;
mod resample;
mod runtime;
mod source;
mod survey;
mod window;

use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use self::holds::Even;
use self::matting::Found;
pub use self::network::MattingSettings;
use self::pace::{Clock, Pace};
use self::source::Source;
use super::clip::{Frame, OpenOptions};
use super::foreground::Foreground;
use super::layout::Format;
use super::shutter::Shutter;
use super::story::Story;

/// Extensions of the files that ffmpeg decodes.
const VIDEOS: [&str; 19] = [
    "mp4", "mov", "m4v", "qt", "mkv", "webm", "avi", "mpg", "mpeg", "ogv", "wmv", "asf", "flv", "3gp", "3g2", "ts",
    "mts", "m2ts", "apng",
];

/// Accepted frame rates \[1/s\].
const RATES: std::ops::RangeInclusive<f64> = 0.1..=1e6;

/// Accepted exposures, and times from one row to the next \[s\].
pub(crate) const EXPOSURES: std::ops::RangeInclusive<f64> = 0.0..=10.0;
pub(crate) const ROW_TIMES: std::ops::RangeInclusive<f64> = -1e-3..=1e-3;

/// Known properties of a film. Missing values are read from the file, or assumed and reported.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FilmSettings {
    /// Frame rate \[1/s\]; 0 uses the file's.
    pub frames_per_s: f64,
    /// Angle of view along the image's longer side \[degrees\]; 0 uses the file's metadata, or else 50.
    pub field_of_view: f64,
    /// Downward pitch of the camera \[degrees\]; if not given, fitted jointly with the free fall, starting from 10.
    pub elevation: Option<f64>,
    /// Of several objects that fall together the one to use: 1 for the largest, which is used by itself, 2 for the next.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object: Option<usize>,
    /// A folder with one mask per frame, white on the object.
    pub masks: Option<PathBuf>,
    /// A background plate: a picture without the object.
    pub background: Option<PathBuf>,
    /// A network that segments the object.
    pub matting: Option<MattingSettings>,
    /// How a contact that is shorter than a frame is treated.
    pub contact: ContactModel,
    /// How long a picture is exposed \[s\]; found from the free fall if not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f64>,
    /// Time from one row of the picture to the next \[s\], negative where it is read from below; found from the free fall if not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub row_time: Option<f64>,
}

/// How the contact with the ground is treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum ContactModel {
    /// By its restitution where it is shorter than the time between two pictures, simulated elsewhere.
    #[default]
    Auto,
    /// Simulated, whatever the film shows of it.
    Resolved,
}

impl FilmSettings {
    /// The shutter as far as it is known: what is not is no time.
    pub fn shutter(&self) -> Shutter {
        Shutter { exposure: self.exposure.unwrap_or(0.0), row_time: self.row_time.unwrap_or(0.0) }
    }

    /// Checks that all values are within their ranges.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the first that is not.
    pub fn check(&self) -> Result<()> {
        let rules = [
            (self.frames_per_s == 0.0 || RATES.contains(&self.frames_per_s), "frames_per_s", "0, or 0.1 to 1e6 1/s"),
            (
                self.field_of_view == 0.0 || (1.0..=150.0).contains(&self.field_of_view),
                "field_of_view",
                "0, or 1 to 150 degrees",
            ),
            (self.elevation.is_none_or(|e| (-85.0..=85.0).contains(&e)), "elevation", "-85 to 85 degrees"),
            (self.object != Some(0), "object", "1 or more"),
            (self.exposure.is_none_or(|s| EXPOSURES.contains(&s)), "exposure", "0 to 10 s"),
            (self.row_time.is_none_or(|s| ROW_TIMES.contains(&s)), "row_time", "-1 to 1 ms"),
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
    /// Name of the file without its extension, or of the folder.
    pub name: String,
    /// The pictures.
    pub frames: Vec<Frame>,
    /// For films of few colours segmented by difference: the frames with those parts included whose hue equals the
    /// background's. During free flight these parts belong to the object; after contact they may be its shadow.
    pub hueless: Option<Vec<Frame>>,
    /// Number of each of `frames` in the film.
    pub numbers: Vec<usize>,
    /// Real time of each \[s\].
    pub times: Vec<f64>,
    /// The chosen free fall.
    pub(crate) scale: Option<Scale>,
    /// Frame rate \[1/s\].
    pub frames_per_s: f64,
    /// One in so many frames of the file is used.
    pub(crate) every: usize,
    /// Focal length as a share of the picture's diagonal, if the file states it.
    pub focal: Option<f64>,
    /// Foreground source.
    pub foreground: Foreground,
    /// Assumptions made.
    pub assumptions: Vec<String>,
    /// What happens in the film, as far as it is known before its metres; its snapshots at least.
    pub story: Story,
}

/// Range of pictures to decode.
#[derive(Clone, Copy)]
struct Wanted {
    first: usize,
    count: usize,
}

impl Film {
    /// Whether `path` is a film: a GIF or video file, or a folder of pictures without a camera list.
    pub fn is_at(path: &Path) -> bool {
        if path.is_dir() {
            return Format::ALL.iter().all(|format| !format.is_at(path)) && pictures::are_in(path);
        }
        path.is_file() && Self::is_name(path)
    }

    /// Whether `path` has the extension of a GIF or video file.
    pub(crate) fn is_name(path: &Path) -> bool {
        ending(path) == "gif" || VIDEOS.contains(&ending(path).as_str())
    }

    /// Decodes a film and segments the object in every picture.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the file and a remedy for a film that is damaged or too large, has fewer frames
    /// than requested, or offers no way to segment the object; [`ErrorKind::Io`] for unreadable files.
    pub fn read(path: &Path, settings: &FilmSettings, options: &OpenOptions) -> Result<Self> {
        settings.check()?;
        let source = Source::open(path, Some(settings.frames_per_s).filter(|rate| *rate > 0.0))?;
        let mut chosen = chosen::read(path, &source, settings, options)?;
        let every = chosen.numbers.get(1).map_or(1, |second| second - chosen.numbers[0]);
        let shown = chosen.times.clone();
        let clock = Clock { shown, until: None, unit: source.info().unit };
        let (interval, pace, mut assumptions) = time(path, settings, every, &clock)?;
        assumptions.append(&mut chosen.said);
        let story = chosen.story();
        // a palette of few colours is one of a GIF, or of pictures made from one
        let palette = source.info().few_colours || path.is_dir();
        if let Some(smooth) = Some(()).filter(|()| palette).and_then(|()| grain::removed(&chosen.images)) {
            assumptions.push("the grain of the pictures is that of a palette of few colours: it was smoothed".into());
            let (numbers, beside): (Vec<_>, Vec<_>) = chosen.beside.drain(..).unzip();
            let beside = grain::removed(&beside).unwrap_or(beside);
            chosen.beside = numbers.into_iter().zip(beside).collect();
            (chosen.images, chosen.few_colours) = (smooth, false);
        }
        let Found { foreground, mut frames, mut hueless, mut lost, said } =
            matting::frames(path, &mut chosen, settings)?;
        assumptions.push(format!("the object is told from the background by {foreground}"));
        assumptions.extend(said);
        // a run begins with a picture that shows the object
        let begin = (0..frames.len()).find(|k| !lost.contains(k)).unwrap_or(0);
        if begin > 0 {
            frames.drain(..begin);
            hueless.iter_mut().for_each(|hueless| drop(hueless.drain(..begin)));
            chosen.numbers.drain(..begin);
            chosen.times.drain(..begin);
            lost = lost.into_iter().filter(|k| *k >= begin).map(|k| k - begin).collect();
        }
        let mut numbers = chosen.numbers.clone();
        numbers.truncate(frames.len());
        let mut times = chosen.times[..frames.len()].to_vec();
        if !lost.is_empty() {
            let lost: Vec<String> = lost.iter().map(|k| numbers[*k].to_string()).collect();
            assumptions.push(format!("nothing in frame {} counts: the object was not found there", lost.join(", ")));
        }
        let scale = Scale::of(&chosen, frames.len());
        if let Some(pace) = pace {
            let mut even = Even::of(&frames, &pace, &numbers);
            if even.is_change(frames.len()) {
                hueless = hueless.map(|hueless| even.frames(&hueless));
                frames = even.frames(&frames);
                assumptions.append(&mut even.said);
                numbers = (0..frames.len()).map(|k| numbers[0] + k).collect();
                times = (0..frames.len()).map(|k| times[0] + k as f64 * interval).collect();
            }
        }
        let name = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        let name = name.file_stem().map_or_else(|| "film".into(), |name| name.to_string_lossy().into_owned());
        Ok(Self {
            name,
            frames,
            hueless,
            numbers,
            times,
            scale,
            frames_per_s: 1.0 / interval,
            every,
            focal: source.info().focal,
            foreground,
            assumptions,
            story,
        })
    }
}

/// What the survey says of the chosen frames, for the fit of the free fall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scale {
    /// Number of frames before the contact.
    pub free: usize,
    /// Downward acceleration in the picture \[pixels/s²\], with its relative standard deviation.
    pub acceleration: [f64; 2],
    /// Diameter of the disc that the object covers \[pixels\].
    pub across: f64,
    /// Diameter by all free flights \[m\], with its relative standard deviation.
    pub diameter: [f64; 2],
    /// The same for a camera that is known to be level.
    pub level: [f64; 2],
}

impl Scale {
    /// That of a film of which `count` frames are left; `None` without a surveyed contact among them.
    fn of(chosen: &chosen::Chosen, count: usize) -> Option<Self> {
        let (survey, scale) = (chosen.survey.as_ref()?, chosen.scale()?);
        let run = survey.run?;
        let link = survey.link(run.flight);
        let begin = survey.time_of_first(run.flight);
        let times = &chosen.times[..count];
        // parabolas meet in the middle of a contact, which has begun before
        let before = |margin: f64| times.iter().filter(|time| **time < run.hit.time - margin).count();
        let interval = (times[times.len() - 1] - times[0]) / (times.len() - 1).max(1) as f64;
        let free = before(0.5 * interval).max(before(0.0).min(chosen::LEAST));
        (times[0] >= begin && free >= chosen::LEAST).then_some(Self {
            free,
            acceleration: [scale * link.acceleration, link.deviation],
            across: scale * survey.disc(run.flight),
            diameter: [survey.diameter.metres, survey.diameter.deviation],
            level: survey.diameter.level,
        })
    }
}

/// The interval between used frames \[s\], the number of intervals per frame if the film has display times, and messages.
/// Of the film's frames one in `every` is used.
fn time(path: &Path, settings: &FilmSettings, every: usize, clock: &Clock) -> Result<(f64, Option<Pace>, Vec<String>)> {
    if settings.frames_per_s > 0.0 {
        return Ok((every as f64 / settings.frames_per_s, None, vec![]));
    }
    let unknown = |found: &str| {
        Error::new(ErrorKind::Input, "the film does not say how fast it is")
            .at(path.display())
            .found(found)
            .wanted("a frame rate: the fall of the object gives its size only together with time")
            .fix("give it as --fps 24, for example")
    };
    let pace = match clock.pace() {
        Some(pace) if RATES.contains(&(1.0 / pace.interval)) => pace,
        Some(pace) => return Err(unknown(&format!("frames {:e} s apart", pace.interval))),
        None if clock.shown.len() < 2 => return Err(unknown("a single frame")),
        None => return Err(unknown("times that do not advance from frame to frame")),
    };
    let interval = pace.interval / every as f64;
    let rate = 1.0 / interval;
    let delay = interval / clock.unit;
    let cut_off = match clock.unit > 0.005 && (delay - delay.round()).abs() < 1e-6 {
        true => format!(
            " (it counts whole hundredths of a second: more than {:.4} may be meant)",
            1.0 / (clock.unit * (delay + 1.0))
        ),
        false => String::new(),
    };
    let mut said =
        vec![format!("time: {rate:.4} frames per second, as the file says{cut_off}; give --fps if it is slow motion")];
    if pace.off > 0.0 {
        said.push(format!(
            "time: frames are uneven, up to {:.4} s off this rate from one to the next",
            pace.off * pace.interval
        ));
    }
    Ok((pace.interval, Some(pace), said))
}

fn ending(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default()
}
