//! The pictures of one pass with their times.

use std::path::PathBuf;

use gradreel::{Error, ErrorKind, Result};

use crate::runtime::interrupt;
use crate::runtime::progress::Stage;
use crate::video::image::Image;

/// One picture of a film.
#[derive(Debug, Clone)]
pub(in crate::video::film) struct Picture {
    /// Number in the film, from 0.
    pub number: usize,
    /// Real time since the film's first picture \[s\].
    pub seconds: f64,
    /// The picture, shrunk as the pass asks.
    pub image: Image,
}

/// A picture as its decoder yields it; `seconds` is the film's own time, if it has any.
pub(super) struct Undated {
    pub number: usize,
    pub seconds: Option<f64>,
    pub image: Image,
}

/// What a decoder yields.
pub(super) type Decoded = Box<dyn Iterator<Item = Result<Undated>> + Send>;

/// Dates pictures.
pub(super) struct Clock {
    pub path: PathBuf,
    /// Frame rate that replaces the film's times \[1/s\].
    pub fps: Option<f64>,
    /// Number and time of the picture before.
    pub before: Option<(usize, f64)>,
}

/// The pictures of one pass, in the order of time. Dropping it ends the decoder. After an error there are no more.
pub(in crate::video::film) struct Pictures {
    decoded: Option<Decoded>,
    clock: Clock,
    stage: Option<Stage>,
}

impl Pictures {
    pub(super) fn new(decoded: Decoded, clock: Clock) -> Self {
        Self { decoded: Some(decoded), clock, stage: None }
    }

    /// Shows the number of the pictures that were read on `stage`, which ends with the pass.
    #[must_use]
    pub fn shown_on(self, stage: Stage) -> Self {
        Self { stage: Some(stage), ..self }
    }
}

impl Iterator for Pictures {
    type Item = Result<Picture>;

    fn next(&mut self) -> Option<Self::Item> {
        let decoded = self.decoded.as_mut()?;
        let next = decoded.next().map(|next| {
            interrupt::check()?;
            self.clock.date(next?)
        });
        match (&next, &self.stage) {
            (Some(Ok(picture)), Some(stage)) => stage.set(picture.number as u64 + 1, ""),
            (None, Some(_)) => {
                if let Some(stage) = self.stage.take() {
                    stage.finish("");
                }
            }
            _ => {}
        }
        if !matches!(next, Some(Ok(_))) {
            self.decoded = None;
        }
        next
    }
}

impl Clock {
    /// Gives a picture its time.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if it has none, or one that is not after that of the picture before.
    fn date(&mut self, Undated { number, seconds, image }: Undated) -> Result<Picture> {
        let seconds = match self.fps {
            Some(fps) => Some(number as f64 / fps),
            None => seconds.filter(|seconds| seconds.is_finite()),
        };
        let stuck = |found: String| {
            Error::new(ErrorKind::Input, "the times of the film do not advance from frame to frame")
                .at(self.path.display())
                .found(found)
                .wanted("a later time for each frame: the fall of the object gives its size only together with time")
                .fix("give the frame rate as --fps 24, for example, or export the film again")
        };
        let Some(seconds) = seconds else { return Err(stuck(format!("no time for frame {number}"))) };
        if let Some((other, before)) = self.before.filter(|(_, before)| *before >= seconds) {
            return Err(stuck(format!("frame {other} at {before:.4} s, frame {number} at {seconds:.4} s")));
        }
        self.before = Some((number, seconds));
        Ok(Picture { number, seconds, image })
    }
}
