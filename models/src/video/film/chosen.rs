//! The pictures of a film that are used, and those that show the background beside them.

use std::collections::BTreeSet;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};

use super::source::{Pass, Source, shrunk, within};
use super::survey::register::warped;
use super::survey::{self, Survey};
use super::{FilmSettings, refuse};
use crate::runtime::progress::Progress;
use crate::video::clip::OpenOptions;
use crate::video::image::Image;
use crate::video::story::{Snapshot, Story};

/// Longer side of the pictures \[pixels\], and the largest that small objects are given.
const SIDE: (usize, usize) = (640, 1920);

/// Number of their pixels, unless small objects need more.
const AREA: f64 = 640.0 * 400.0;

/// Maximum number of pixels of all pictures; mattes and frames made of them take some 24 bytes a pixel.
const MOST_PIXELS: f64 = (1 << 24) as f64;

/// Least diameter of the object in them \[pixels\].
const LEAST_ACROSS: f64 = 24.0;

/// Number of pictures that a fit needs at most; films with more are thinned in time.
const MOST: usize = 40;

/// Films of at most this many pictures are used from the first picture on.
const SHORT: usize = 24;

/// Number of pictures that can be asked for.
const MOST_ASKED: usize = 240;

/// Pictures in memory with what the survey says of them.
pub(super) struct Chosen {
    /// Width of the pictures.
    pub width: usize,
    /// The pictures, until their mattes are known.
    pub images: Vec<Image>,
    /// Number of each in the film.
    pub numbers: Vec<usize>,
    /// Time of each \[s\].
    pub times: Vec<f64>,
    /// Further pictures that show the background, with their numbers.
    pub beside: Vec<(usize, Image)>,
    /// Number of pictures in the film, as far as it was read.
    pub count: usize,
    /// Width and height in the film.
    pub size: (usize, usize),
    /// Whether the pictures have few colours, as in a GIF.
    pub few_colours: bool,
    /// What the survey found, if anything falls.
    pub survey: Option<Survey>,
    /// Messages.
    pub said: Vec<String>,
}

/// Number of pictures that a page shows, and their longer side \[pixels\].
const SHOWN: (usize, usize) = (12, 480);

impl Chosen {
    /// What happens in the film, with some of the pictures.
    pub fn story(&self) -> Story {
        let mut story = Story {
            count: self.count,
            size: (self.images[0].width, self.images[0].height),
            filmed: self.size,
            snapshots: self.snapshots(),
            ..Story::default()
        };
        if let (Some(survey), Some(scale)) = (&self.survey, self.scale()) {
            survey.told_in(&mut story, scale);
        }
        story
    }

    /// Some of the pictures, evenly spread.
    fn snapshots(&self) -> Vec<Snapshot> {
        let count = self.images.len().min(SHOWN.0);
        let index = |k: usize| if count > 1 { k * (self.images.len() - 1) / (count - 1) } else { 0 };
        let one = |k: usize| {
            let image = &self.images[k];
            let size = within((image.width, image.height), SHOWN.1);
            Snapshot { number: self.numbers[k], seconds: self.times[k], image: shrunk(image.clone(), size) }
        };
        (0..count).map(|k| one(index(k))).collect()
    }

    /// Pixels of the pictures in a pixel of the survey.
    pub fn scale(&self) -> Option<f64> {
        self.survey.as_ref().map(|survey| self.width as f64 / survey.size[0] as f64)
    }
}

