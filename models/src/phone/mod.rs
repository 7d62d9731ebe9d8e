//! Films as phones make them: a scene with a hand, waiting, shake, blur and the like, and its truth beside it.
//!
//! [`scenes`] draws what falls, a [`Degradation`] changes the scene or the [`plan`] of its film; [`motion`] simulates it,
//! [`picture`] exposes each picture and [`encode`] writes the file.

mod degradation;
mod encode;
mod hand;
mod motion;
mod picture;
mod plan;
mod scenery;
pub(crate) mod scenes;
mod truth;

use std::path::Path;

use gradreel::{Key, Result};

pub(crate) use self::degradation::Degradation;
use self::encode::Encoder;
use self::motion::Motion;
use self::picture::Studio;
use self::plan::Plan;
#[cfg(test)]
pub(crate) use self::truth::Contact;
pub(crate) use self::truth::Truth;
use crate::runtime::interrupt;
use crate::runtime::progress::Progress;
use crate::scenes::SceneFile;

/// Films a scene into a video file and writes its truth beside it, as JSON of the same name.
///
/// Files that the scene names are relative to `folder`. The first camera of the scene's `film` is that of the phone. The same key
/// makes the same film.
///
/// # Errors
/// [`ErrorKind::Input`](gradreel::ErrorKind::Input) for a scene that cannot be simulated or filmed, or without ffmpeg;
/// [`ErrorKind::Physics`](gradreel::ErrorKind::Physics) where the simulation breaks down.
pub(crate) fn film(
    file: &SceneFile,
    folder: &Path,
    degradations: &[Degradation],
    key: Key,
    out: &Path,
    progress: &Progress,
) -> Result<Truth> {
    let mut file = file.clone();
    let mut settings = file.film.take().unwrap_or_default();
    settings.cameras = 1;
    for degradation in degradations {
        degradation.change(&mut file, &mut settings, key);
    }
    let plan = Plan::new(&file, degradations, key);
    let motion = Motion::simulate(&file, folder, &settings, progress)?;
    let studio = Studio::new(&motion, &plan, key);
    let truth = Truth::of(&file, &motion, &plan, &studio, degradations)?;
    let mut encoder = Encoder::new(out, settings.pixels, &plan)?;
    let stage = progress.stage("filming", plan.times.len() as u64);
    for number in 0..plan.times.len() {
        interrupt::check().map_err(|error| error.fix("begin again: a film takes seconds to minutes"))?;
        encoder.add(&studio.picture(number)?)?;
        stage.set(number as u64 + 1, "");
    }
    encoder.finish()?;
    stage.finish(&out.display().to_string());
    truth.write(&out.with_extension("json"))?;
    Ok(truth)
}
