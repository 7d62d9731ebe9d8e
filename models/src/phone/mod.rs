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
        go_on()?;
        encoder.add(&studio.picture(number)?)?;
        stage.set(number as u64 + 1, "");
    }
    encoder.finish()?;
    stage.finish(&out.display().to_string());
    truth.write(&out.with_extension("json"))?;
    Ok(truth)
}

/// Whether the film may go on: an error where it was interrupted.
fn go_on() -> Result<()> {
    interrupt::check().map_err(|error| error.fix("begin again: a film takes seconds to minutes"))
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// A scene that is simulated in no time.
    fn small() -> SceneFile {
        let mut file = scenes::scene(Key::new(5));
        file.grid.spacing_m *= 2.5;
        file.time.duration_s = 0.2;
        if let Some(film) = &mut file.film {
            film.pixels = [96, 64];
        }
        file
    }

    /// The first picture of a film as ffmpeg shows it, and the times of all.
    fn shown(film: &Path) -> (Vec<u8>, Vec<f64>) {
        let run = |program: &str, arguments: &[&str]| {
            let output = Command::new(program).args(["-v", "error"]).args(arguments).output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            output.stdout
        };
        let name = film.to_str().unwrap();
        let first = run("ffmpeg", &["-i", name, "-frames:v", "1", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]);
        let times = run("ffprobe", &["-show_entries", "frame=best_effort_timestamp_time", "-of", "csv=p=0", name]);
        let times = String::from_utf8(times).unwrap();
        let times = times.lines().map(|line| line.trim_end_matches(',')).filter(|line| !line.is_empty());
        (first, times.map(|line| line.parse().unwrap()).collect())
    }

    /// What is shown is what was seen, at the times at which it was seen, upright too.
    #[test]
    fn films_show_what_was_seen() {
        if Command::new("ffmpeg").arg("-version").output().is_err() {
            assert!(std::env::var_os("CI").is_none(), "CI has ffmpeg");
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let kinds = [vec![], vec![Degradation::Portrait, Degradation::VariableRate, Degradation::MovingShadows]];
        for (number, degradations) in kinds.into_iter().enumerate() {
            let out = folder.path().join(format!("{number}.mp4"));
            let key = Key::new(9);
            let truth = film(&small(), Path::new("."), &degradations, key, &out, &Progress::new(true)).unwrap();
            assert!(out.with_extension("json").is_file());
            let mut file = small();
            let mut settings = file.film.take().unwrap();
            degradations.iter().for_each(|one| one.change(&mut file, &mut settings, key));
            let plan = Plan::new(&file, &degradations, key);
            let motion = Motion::simulate(&file, Path::new("."), &settings, &Progress::new(true)).unwrap();
            let seen = Studio::new(&motion, &plan, key).picture(0).unwrap();
            let (first, times) = shown(&out);
            assert_eq!(first.len(), seen.len());
            let off: f64 = first.iter().zip(&seen).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
            assert!(off / (seen.len() as f64) < 8.0, "{degradations:?}: {} levels", off / seen.len() as f64);
            let wanted: Vec<f64> = truth.times_s.iter().map(|time| time - truth.times_s[0]).collect();
            assert_eq!(times.len(), wanted.len());
            assert!(times.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 2e-3), "{times:?} for {wanted:?}");
        }
    }

    /// A hand is before the background where it holds the object, and a longer exposure blurs what falls.
    #[test]
    fn degradations_are_seen() {
        let last = |degradations: &[Degradation]| {
            let mut file = small();
            let settings = file.film.take().unwrap();
            let key = Key::new(2);
            let plan = Plan::new(&file, degradations, key);
            let motion = Motion::simulate(&file, Path::new("."), &settings, &Progress::new(true)).unwrap();
            Studio::new(&motion, &plan, key).picture(plan.times.len() - 1).unwrap()
        };
        let clean = last(&[]);
        assert_eq!(clean, last(&[]));
        let kinds = [Degradation::Blur, Degradation::RollingShutter, Degradation::Shake, Degradation::MovingShadows];
        for degradation in kinds.into_iter().chain([Degradation::HandRelease]) {
            let other = last(&[degradation]);
            let changed = clean.iter().zip(&other).filter(|(a, b)| a.abs_diff(**b) > 8).count();
            assert!(changed > 10, "{degradation:?}: {changed} bytes");
        }
    }
}
