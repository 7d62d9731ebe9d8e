//! `gradreel simulate` as a person runs it.

use std::path::Path;
use std::process::{Command, Output};

use tempfile::TempDir;

const SCENE: &str = r#"
title = "Two <small> boxes"
[time]
duration_s = 0.1
frames_per_s = 40
[grid]
spacing_m = 0.06
[ground]
[materials.a]
law = "neo_hookean"
density_kg_m3 = 1000
young = 3e4
poisson = 0.3
[materials.b]
law = "newtonian"
density_kg_m3 = 900
viscosity = 5
bulk = 2e4
[[objects]]
material = "a"
shape.box = { centre_m = [0, 0.1, 0], size_m = [0.18, 0.18, 0.18] }
[[objects]]
material = "b"
shape.box = { centre_m = [0, 0.4, 0], size_m = [0.18, 0.18, 0.18] }
[[colliders]]
shape.sphere = { centre_m = [0.4, 0.1, 0], radius_m = 0.1 }
velocity_m_s = [-0.2, 0, 0]
[camera]
pixels = [96, 72]
"#;

fn simulate(arguments: &[&str], within: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gradreel")).arg("simulate").args(arguments).current_dir(within).output().unwrap()
}

#[test]
fn a_scene_becomes_a_folder_of_results() {
    let folder = TempDir::new().unwrap();
    let within = folder.path();
    std::fs::write(within.join("two.toml"), SCENE).unwrap();
    let plan = simulate(&["two.toml", "--plan"], within);
    let text = String::from_utf8(plan.stdout).unwrap();
    assert!(plan.status.success() && text.contains("432 particles") || text.contains("particles   432"), "{text}");
    assert!(text.contains("substeps") && text.contains("MiB"), "{text}");
    assert!(!within.join("runs").exists(), "a plan writes nothing");

    let done = simulate(&["two.toml", "--frames", "ply,npy"], within);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let run = within.join("runs/two");
    for file in
        ["frames/frame_0000.ply", "frames/frame_0004.npy", "motion.gif", "totals.json", "scene.toml", "index.html"]
    {
        assert!(run.join(file).metadata().is_ok_and(|m| m.len() > 0), "no {file}");
    }
    assert!(!run.join("state.npy").exists() && !run.join("frames/frame_0005.ply").exists());
    let page = std::fs::read_to_string(run.join("index.html")).unwrap();
    assert!(page.contains("Two &lt;small&gt; boxes") && page.contains("image/gif"));
    let totals: serde_json::Value = serde_json::from_slice(&std::fs::read(run.join("totals.json")).unwrap()).unwrap();
    let frames = totals["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 5);
    let mass = |k: usize| frames[k]["mass_kg"].as_f64().unwrap();
    approx::assert_relative_eq!(mass(0), 216.0 * 0.03_f64.powi(3) * 1900.0, max_relative = 1e-5);
    approx::assert_relative_eq!(mass(0), mass(4), max_relative = 1e-9);
    // What falls freely turns height into motion.
    let height = |k: usize| frames[k]["centre_m"][1].as_f64().unwrap();
    assert!(height(4) < height(0));
    // The copy is a scene, and says what was assumed.
    let again = simulate(&["runs/two/scene.toml", "--plan"], within);
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
}

#[test]
fn a_bad_scene_leaves_no_folder_and_exits_with_2() {
    let folder = TempDir::new().unwrap();
    let within = folder.path();
    std::fs::write(within.join("bad.toml"), SCENE.replace("newtonian", "newtonain")).unwrap();
    let refused = simulate(&["bad.toml"], within);
    let text = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2), "{text}");
    assert!(text.contains("bad.toml: materials.b.law") && text.contains("did you mean `newtonian`?"), "{text}");
    assert!(!within.join("runs").exists());
    assert_eq!(simulate(&["missing.toml"], within).status.code(), Some(2));
    let help = simulate(&["--help"], within);
    let help = String::from_utf8(help.stdout).unwrap();
    assert!(help.contains("shape.sphere") && help.contains("drucker_prager"), "{help}");
}

