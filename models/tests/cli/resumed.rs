//! `--resume`: refused for anything but the run that was begun here with this clip.

use std::fs;

use gradreel_models::runtime::run_folder::RunFolder;
use serde_json::json;

use crate::scene::Scene;

const RESUME: &str = "reconstruct clip --out out --resume";

#[test]
fn a_folder_without_a_run() {
    let scene = Scene::with_clip(&[0, 3], 2);
    scene.refuses(RESUME, &["out"]);
    fs::create_dir(scene.path("out")).unwrap();
    scene.refuses(RESUME, &["out", "no run"]);
    scene.refuses("reconstruct clip --out quick.toml --resume", &["quick.toml"]);
    // settings belong to the run: they are not to be given again
    let output = scene.run("reconstruct clip --out out --resume --young 5000");
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn nobody_else_goes_on_meanwhile() {
    let scene = Scene::with_clip(&[0, 3], 3);
    scene.succeeds("reconstruct clip --out out --config quick.toml");
    let other = RunFolder::resume(&scene.path("out")).unwrap();
    scene.refuses(RESUME, &["out", "another process"]);
    drop(other);
    scene.succeeds(RESUME);
}

#[test]
fn damaged_files_and_another_clip() {
    let scene = Scene::with_clip(&[0, 3], 3);
    scene.succeeds("reconstruct clip --out out --config quick.toml");
    let good = fs::read(scene.path("out/state.json")).unwrap();

    let mut state = scene.state("out");
    state["unknowns"]["parameters"] = json!([1e4]);
    for bytes in [&good[..good.len() / 2], b"", b"{}", state.to_string().as_bytes()] {
        scene.write("out/state.json", bytes);
        scene.refuses(RESUME, &["out/state.json", "damaged"]);
    }
    scene.write("out/state.json", &good);

    let field = fs::read(scene.path("out/field.safetensors")).unwrap();
    for bytes in [&field[..field.len() / 2], &field[..4], b"", &[0xff; 64]] {
        scene.write("out/field.safetensors", bytes);
        scene.refuses(RESUME, &["out/field.safetensors", "damaged"]);
    }
    fs::remove_file(scene.path("out/field.safetensors")).unwrap();
    scene.refuses(RESUME, &["out/field.safetensors"]);
    scene.write("out/field.safetensors", &field);

    let config = fs::read(scene.path("out/config.toml")).unwrap();
    scene.write("out/config.toml", &config[..config.len() / 2]);
    scene.refuses(RESUME, &["out/config.toml"]);
    scene.write("out/config.toml", &config);

    scene.copy_clip("other", &[0, 3], 3);
    scene.refuses("reconstruct other --out out --resume", &["other", "another clip"]);
    scene.copy_clip("nested/clip", &[0, 3], 4);
    scene.refuses("reconstruct nested/clip --out out --resume", &["another clip", "4 frames"]);
    scene.copy_clip("third/clip", &[0, 4], 3);
    scene.refuses("reconstruct third/clip --out out --resume", &["another clip", "[0, 4]"]);

    // nothing of this has harmed the run
    scene.succeeds(RESUME);
    assert_eq!(fs::read(scene.path("out/state.json")).unwrap(), good, "a finished run has nothing left to do");
}

/// Settings that finished stages have used are those of the run; how much effort is still spent may be changed, and is noted.
#[test]
fn settings_that_were_edited_meanwhile() {
    let scene = Scene::with_clip(&[0, 3], 3);
    scene.succeeds("reconstruct clip --out out --config quick.toml");
    let written = fs::read_to_string(scene.path("out/config.toml")).unwrap();
    for (before, after, named) in [
        ("dx = 0.05", "dx = 0.03", "geometry.dx: 0.05 → 0.03"),
        ("density = 1000.0", "density = 900.0", "world.density: 1000.0 → 900.0"),
        ("hull_coverage = 0.3\n", "hull_coverage = 0.4\n", "geometry.hull_coverage: 0.3 → 0.4"),
        ("spin = false", "spin = true", "estimate.spin: false → true"),
    ] {
        assert!(written.contains(before), "no {before} in {written}");
        scene.write("out/config.toml", written.replace(before, after));
        scene.refuses(RESUME, &["out/config.toml", named, "--config"]);
    }
    scene.write("out/config.toml", written.replace("velocity = 2", "velocity = 3"));
    scene.succeeds(RESUME);
    let notes = scene.state("out")["notes"].to_string();
    assert!(notes.contains("estimate.velocity: 2 → 3"), "{notes}");
    // a comment is no setting
    let written = fs::read_to_string(scene.path("out/config.toml")).unwrap();
    scene.write("out/config.toml", format!("# mine\n{written}"));
    scene.succeeds(RESUME);
}
