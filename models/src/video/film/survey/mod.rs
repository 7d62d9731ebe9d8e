//! What happens in a film: the object, its free flights and contacts.
//!
//! Small pictures of the whole film are compared with the empty scene ([`background`]) and with each other; what
//! differs falls into [`components`]. Among their positions [`search`] finds free flights: nothing else moves on a
//! downward parabola in time. [`chain`] collects the flights of one object, [`track`] the hits between them and the
//! way afterwards. [`choose`] takes the part of the film to use, and [`metres`] the scale: gravity is the same in
//! all flights.

mod background;
mod brief;
mod chain;
mod choose;
mod components;
mod flight;
mod metres;
mod objects;
pub(in crate::video::film) mod pass;
mod phases;
mod place;
pub(in crate::video::film) mod register;
mod search;
mod sequence;
mod tell;
#[cfg(test)]
mod tests;
mod track;

use self::background::Background;
use self::chain::chains;
use self::components::Component;
pub(in crate::video::film) use self::metres::Size;
use self::register::Motion;
use self::search::Scene;
pub(in crate::video::film) use self::sequence::Sequence;
use self::track::Track;
use crate::video::story::Phase;

/// Sizes of objects that are looked for \[m\].
const SIZES: std::ops::RangeInclusive<f64> = 0.005..=3.0;

/// Sizes that a wrong frame rate makes of objects \[m\]: lengths go with the square of the interval.
const MISJUDGED: [std::ops::RangeInclusive<f64>; 2] = [3.0..=300.0, 5e-5..=0.005];

/// Evidence at which a chain of flights of such a size counts.
const MISJUDGED_SCORE: f64 = 25.0;

/// Number of pixels of a surveyed picture.
pub(in crate::video::film) const PIXELS: f64 = 65_000.0;

/// Evidence at which a chain of flights counts.
const LEAST_SCORE: f64 = 4.0;

/// What was understood of a film.
pub(in crate::video::film) struct Survey {
    /// Width and height of the surveyed pictures.
    pub size: [usize; 2],
    /// Numbers and times of the surveyed pictures.
    pub numbers: Vec<usize>,
    pub times: Vec<f64>,
    /// The components of each.
    pub pieces: Vec<Vec<Component>>,
    /// Pictures that show most of the background together.
    pub spread: Vec<usize>,
    pub track: Track,
    pub phases: Vec<Phase>,
    /// The part to use, if there is a contact.
    pub run: Option<choose::Run>,
    pub diameter: Size,
    /// Sizes of all that fall together; the one that is used, unless another is asked for, comes first.
    pub objects: Vec<Size>,
    /// How the camera moves, if it does.
    pub motion: Option<Motion>,
}

/// Surveys pictures, which become those of a camera at rest; `None` if nothing falls freely. `object` is the place among those that fall
/// together, 0 for the object by itself, which also stands in for one that is missing.
pub(in crate::video::film) fn survey(sequence: &mut Sequence, motion: Option<Motion>, object: usize) -> Option<Survey> {
    if sequence.pictures.len() < choose::LEAST_FREE + 1 {
        return None;
    }
    if let Some(motion) = &motion {
        motion.undo(sequence);
    }
    let background = Background::of(sequence);
    let pieces = components::all(sequence, &background);
    let scene = Scene { pieces: &pieces, times: &sequence.times };
    let falling = |sizes: &std::ops::RangeInclusive<f64>, least: f64| {
        let flights = scene.flights(sizes);
        let clear = chains(&scene, &flights).into_iter().filter(|chain| chain.score >= least).collect();
        objects::apart(&scene, clear)
    };
    let mut objects = falling(&SIZES, LEAST_SCORE);
    for sizes in &MISJUDGED {
        if objects.is_empty() {
            objects = falling(sizes, MISJUDGED_SCORE).into_iter().filter(|(chain, _)| chain.links.len() > 1).collect();
        }
    }
    let sizes = objects.iter().map(|(_, size)| *size).collect();
    let chosen = if object < objects.len() { object } else { 0 };
    let (chain, diameter) = (!objects.is_empty()).then(|| objects.swap_remove(chosen))?;
    let track = Track::of(&scene, chain);
    let run = choose::run(&scene, &track);
    let phases = phases::of(&scene, &track, &sequence.numbers);
    Some(Survey {
        size: [sequence.width, sequence.height],
        numbers: sequence.numbers.clone(),
        times: sequence.times.clone(),
        spread: background::spread(sequence),
        track,
        phases,
        run,
        diameter,
        objects: sizes,
        pieces,
        motion,
    })
}

impl Survey {
    /// A flight with its acceleration.
    pub fn link(&self, flight: usize) -> &chain::Link {
        &self.track.chain.links[flight]
    }

    /// Diameter of the disc that the object covers in a flight \[pixels\].
    pub fn disc(&self, flight: usize) -> f64 {
        let scene = Scene { pieces: &self.pieces, times: &self.times };
        metres::width(&scene, &self.link(flight).flight).0
    }

    /// Time of the first position of a flight \[s\].
    pub fn time_of_first(&self, flight: usize) -> f64 {
        self.times[self.link(flight).flight.first()] - 1e-9
    }
}
