//! Films in which nothing can be measured, and what was found in them.

use std::path::Path;

use gradreel::{Error, ErrorKind};

use super::survey::Survey;
use super::survey::pass::Found;

/// Something falls, but hits nothing.
pub(super) fn no_contact(path: &Path, survey: &Survey) -> Error {
    let [low, high] = survey.diameter.interval_90().map(|x| 100.0 * x);
    let phases: Vec<String> = survey
        .phases
        .iter()
        .map(|phase| format!("{} in frames {}–{}", phase.doing.name(), phase.frames.start(), phase.frames.end()))
        .collect();
    Error::new(ErrorKind::Input, "the object falls, but the film does not show it hit anything")
        .at(path.display())
        .found(format!(
            "{}; an object {:.1} cm across ({low:.1} to {high:.1} cm), {:.2} m/s fast at the end",
            phases.join(", "),
            100.0 * survey.diameter.metres,
            survey.speed()
        ))
        .wanted("three frames of free fall, the contact with the ground, and what follows, in one film")
        .fix("film so that the ground is in the picture; the material shows only in the contact")
}

/// Displacement from which on a camera follows something \[share of the longer side\], and share of the pictures that
/// may not be aligned.
const FOLLOWS: (f64, f64) = (0.25, 0.2);

/// A camera that moves with the object, or so that its pictures cannot be aligned.
pub(super) fn moves(path: &Path, found: &Found, usable: bool) -> Option<Error> {
    let (most, lost) = found.camera;
    let follows = most > FOLLOWS.0;
    if usable && !follows {
        return None;
    }
    (follows || lost as f64 > FOLLOWS.1 * found.count as f64).then(|| {
        Error::new(ErrorKind::Input, "the camera moves with the object, or too fast")
            .at(path.display())
            .found(format!(
                "the background moves by {:.0} % of the picture; {lost} of {} frames could not be aligned with it",
                100.0 * most,
                found.count
            ))
            .wanted("a camera that stands still; a shaking hand is taken out")
            .fix("put the camera down, and let the object move through the picture; or choose frames in which it stands still (--first-frame, --frames)")
    })
}

/// Fewer objects fall than the number that was asked for.
pub(super) fn no_object(path: &Path, number: usize, found: &Found) -> Option<Error> {
    let sizes = found.survey.as_ref().map_or(&[][..], |survey| &survey.objects);
    if (1..=sizes.len()).contains(&number) {
        return None;
    }
    let all: Vec<String> = sizes.iter().map(|size| format!("{:.1} cm across", 100.0 * size.metres)).collect();
    let falls = if all.is_empty() { "nothing falls".to_owned() } else { all.join(", ") };
    Some(
        Error::new(ErrorKind::Input, "there is no such object in the film")
            .at("--object")
            .within(path.display())
            .found(format!("{number}; {falls}"))
            .wanted(format!("1 to {}", sizes.len().max(1)))
            .fix("leave it out for the largest of those that fall"),
    )
}

/// Nothing falls.
pub(super) fn no_fall(path: &Path, found: &Found) -> Error {
    if let Some(moves) = moves(path, found, false) {
        return moves;
    }
    let count = found.count;
    Error::new(ErrorKind::Input, "nothing falls freely in the film")
        .at(path.display())
        .found(format!("{count} frames, in which nothing moves on a parabola that bends downwards for four frames"))
        .wanted("an object that is let go, falls freely in a few frames at least, and hits the ground")
        .fix(
            "keep the camera still, film with more frames per second or from further away, or choose the frames of the \
             fall (--first-frame, --frames); give --fps if the film is slow motion",
        )
}