/// Surveys a film and reads the pictures to use.
///
/// # Errors
/// Those of the source, and [`ErrorKind::Input`] for a film without a fall or a contact, unless the options or the
/// settings say what to use.
pub(super) fn read(path: &Path, source: &Source, settings: &FilmSettings, options: &OpenOptions) -> Result<Chosen> {
    let progress = Progress::new(!options.progress);
    let first = options.first_frame.unwrap_or(0);
    let Ok(first) = usize::try_from(first) else {
        return Err(Error::new(ErrorKind::Input, "no frame is selected")
            .at(path.display())
            .found(format!("frame {first} as the first"))
            .wanted("a number from 0 on: the frames of a film are counted from there")
            .fix("choose another first frame (--first-frame)"));
    };
    let given = options.first_frame.is_some() || options.max_frames.is_some();
    let last = options.max_frames.filter(|_| options.first_frame.is_some()).map(|count| first + count.max(1) - 1);
    let object = settings.object.unwrap_or(1).saturating_sub(1);
    let mut found = survey::pass::of(source, first, last, object, &progress)?;
    if let Some(missing) = settings.object.and_then(|number| refuse::no_object(path, number, &found)) {
        return Err(missing);
    }
    // a film that was cut to the fall is used as it is
    if found.count <= SHORT && settings.object.is_none() {
        found.survey = None;
    }
    let lenient = given || settings.masks.is_some() || settings.matting.is_some();
    let run = found.survey.as_ref().and_then(|survey| survey.run);
    let (from, to) = match (&found.survey, run) {
        (Some(survey), Some(run)) if options.first_frame.is_none() => {
            (survey.numbers[run.first], survey.numbers[run.last])
        }
        (Some(survey), Some(run)) => (first, survey.numbers[run.last].max(first)),
        // of a short film the fit itself tells whether it begins with a fall
        (Some(survey), None) if !lenient && found.count > first + MOST => {
            return Err(refuse::no_contact(path, survey));
        }
        (None, None) if !lenient && found.count > first + MOST => return Err(refuse::no_fall(path, &found)),
        _ => (first, found.count.saturating_sub(1).max(first)),
    };
    let (to, every) = match options.max_frames {
        Some(count) => (from + count.max(1) - 1, 1),
        None => (to, (to + 1 - from).div_ceil(MOST)),
    };
    if (to - from) / every >= MOST_ASKED {
        return Err(Error::new(ErrorKind::Input, "too many frames are asked for")
            .at(path.display())
            .found(format!("{} frames", (to - from) / every + 1))
            .wanted(format!("at most {MOST_ASKED}"))
            .fix("choose fewer (--frames), or leave it out: the film is thinned to what the fit needs"));
    }
    if let Some(moves) = refuse::moves(path, &found, run.is_some() || lenient) {
        return Err(moves);
    }
    let wanted: BTreeSet<usize> = (from..=to).step_by(every).collect();
    // without a contact the survey may have taken something else for the object
    let survey = found.survey.filter(|survey| survey.run.is_some());
    let beside: BTreeSet<usize> = survey
        .iter()
        .flat_map(|survey| survey.spread.iter().map(|k| survey.numbers[*k]))
        .filter(|number| !wanted.contains(number) && !given)
        .collect();
    let longer = longer(source, survey.as_ref(), wanted.len() + beside.len() / 4);
    let begin = wanted.first().copied().unwrap_or(from).min(beside.first().copied().unwrap_or(from));
    let end = to.max(beside.last().copied().unwrap_or(to));
    let pass = Pass { longer, first: begin, last: Some(end), every: 1 };
    let mut chosen = Chosen {
        width: 0,
        images: vec![],
        numbers: vec![],
        times: vec![],
        beside: vec![],
        count: found.count,
        size: source.info().size,
        few_colours: false,
        survey,
        said: source.info().said.clone(),
    };
    for picture in source.pictures(pass)?.shown_on(source.stage(&progress, "reading the fall", pass)) {
        let mut picture = picture?;
        if let Some(map) = chosen.survey.as_ref().and_then(|survey| survey.map(picture.number)) {
            let image = &mut picture.image;
            image.pixels = warped(&image.pixels, image.width, image.height, &map);
        }
        if wanted.contains(&picture.number) {
            chosen.numbers.push(picture.number);
            chosen.times.push(picture.seconds);
            chosen.images.push(picture.image);
        } else if beside.contains(&picture.number) {
            chosen.beside.push((picture.number, picture.image));
        }
    }
    chosen.said.extend(source.heard());
    let Some(image) = chosen.images.first() else {
        return Err(Error::new(ErrorKind::Input, "no frame is selected")
            .at(path.display())
            .found(format!("no frame {from} in the film"))
            .fix("choose an earlier first frame"));
    };
    let (width, height) = (image.width, image.height);
    chosen.width = width;
    chosen.few_colours = source.info().few_colours && (width, height) == chosen.size;
    if (width, height) != chosen.size {
        let (across, down) = chosen.size;
        chosen.said.push(format!("pictures of {across} × {down} pixels are shrunk to {width} × {height}"));
    }
    if every > 1 {
        chosen.said.push(format!("one frame in {every} is used: the fit needs no more"));
    }
    if found.camera.0 > 0.0 {
        chosen.said.push(format!(
            "camera: it moves by up to {:.1} % of the picture; the background was aligned to take that out",
            100.0 * found.camera.0
        ));
    }
    if found.camera.1 > 0 {
        chosen.said.push(format!("camera: {} frames could not be aligned with the others", found.camera.1));
    }
    if let Some(survey) = &chosen.survey {
        chosen.said.extend(survey.said(found.count));
    }
    Ok(chosen)
}

/// Longer side of `count` pictures in which the object is large enough, as far as memory allows.
fn longer(source: &Source, survey: Option<&Survey>, count: usize) -> usize {
    let (width, height) = source.info().size;
    let enough = survey.map_or(0.0, |survey| LEAST_ACROSS / survey.width() * survey.size[0].max(survey.size[1]) as f64);
    let area = (width * height) as f64;
    let usual = (SIDE.0 as f64).min((AREA / area).sqrt() * width.max(height) as f64).round() as usize;
    let bound = (MOST_PIXELS / (count.max(1) as f64 * area)).sqrt() * width.max(height) as f64;
    usual.max(enough.ceil() as usize).min(SIDE.1).min(width.max(height)).min((bound as usize).max(1))
}

/// Least number of frames of free fall.
pub(super) const LEAST: usize = crate::video::clip::Flight::LEAST_FRAMES;