#[cfg(unix)]
#[test]
fn a_run_that_is_interrupted_goes_on_to_the_same_end() {
    use std::time::{Duration, Instant};

    let folder = TempDir::new().unwrap();
    let within = folder.path();
    // Long enough to be caught in the middle.
    let scene = SCENE.replace("duration_s = 0.1", "duration_s = 0.3").replace("spacing_m = 0.06", "spacing_m = 0.03");
    std::fs::write(within.join("two.toml"), scene).unwrap();
    let arguments = ["two.toml", "--frames", "npy", "--no-gif"];
    let whole = simulate(&[&arguments[..], &["--out", "whole"]].concat(), within);
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    let resumed = [&arguments[..], &["--out", "parts"]].concat();
    let mut child = Command::new(env!("CARGO_BIN_EXE_gradreel"))
        .arg("simulate")
        .args(&resumed)
        .current_dir(within)
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    while !within.join("parts/frames/frame_0002.npy").exists() && begun.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(1));
    }
    let signal = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(signal.success());
    let code = child.wait().unwrap().code();
    // On a very fast machine it may have finished.
    if code == Some(130) {
        assert!(within.join("parts/state.npy").exists() && within.join("parts/totals.json").exists());
        let other = simulate(&[&resumed[..], &["--resume", "--precision", "f64"]].concat(), within);
        assert!(String::from_utf8_lossy(&other.stderr).contains("another scene"), "{other:?}");
        let rest = simulate(&[&resumed[..], &["--resume"]].concat(), within);
        assert!(rest.status.success(), "{}", String::from_utf8_lossy(&rest.stderr));
        assert!(!within.join("parts/state.npy").exists());
    } else {
        assert_eq!(code, Some(0));
    }
    let read = |run: &str, file: &str| std::fs::read(within.join(run).join(file)).unwrap();
    for file in ["frames/frame_0005.npy", "frames/frame_0012.npy"] {
        assert!(read("whole", file) == read("parts", file), "{file} differs");
    }
    let heights = |run: &str| -> Vec<f64> {
        let totals: serde_json::Value = serde_json::from_slice(&read(run, "totals.json")).unwrap();
        totals["frames"].as_array().unwrap().iter().map(|t| t["centre_m"][1].as_f64().unwrap()).collect()
    };
    let (whole, parts) = (heights("whole"), heights("parts"));
    assert_eq!((whole.len(), parts.len()), (13, 13));
    whole.iter().zip(&parts).for_each(|(a, b)| approx::assert_relative_eq!(a, b, max_relative = 1e-12));
}

#[test]
fn a_filmed_scene_is_a_clip_that_can_be_reconstructed() {
    use gradreel_models::video::{Clip, OpenOptions};
    let folder = TempDir::new().unwrap();
    let within = folder.path();
    let scene = SCENE.to_owned() + "[film]\ncameras = 3\npixels = [40, 32]\ntarget_m = [0, 0.2, 0]\ndistance_m = 1.2\n";
    std::fs::write(within.join("film.toml"), &scene).unwrap();
    let done = simulate(&["film.toml", "--out", "run", "--no-gif"], within);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let clip = Clip::open(&within.join("run/clip"), &OpenOptions::default()).unwrap();
    assert_eq!((clip.cameras.len(), clip.frame_count()), (3, 5));
    approx::assert_relative_eq!(clip.frame_dt(), 0.025, max_relative = 1e-9);
    for (camera, frames) in clip.cameras.iter().zip(&clip.frames) {
        // Two boxes of 0.18 m, their middles where a pinhole camera has them, on a background without any coverage.
        for (centre, colour) in [([0.0, 0.1, 0.0], 0), ([0.0, 0.4, 0.0], 1)] {
            let [u, v, depth] = camera.project(centre).unwrap();
            let (row, column) = (v as usize, u as usize);
            assert_eq!(frames[0].alpha[[row, column]], 1.0, "object {colour} at {row}, {column}");
            let red = frames[0].rgb[[row, column, 0]] > frames[0].rgb[[row, column, 2]];
            assert_eq!(red, colour == 0, "the first object is red, the second blue");
            assert!(depth > 0.9);
        }
        let area: f64 = frames[0].alpha.iter().map(|&a| f64::from(a)).sum();
        let pixel = 1.2 / camera.fx;
        // between the sides of the two boxes and their diagonals
        let wanted = 2.0 * 0.18 * 0.18 / (pixel * pixel);
        assert!(area > 0.9 * wanted && area < 1.9 * wanted, "{area} pixels of {wanted}");
        assert_eq!(frames[0].alpha[[0, 0]], 0.0);
    }
    std::fs::write(within.join("film.toml"), scene.replace("cameras = 3", "cameras = 0")).unwrap();
    let refused = simulate(&["film.toml", "--out", "third"], within);
    let text = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(2) && text.contains("film.cameras"), "{text}");
    assert!(!within.join("third").exists(), "a scene that is refused leaves nothing");
}

/// The code and the error of a command that is refused.
fn refused(arguments: &[&str], within: &Path) -> String {
    let output = simulate(arguments, within);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    text
}

