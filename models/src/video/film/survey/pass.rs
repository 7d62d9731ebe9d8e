//! The pass over a film that surveys it, part by part, so that memory does not grow with its length.

use gradreel::Result;

use super::register::Motion;
use super::{PIXELS, Sequence, Survey, survey};
use crate::runtime::progress::Progress;
use crate::video::film::source::{Pass, Source};

/// Pictures per second that are surveyed at most.
const RATE: f64 = 75.0;

/// Number of pictures of a part, and of those that two parts share.
const PART: (usize, usize) = (600, 120);

/// A first picture that is shown for more than this many usual intervals is held before the film begins.
const HELD: f64 = 3.0;

/// What a pass found.
pub(in crate::video::film) struct Found {
    /// The first part with a contact, or else the one with the clearest flight.
    pub survey: Option<Survey>,
    /// Number of pictures that were seen.
    pub count: usize,
    /// Largest displacement of the camera \[share of the longer side\], and number of pictures that could not be aligned.
    pub camera: (f64, usize),
}

/// Surveys a film from a picture on, for the object at this place among those that fall together.
///
/// # Errors
/// Those of the source.
pub(in crate::video::film) fn of(
    source: &Source,
    first: usize,
    last: Option<usize>,
    object: usize,
    progress: &Progress,
) -> Result<Found> {
    let info = source.info();
    let pixels = (info.size.0 * info.size.1) as f64;
    let shrink = (PIXELS / pixels).sqrt().min(1.0);
    let longer = ((info.size.0.max(info.size.1) as f64 * shrink).round() as usize).max(1);
    let every = info.rate.map_or(1, |rate| (rate / RATE).ceil().max(1.0) as usize);
    let pass = Pass { longer, first, last, every };
    let mut part = Sequence::default();
    let mut found = Found { survey: None, count: 0, camera: (0.0, 0) };
    for picture in source.pictures(pass)?.shown_on(source.stage(progress, "looking for a fall", pass)) {
        let picture = picture?;
        found.count = picture.number + 1;
        part.push(picture.number, picture.seconds, &picture.image);
        if part.pictures.len() == PART.0 {
            let shared = part.last(PART.1);
            if found.add(part, object) {
                return Ok(found);
            }
            part = shared;
        }
    }
    found.add(part, object);
    Ok(found)
}

impl Found {
    /// Surveys a part, and keeps what it shows if that is better than what is known; whether there is a contact.
    fn add(&mut self, mut part: Sequence, object: usize) -> bool {
        part.begin_with_motion(HELD);
        let motion = Motion::of(&part);
        if let Some(motion) = &motion {
            self.camera = (self.camera.0.max(motion.most), self.camera.1 + motion.lost.len());
        }
        better(&mut self.survey, survey(&mut part, motion, object))
    }
}

/// Keeps the better of two; whether it has a contact.
fn better(best: &mut Option<Survey>, new: Option<Survey>) -> bool {
    let worth =
        |survey: &Option<Survey>| survey.as_ref().map_or((false, 0.0), |s| (s.run.is_some(), s.track.chain.score));
    if worth(&new) > worth(best) {
        *best = new;
    }
    worth(best).0
}
