//! What happens in a film, for those who look at it: phases, track and a few pictures.

use std::ops::RangeInclusive;

use super::bounces::{Bounces, FreeFlight};
use super::image::Image;
use super::parabola::Parabola;

/// Standard deviation of an even distribution over one interval.
pub(crate) const WITHIN: f64 = 0.288_675_134_594_812_9;

/// What was understood of a film. Positions are in pixels of pictures of [`Story::size`]; times are real seconds
/// since the film's first picture.
#[derive(Debug, Clone, Default)]
pub struct Story {
    /// Number of pictures in the film, as far as it was read.
    pub count: usize,
    /// Width and height of the pictures to which positions refer.
    pub size: (usize, usize),
    /// Width and height of the pictures in the film.
    pub filmed: (usize, usize),
    /// Phases in the order of time. They may leave gaps, in which nothing is known.
    pub phases: Vec<Phase>,
    /// Where the object was seen, in the order of time.
    pub track: Vec<Sight>,
    /// Parabolas of the free flights.
    pub curves: Vec<Curve>,
    /// Free flights of the object and whether hits join them.
    pub flights: Vec<FreeFlight>,
    /// The longest contact for which the pictures leave room \[s\], if no two of them show one.
    pub contact: Option<f64>,
    /// What the flights tell of the hits, if the contacts are so short.
    pub bounces: Option<Bounces>,
    /// A few of the pictures, at most a dozen, in the order of time.
    pub snapshots: Vec<Snapshot>,
}

/// What the object does in a phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doing {
    /// It is held, or hangs.
    Held,
    /// It is in free flight.
    Flight,
    /// It touches the ground.
    Contact,
    /// It lies still.
    Rest,
}

impl Doing {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Held => "held",
            Self::Flight => "flight",
            Self::Contact => "contact",
            Self::Rest => "rest",
        }
    }
}

/// A phase of a film.
#[derive(Debug, Clone, PartialEq)]
pub struct Phase {
    /// What the object does.
    pub doing: Doing,
    /// Numbers of its first and last picture.
    pub frames: RangeInclusive<usize>,
    /// Time of its beginning, and its standard deviation \[s\].
    pub begin: (f64, f64),
    /// Time of its end, and its standard deviation \[s\].
    pub end: (f64, f64),
}

/// The object in one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Sight {
    /// Number of the picture.
    pub number: usize,
    /// Its time \[s\].
    pub seconds: f64,
    /// Centre of the object \[pixels\].
    pub middle: [f64; 2],
    /// Diameter of the object \[pixels\].
    pub across: f64,
}

/// A parabola `p(t) = p₀ + v (t − t₀) + a (t − t₀)² / 2` in the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Times of its beginning and end \[s\].
    pub seconds: [f64; 2],
    /// Time `t₀` \[s\].
    pub at: f64,
    /// Position `p₀` \[pixels\].
    pub place: [f64; 2],
    /// Velocity `v` \[pixels/s\].
    pub velocity: [f64; 2],
    /// Acceleration `a` \[pixels/s²\].
    pub acceleration: [f64; 2],
}

impl Curve {
    /// A parabola between two times, in pixels of `scale` to one of its own.
    pub(crate) fn of(path: &Parabola, seconds: [f64; 2], scale: f64) -> Self {
        let scaled = |vector: [f64; 2]| vector.map(|x| x * scale);
        Self {
            seconds,
            at: path.time,
            place: scaled(path.place),
            velocity: scaled(path.velocity),
            acceleration: scaled(path.acceleration),
        }
    }

    /// Position at a time \[pixels\].
    pub fn at(&self, seconds: f64) -> [f64; 2] {
        let t = seconds - self.at;
        [0, 1].map(|c| self.place[c] + t * (self.velocity[c] + 0.5 * t * self.acceleration[c]))
    }
}

/// A picture of the film.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// Number of the picture.
    pub number: usize,
    /// Its time \[s\].
    pub seconds: f64,
    /// The picture, of any size but of the film's shape.
    pub(crate) image: Image,
}
