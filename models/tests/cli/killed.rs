//! kill −9: whenever it comes, the run that goes on ends as one that was never interrupted.

use std::fs;
use std::path::Path;
use std::process::{Child, Command};
use std::time::Duration;

use gradreel::ErrorKind;
use gradreel_models::identify::{Config, Run, reconstruct};
use gradreel_models::runtime::progress::Progress;
use gradreel_models::runtime::run_folder::RunFolder;
use gradreel_models::video::{Clip, OpenOptions};
use serde_json::Value;

use crate::scene::{Scene, bundled, text};

/// Fits long enough to be saved half-way, searches of a few evaluations.
const TINY: &str = "[clip]\nshrink = 12\n[geometry]\ndx = 0.12\n[geometry.fit]\niterations = 7\nin_motion = 7\n\
                    [estimate]\nvelocity = 1\npoints = 1\nsurvivors = 1\nsteps = 1\n";

/// What a run has found: everything in its state but how long it took, what it has settled, and its voxels.
fn found(folder: &Path) -> (Value, Vec<u8>) {
    let mut state: Value = serde_json::from_slice(&fs::read(folder.join("state.json")).unwrap()).unwrap();
    state.as_object_mut().unwrap().remove("seconds");
    state["config"] = fs::read_to_string(folder.join("config.toml")).unwrap().into();
    (state, fs::read(folder.join("field.safetensors")).unwrap())
}

/// Runs on a disk that is full after so many writes, if that is said; whether the end was reached.
fn run(clip: &Clip, folder: &Path, config: &Config, writes: Option<u64>) -> bool {
    let limited = |folder: RunFolder| match writes {
        Some(writes) => folder.failing_after(writes),
        None => folder,
    };
    let run = match folder.join("config.toml").is_file() {
        true => Run::open(RunFolder::open(folder).unwrap()).and_then(|mut run| run.go_on(clip).map(|()| run)),
        false => RunFolder::create(folder).and_then(|folder| Run::create(limited(folder), config.clone(), clip)),
    };
    match run.and_then(|mut run| reconstruct(clip, &mut run, &Progress::new(true))) {
        Ok(_) => true,
        Err(error) if writes.is_some() => {
            assert_eq!(error.kind(), ErrorKind::Io, "{error}");
            false
        }
        Err(error) => panic!("{error}"),
    }
}

/// Whether a run has finished a stage whose name ends so.
fn has_finished((state, _): &(Value, Vec<u8>), end: &str) -> bool {
    state["finished"].as_array().unwrap().iter().any(|stage| stage.as_str().unwrap().ends_with(end))
}

/// Between any two writes, of which none leaves half a file behind; returns what a run finds that is not interrupted.
fn killed_between_writes(tiny: &str, material: &str, moments: impl Iterator<Item = u64>) -> (Value, Vec<u8>) {
    let scene = Scene::new();
    let options = OpenOptions { cameras: Some(vec![0, 3]), max_frames: Some(7), ..OpenOptions::default() };
    let clip = Clip::open(&bundled(), &options).unwrap();
    assert!(!clip.assumptions.is_empty(), "they are not lost, either");
    let config = Config::parse(&format!("{tiny}[material]\nname = '{material}'\n")).unwrap();
    let whole = scene.path("whole");
    assert!(run(&clip, &whole, &config, None));
    let wanted = found(&whole);
    let mut last = 0;
    for writes in moments {
        let folder = scene.path(&format!("after-{writes}"));
        if run(&clip, &folder, &config, Some(writes)) {
            break;
        }
        assert!(run(&clip, &folder, &config, None));
        let again = found(&folder);
        assert!(
            again == wanted,
            "{material}, interrupted after {writes} writes: {:#} instead of {:#}",
            again.0,
            wanted.0
        );
        last = writes;
    }
    assert!(last > 25, "it was over after {last} writes");
    wanted
}

#[test]
fn between_writes_of_a_shape_that_does_not_help() {
    // steps so long that the material which moves with the shape becomes worse
    let tiny = TINY.replace("in_motion = 7", "in_motion = 7\nmaterial_rate = 1.0");
    let whole = killed_between_writes(&tiny, "elastic", (8..).step_by(4));
    assert!(has_finished(&whole, "undone"), "{:#}", whole.0);
}