#[test]
fn the_plan_tells_the_mass_of_a_ball_much_smaller_than_a_cell() {
    let folder = TempDir::new().unwrap();
    let scene = "[time]\nduration_s = 0.05\nframes_per_s = 20\n[grid]\nspacing_m = 0.04\n[ground]\n\
                 [materials.a]\nlaw = \"neo_hookean\"\ndensity_kg_m3 = 1000\nyoung = 2e5\npoisson = 0.3\n\
                 [[objects]]\nmaterial = \"a\"\nshape.sphere = { centre_m = [0, 0.5, 0], radius_m = 0.005 }\n\
                 [[colliders]]\nshape.box = { centre_m = [0.02, 1, 0], size_m = [0.02, 1, 1] }\n";
    std::fs::write(folder.path().join("tiny.toml"), scene).unwrap();
    let plan = simulate(&["tiny.toml", "--plan"], folder.path());
    let text = String::from_utf8(plan.stdout).unwrap();
    for part in ["5.24e-4 kg", "objects[0] is small", "colliders[0] is 0.0200 m thick"] {
        assert!(text.contains(part), "{part} is missing in: {text}");
    }
    let done = simulate(&["tiny.toml", "--no-gif", "--out", "run"], folder.path());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let totals = std::fs::read(folder.path().join("run/totals.json")).unwrap();
    let totals: serde_json::Value = serde_json::from_slice(&totals).unwrap();
    let ball = 4.0 / 3.0 * std::f64::consts::PI * 0.005_f64.powi(3) * 1000.0;
    for frame in totals["frames"].as_array().unwrap() {
        approx::assert_relative_eq!(frame["mass_kg"].as_f64().unwrap(), ball, max_relative = 1e-6);
    }
    let [start, end] = [0, 1].map(|k| totals["frames"][k]["centre_m"][1].as_f64().unwrap());
    approx::assert_relative_eq!(start - end, 0.5 * 9.8 * 0.05_f64.powi(2), max_relative = 0.03);
}

#[test]
fn a_folder_that_another_run_writes_to_is_left_alone() {
    use gradreel_models::runtime::run_folder::RunFolder;

    let folder = TempDir::new().unwrap();
    let within = folder.path();
    std::fs::write(within.join("two.toml"), SCENE).unwrap();
    let other = RunFolder::create(&within.join("run")).unwrap();
    let partial = within.join("run/.frame.png.1-1.partial");
    std::fs::write(&partial, "half a").unwrap();
    let text = refused(&["two.toml", "--out", "run"], within);
    assert!(text.contains("another process is at work") && text.contains("--out"), "{text}");
    assert_eq!(std::fs::read(&partial).unwrap(), b"half a");
    other.write("frame.png", b"the whole").unwrap();
}

#[test]
fn a_folder_that_cannot_be_one_is_refused_before_the_scene_is_read() {
    let folder = TempDir::new().unwrap();
    let within = folder.path();
    std::fs::write(within.join("README.md"), "text").unwrap();
    std::fs::create_dir(within.join("full")).unwrap();
    std::fs::write(within.join("full/mine.txt"), "text").unwrap();
    let long = "long".repeat(100);
    let below = format!("full/{long}");
    for (out, words) in [
        ("README.md", "is not a folder"),
        ("README.md/below", "is not a folder"),
        ("full", "is not empty"),
        (long.as_str(), "cannot make the folder"),
        (below.as_str(), "cannot make the folder"),
    ] {
        let text = refused(&["there-is-no-such-scene.toml", "--out", out], within);
        assert!(text.contains(words) && text.contains("--out"), "{out}: {text}");
    }
    assert_eq!(std::fs::read(within.join("README.md")).unwrap(), b"text");
}

#[test]
fn input_that_cannot_be_used_exits_with_2() {
    let folder = TempDir::new().unwrap();
    let within = folder.path();
    std::fs::write(within.join("two.toml"), SCENE).unwrap();
    for duration in ["nan", "inf", "-1", "0"] {
        let text = refused(&["two.toml", "--plan", &format!("--duration={duration}")], within);
        assert!(text.contains("time.duration_s"), "{duration}: {text}");
    }
    for (from, to) in [("young = 3e4", "young = nan"), ("young = 3e4", "young = 1e15"), ("0.1, 0]", "inf, 0]")] {
        std::fs::write(within.join("bad.toml"), SCENE.replacen(from, to, 1)).unwrap();
        refused(&["bad.toml"], within);
    }
    std::fs::write(within.join("latin.toml"), b"title = \"Gel\xe9e\"\n").unwrap();
    assert!(refused(&["latin.toml"], within).contains("latin.toml"));
    std::fs::create_dir(within.join("folder.toml")).unwrap();
    assert!(refused(&["folder.toml"], within).contains("folder.toml"));
    assert!(!within.join("runs").exists());
}
