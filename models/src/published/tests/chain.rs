//! The whole chain on models of the published layout, interrupted and gone on with.

use std::path::Path;

use gradreel::ErrorKind;
use serde_json::Value;

use super::scene::{VELOCITY, film, sizes, weights};
use crate::identify::{Config, Reconstruction, Run};
use crate::published::{Chain, Origin, Placing, Stage, State};
use crate::runtime::progress::Progress;
use crate::runtime::run_folder::RunFolder;
use crate::video::Clip;
use crate::views::FileWeights;

/// Frames of the film: it lands in the last but one.
const FRAMES: usize = 10;

fn config() -> Config {
    Config::parse(
        "[clip]\nshrink = 2\n[geometry]\ndx = 0.08\n[geometry.fit]\niterations = 4\n[weights]\nimagined_colour = 0.0\n\
         [published]\nsteps = 2\nguidance = 1.0\nfield = 60\nrays = 192\nnodes = 4000\nvelocity = 3\nstarts = 2\nmaterial = 3\n",
    )
    .unwrap()
}

/// Runs the chain in a folder, on a disk that is full after so many writes if that is said.
fn run(
    clip: &Clip,
    folder: &Path,
    weights: &FileWeights,
    writes: Option<u64>,
) -> gradreel::Result<(Reconstruction, State)> {
    let limited = |folder: RunFolder| match writes {
        Some(writes) => folder.failing_after(writes),
        None => folder,
    };
    let mut run = match folder.join("config.toml").is_file() {
        true => {
            let mut run = Run::open(limited(RunFolder::open(folder)?))?;
            run.go_on(clip)?;
            run
        }
        false => Run::create(limited(RunFolder::create(folder)?), config(), clip)?,
    };
    let origin = Origin::Film { weights, fingerprint: "tiny", boxes: None };
    Chain::new(&mut run, origin, &Progress::new(true), true)?.finish(clip)
}

/// What a run has found: its states without times.
fn found(folder: &Path) -> (Value, Value) {
    let read = |name: &str| serde_json::from_slice::<Value>(&std::fs::read(folder.join(name)).unwrap()).unwrap();
    let mut published = read("published.json");
    for stage in published["finished"].as_array_mut().unwrap() {
        stage["seconds"] = Value::Null;
    }
    (read("state.json"), published)
}

#[test]
fn a_model_without_a_module_runs_to_the_end() {
    let (folder, weights) = weights("plain", &sizes(false));
    let clip = film(FRAMES);
    let (found, state) = run(&clip, &folder.join("out"), &weights, None).unwrap();
    assert_eq!(state.placing, Some(Placing::Moved));
    assert_eq!(state.finished.iter().map(|done| done.stage).collect::<Vec<_>>(), Stage::ALL);
    assert_eq!(found.clip.cameras.len(), 5, "one filmed, four imagined");
    assert_eq!(found.clip.imagined, [false, true, true, true, true]);
    assert!(!found.particles.is_empty());
    let motion = state.motion.unwrap();
    // coordinates follow the boxes: even views of noise do not lose the fall
    assert!((motion.velocity[1] - VELOCITY[1]).abs() < 0.5, "{:?}", motion.velocity);
    assert!(state.answers[&Stage::Material].len() > 3);
    std::fs::remove_dir_all(folder).unwrap();
}

/// Between any two writes: within the views of a frame, within the field, within a search, and between stages.
#[test]
fn killed_between_writes() {
    let (folder, weights) = weights("killed", &sizes(true));
    let clip = film(FRAMES);
    let whole = folder.join("whole");
    let (_, state) = run(&clip, &whole, &weights, None).unwrap();
    assert_eq!(state.placing, Some(Placing::Module));
    let wanted = found(&whole);
    let mut last = 0;
    for writes in [2, 4, 5, 6, 9, 23, 40, 52, 54, 55, 56, 57, 58, 60, 63, 66] {
        let place = folder.join(format!("after-{writes}"));
        match run(&clip, &place, &weights, Some(writes)) {
            Ok(_) => break,
            Err(error) => assert_eq!(error.kind(), ErrorKind::Io, "{error}"),
        }
        run(&clip, &place, &weights, None).unwrap();
        assert!(found(&place) == wanted, "after {writes} writes: {:#} instead of {:#}", found(&place).1, wanted.1);
        last = writes;
        std::fs::remove_dir_all(place).unwrap();
    }
    assert!(last >= 55, "it was over after {last} writes");
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn other_weights_are_refused() {
    let (folder, weights) = weights("other", &sizes(false));
    let clip = film(3);
    let out = folder.join("out");
    assert!(run(&clip, &out, &weights, Some(6)).is_err());
    let mut begun = Run::open(RunFolder::open(&out).unwrap()).unwrap();
    let origin = Origin::Film { weights: &weights, fingerprint: "another", boxes: None };
    let error = Chain::new(&mut begun, origin, &Progress::new(true), true).err().unwrap();
    assert_eq!(error.kind(), ErrorKind::Input);
    assert!(error.to_string().contains("weights changed"), "{error}");
    std::fs::remove_dir_all(folder).unwrap();
}
