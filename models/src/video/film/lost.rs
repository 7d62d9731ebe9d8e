//! Frames of a film in which the object was not found.

use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use ndarray::{Array2, Array3};

use super::median::median;
use crate::video::clip::{Flight, Frame};
use crate::video::foreground::Foreground;
use crate::video::matte::Matte;

/// A frame has lost the object if its silhouette area is below this share of the typical area.
const LOST: f64 = 0.25;

/// At most one frame in this many may be lost, and none of the first frames, which show the ballistic phase.
const ONE_IN: usize = 8;

/// The same of a film whose survey knows where the object is: at most one in so many.
const ONE_IN_SURVEYED: usize = 2;

/// Numbers of the frames whose silhouette is much smaller than usual: a flash, a hand, a failed matte.
///
/// # Errors
/// [`ErrorKind::Input`] if there are too many, or if one of the first frames is among them.
pub(super) fn frames(
    path: &Path,
    mattes: &[Matte],
    foreground: Foreground,
    numbers: &[usize],
    surveyed: bool,
) -> Result<Vec<usize>> {
    let areas: Vec<usize> = mattes.iter().map(|(_, alpha)| alpha.iter().filter(|a| **a > 0.5).count()).collect();
    let usual = median(&mut areas.clone());
    let least = ((LOST * usual as f64) as usize).max(16);
    let lost: Vec<usize> = (0..areas.len()).filter(|&k| areas[k] < least).collect();
    let few = match surveyed {
        true => lost.len() <= areas.len() / ONE_IN_SURVEYED,
        false => lost.len() <= areas.len() / ONE_IN && lost.first().is_none_or(|first| *first >= Flight::LEAST_FRAMES),
    };
    let Some(&k) = lost.first().filter(|_| !few) else { return Ok(lost) };
    let still = foreground == Foreground::Still;
    Err(Error::new(ErrorKind::Input, "the object cannot be told from the background")
        .at(format!("{}, frame {}", path.display(), numbers[k]))
        .found(format!(
            "{} pixels of an object, {usual} in other frames; it is told by {foreground}; {} of {} frames are like that",
            areas[k],
            lost.len(),
            areas.len()
        ))
        .wanted(format!(
            "an object that is in the first {} frames, and at most one in {ONE_IN} others without it",
            Flight::LEAST_FRAMES
        ))
        .fix(if still {
            "give a picture of the background without the object (--background FILE), masks (--masks FOLDER) or a matting network \
             (--matting FILE); without them the camera must stand still, and the object must leave every place once"
        } else {
            "choose the frames that show it (--first-frame, --frames), or give masks (--masks FOLDER)"
        }))
}

/// A frame with zero weight everywhere.
pub(super) fn nothing(width: usize, height: usize) -> Frame {
    Frame {
        rgb: Array3::ones((height, width, 3)),
        alpha: Array2::zeros((height, width)),
        weight: Array2::zeros((height, width)),
    }
}
