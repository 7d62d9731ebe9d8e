//! A film read picture by picture, in the order of time, as often as wanted.
//!
//! Pictures are delivered shrunk: those of a video file leave ffmpeg at the size that is asked for. Only the few
//! pictures between the decoder and the reader are in memory, whatever the length of the film.

mod area;
mod blocks;
mod brightness;
mod capture;
mod drawn;
mod folder;
mod lens;
mod limits;
mod pictures;
mod probe;
mod stream;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};

pub(in crate::video::film) use self::area::{shrunk, within};

pub(in crate::video::film) use self::pictures::Pictures;
use super::pictures::Series;
use super::{RATES, ending};
use crate::runtime::progress::{Progress, Stage};

/// What a film says of itself.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::video::film) struct Info {
    /// Width and height as shown: turned as the file says, and with square pixels.
    pub size: (usize, usize),
    /// Width and height as stored, turned as the file says: what a program that ignores the shape of pixels sees.
    pub stored: (usize, usize),
    /// Number of pictures; that of a video file is what its header says.
    pub count: Option<usize>,
    /// Mean number of pictures per second of real time, any slow motion undone \[1/s\].
    pub rate: Option<f64>,
    /// Rate at which the camera recorded, if the file says so \[1/s\].
    pub capture_rate: Option<f64>,
    /// Resolution of the times \[s\].
    pub unit: f64,
    /// Whether the pictures, unless shrunk, have few colours, as in a GIF.
    pub few_colours: bool,
    /// Focal length as a share of the picture's diagonal, if the file states it.
    pub focal: Option<f64>,
    /// Messages about the file, one fact each.
    pub said: Vec<String>,
}

/// One run through a film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::video::film) struct Pass {
    /// Maximum length of the longer side of the delivered pictures \[pixels\]; pictures are never enlarged.
    pub longer: usize,
    /// Number of the first picture.
    pub first: usize,
    /// Number of the last picture; `None` for the film's last.
    pub last: Option<usize>,
    /// Steps between the numbers of the delivered pictures, at least 1.
    pub every: usize,
}

impl Pass {
    /// All pictures at this size.
    #[cfg(test)]
    pub fn whole(longer: usize) -> Self {
        Self { longer, first: 0, last: None, every: 1 }
    }

    /// Whether the picture of this number is delivered.
    fn wants(&self, number: usize) -> bool {
        number >= self.first && !self.is_over(number) && (number - self.first).is_multiple_of(self.every.max(1))
    }

    /// Whether the picture of this number comes after the last.
    fn is_over(&self, number: usize) -> bool {
        self.last.is_some_and(|last| number > last)
    }

    /// Number of pictures that are decoded at most for this pass.
    fn decoded(&self) -> usize {
        self.last.map_or(usize::MAX, |last| last.saturating_add(1))
    }
}

/// A film that can be passed over any number of times.
#[derive(Debug, Clone)]
pub(in crate::video::film) struct Source {
    path: PathBuf,
    info: Info,
    kind: Kind,
    /// Frame rate that replaces the film's times \[1/s\].
    fps: Option<f64>,
}

#[derive(Debug, Clone)]
enum Kind {
    Folder(Series),
    Drawn(drawn::Delays),
    Stream(stream::Decoding),
}

impl Source {
    /// Opens a GIF, a video file or a folder of pictures. With `fps`, picture `k` is of the time `k / fps`; otherwise
    /// the film's own times count, with the slow motion undone that the file states.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the cause and a remedy: a file that is damaged, empty or too large, that has no
    /// pictures or no times, or ffmpeg missing or too old; [`ErrorKind::Io`] for unreadable files.
    pub fn open(path: &Path, fps: Option<f64>) -> Result<Self> {
        let (mut info, kind) = match ending(path).as_str() {
            _ if path.is_dir() => folder::open(path)?,
            "gif" => drawn::open(path)?,
            _ => stream::open(path)?,
        };
        match fps {
            Some(fps) => {
                (info.rate, info.capture_rate) = (Some(fps), None);
                info.said.retain(|line| !line.starts_with(capture::TIME));
            }
            None if info.rate.is_none_or(|rate| !RATES.contains(&rate)) => return Err(timeless(path, info.rate)),
            None => {}
        }
        Ok(Self { path: path.to_path_buf(), info, kind, fps })
    }

    /// What the film says of itself.
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// A warning about damage that the passes so far came upon; to be asked for after a pass.
    pub fn heard(&self) -> Option<String> {
        if let Kind::Stream(decoding) = &self.kind { decoding.heard() } else { None }
    }

    /// Starts a pass.
    ///
    /// # Errors
    /// As [`Source::open`], and if the film ends before the first picture of the pass. The iterator gives the errors
    /// that occur later.
    pub fn pictures(&self, pass: Pass) -> Result<Pictures> {
        if self.info.count.is_some_and(|count| pass.first >= count) && !matches!(self.kind, Kind::Stream(_)) {
            return Err(absent(&self.path, pass.first, self.info.count));
        }
        let clock = pictures::Clock { path: self.path.clone(), fps: self.fps, before: None };
        let decoded: pictures::Decoded = match &self.kind {
            Kind::Folder(series) => folder::pass(&self.path, series, pass)?,
            Kind::Drawn(delays) => drawn::pass(&self.path, delays, pass)?,
            Kind::Stream(decoding) => stream::pass(&self.path, decoding, pass)?,
        };
        Ok(Pictures::new(decoded, clock))
    }

    /// A progress bar for a pass, to be given to [`Pictures::shown_on`].
    pub fn stage(&self, progress: &Progress, title: &str, pass: Pass) -> Stage {
        let total = self.info.count.unwrap_or(0).min(pass.decoded());
        progress.stage(title, if self.info.count.is_some() { total as u64 } else { 0 })
    }
}

fn timeless(path: &Path, rate: Option<f64>) -> Error {
    Error::new(ErrorKind::Input, "the film does not say how fast it is")
        .at(path.display())
        .found(rate.map_or("pictures without times".to_owned(), |rate| format!("{rate:e} frames per second")))
        .wanted("a frame rate: the fall of the object gives its size only together with time")
        .fix("give it as --fps 24, for example")
}

/// The film ends before the first wanted picture.
fn absent(path: &Path, first: usize, count: Option<usize>) -> Error {
    let found = match count {
        Some(0) | None if first == 0 => "no frame at all".to_owned(),
        Some(count) => format!("no frame {first} in the film, which has {count}"),
        None => format!("no frame {first} in the film"),
    };
    let fix =
        if first == 0 { "copy or export the film again" } else { "choose an earlier first frame (--first-frame)" };
    Error::new(ErrorKind::Input, "no frame is selected").at(path.display()).found(found).fix(fix)
}

/// A picture whose size differs from that of those before it.
fn uneven(path: &Path, number: usize, found: (usize, usize), wanted: (usize, usize)) -> Error {
    Error::new(ErrorKind::Input, "the frames of the film differ in size")
        .at(path.display())
        .found(format!("{} × {} pixels in frame {number}", found.0, found.1))
        .wanted(format!("{} × {} pixels, like the first", wanted.0, wanted.1))
        .fix("export all frames at one size")
}