#[test]
fn between_writes_of_a_choice_of_family() {
    let whole = killed_between_writes(TINY, "auto", (8..).step_by(7));
    assert_eq!(whole.0["standings"].as_array().unwrap().len(), 5);
    assert!(has_finished(&whole, "posterior") && whole.0["survivors"].is_object(), "{:#}", whole.0);
}

#[test]
fn between_writes_of_a_pool() {
    // all of the first fit, and some of every stage after it
    let whole = killed_between_writes(TINY, "elastic", (0..8).chain((8..).step_by(5)));
    assert_eq!(whole.0["surveys"].as_array().unwrap().len(), 1);
    assert!(whole.0["marginals"]["young"].is_object(), "{:#}", whole.0);
    // the shape that was fitted with its motion is kept where it is more probable
    let cost = |stage: &str| whole.0["survivors"][stage][0]["cost"].as_f64().unwrap();
    let [held, followed] = ["shape in motion 1: agreement", "shape and material 1: agreement"].map(cost);
    assert_eq!(has_finished(&whole, "shape and material 1: undone"), followed >= held, "{followed} after {held}");
    // what flows keeps no shape that could be fitted with its motion
    let flowing = killed_between_writes(TINY, "newtonian", std::iter::once(30));
    assert!(has_finished(&flowing, "shape in motion 1") && !has_finished(&flowing, "agreement"), "{:#}", flowing.0);
}

/// Waits until the run in `out` satisfies `reached`; whether it did before it ended.
fn until(child: &mut Child, reached: &dyn Fn() -> bool) -> bool {
    while child.try_wait().unwrap().is_none() {
        if reached() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

#[test]
fn killed_in_every_kind_of_stage() {
    let scene = Scene::with_clip(&[0, 3, 5], 7);
    scene.write("tiny.toml", TINY.replace("shrink = 12", "shrink = 4").replace("velocity = 1", "velocity = 4"));
    scene.succeeds("reconstruct clip --out whole --config tiny.toml");
    let state = || fs::read(scene.path("out/state.json")).ok().and_then(|s| serde_json::from_slice::<Value>(&s).ok());
    let finished =
        |stage: &str| state().is_some_and(|state| state["finished"].as_array().unwrap().iter().any(|s| s == stage));
    let answers = || state().and_then(|state| Some(state["batches"]["answers"].as_array()?.len())).unwrap_or(0);
    let in_field = |stage: &str| {
        let file = fs::read(scene.path("out/field.safetensors")).unwrap_or_default();
        file.windows(stage.len()).any(|bytes| bytes == stage.as_bytes())
    };
    let moments: [(&str, &dyn Fn() -> bool); 6] = [
        ("before anything", &|| scene.path("out/config.toml").is_file()),
        ("in the fit of the shape", &|| scene.path("out/field.safetensors").is_file()),
        ("in the search of the velocity", &|| finished("shape") && answers() >= 2),
        ("in the search of the material", &|| finished("velocity in flight") && answers() >= 1),
        ("in the fit of the shape in motion", &|| in_field("shape in motion")),
        ("in the posterior", &|| finished("material 1")),
    ];
    let mut killed = Vec::new();
    for (what, reached) in moments {
        let begun = scene.path("out/config.toml").is_file();
        let arguments = if begun { "--resume" } else { "--config tiny.toml" };
        let mut child = scene.command(&format!("reconstruct clip --out out {arguments}")).spawn().unwrap();
        if until(&mut child, reached) {
            assert!(Command::new("kill").args(["-KILL", &child.id().to_string()]).status().unwrap().success());
        }
        let output = child.wait_with_output().unwrap();
        match output.status.code() {
            None => killed.push(what),
            code => assert_eq!(code, Some(0), "{what}: {}", text(&output.stderr)),
        }
    }
    // the posterior, and some iterations, are computed in a moment, which may be over before it is noticed
    assert!(killed.len() >= 4, "{killed:?}");
    scene.succeeds("reconstruct clip --out out --resume");
    let file = |run: &str| fs::read(scene.path(&format!("{run}/parameters.json"))).unwrap();
    assert_eq!(text(&file("out")), text(&file("whole")));
    let (again, wanted) = (found(&scene.path("out")), found(&scene.path("whole")));
    assert!(again == wanted, "{:#} instead of {:#}", again.0, wanted.0);
    let left = fs::read_dir(scene.path("out")).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert_eq!(left.filter(|name| name.ends_with(".partial")).count(), 0, "half-written files are cleared away");
}
