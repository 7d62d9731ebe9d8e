//! Films in which nothing can be measured, and what was found in them.

use std::path::Path;

use gradreel::{Error, ErrorKind};

use super::survey::Survey;

/// Something falls, but hits nothing.
pub(super) fn no_contact(path: &Path, survey: &Survey) -> Error {
    let [low, high] = survey.diameter.interval_90().map(|x| 100.0 * x);
    let phases: Vec<String> = survey
        .phases
        .iter()
        .map(|span| format!("{:?} in frames {}–{}", span.phase, span.frames[0], span.frames[1]).to_lowercase())
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

/// Nothing falls.
pub(super) fn no_fall(path: &Path, count: usize) -> Error {
    Error::new(ErrorKind::Input, "nothing falls freely in the film")
        .at(path.display())
        .found(format!("{count} frames, in which nothing moves on a parabola that bends downwards for four frames"))
        .wanted("an object that is let go, falls freely in a few frames at least, and hits the ground")
        .fix(
            "keep the camera still, film with more frames per second or from further away, or choose the frames of the \
             fall (--first-frame, --frames); give --fps if the film is slow motion",
        )
}
