//! `gradreel check` and `gradreel gradcheck`.

use std::fs;
use std::process::Stdio;

use crate::scene::{Scene, bundled, text};

#[test]
fn the_bundled_clip_is_complete() {
    let scene = Scene::new();
    let printed = scene.succeeds(&format!("check {}", bundled().display()));
    for part in ["7 cameras", "14 frames", "192 × 192", "layout: PAC-NeRF", "up is y", "ready to open"] {
        assert!(printed.contains(part), "no {part:?} in: {printed}");
    }
}

#[test]
fn an_incomplete_clip_is_listed() {
    let scene = Scene::with_clip(&[0, 3], 3);
    scene.succeeds("check clip");
    fs::remove_file(scene.path("clip/data/r_3_1.png")).unwrap();
    fs::remove_file(scene.path("clip/data/r_0_-1.png")).unwrap();
    scene.refuses("check clip", &["not complete", "clip"]);
    let printed = text(&scene.run("check clip").stdout);
    for part in ["r_3_1.png", "camera 0"] {
        assert!(printed.contains(part), "no {part:?} in: {printed}");
    }
    scene.refuses("check nowhere", &["nowhere"]);
}

/// What opening refuses, though every header is in order.
#[test]
fn an_image_that_is_cut_short_is_not_ready() {
    let scene = Scene::with_clip(&[0, 3], 3);
    let whole = fs::read(scene.path("clip/data/r_3_2.png")).unwrap();
    scene.write("clip/data/r_3_2.png", &whole[..whole.len() / 2]);
    scene.refuses("check clip", &["not complete"]);
    let printed = text(&scene.run("check clip").stdout);
    assert!(printed.contains("r_3_2.png") && !printed.contains("ready to open"), "{printed}");
    scene.refuses("reconstruct clip --out out", &["r_3_2.png"]);
}

#[test]
fn cameras_that_contradict_each_other_are_not_ready() {
    let scene = Scene::with_clip(&[0, 3], 2);
    // the pose of another camera
    let list = fs::read_to_string(scene.path("clip/all_data.json")).unwrap();
    let mut list: Vec<serde_json::Value> = serde_json::from_str(&list).unwrap();
    for entry in list.iter_mut().filter(|entry| entry["file_path"].as_str().unwrap().contains("r_3_")) {
        entry["c2w"][1][3] = serde_json::json!(40.0);
    }
    scene.write("clip/all_data.json", serde_json::Value::from(list).to_string());
    let message = text(&scene.run("reconstruct clip --out out").stderr);
    scene.refuses("check clip", &["not complete"]);
    let printed = text(&scene.run("check clip").stdout);
    assert!(!printed.contains("ready to open"), "{printed}");
    assert!(message.contains("silhouettes"), "{message}");
}

#[test]
fn a_single_frame_is_said() {
    let printed = Scene::with_clip(&[0, 3], 1).succeeds("check clip");
    for part in ["1 frame", "no motion", "not to reconstruct"] {
        assert!(printed.contains(part), "no {part:?} in: {printed}");
    }
}

#[test]
fn the_help_lists_the_layouts() {
    let printed = Scene::new().succeeds("check --help");
    for part in ["all_data.json", "transforms.json", "COLMAP", "Spring-Gaus", "clip.toml"] {
        assert!(printed.contains(part), "no {part:?} in: {printed}");
    }
}

#[test]
fn derivatives_are_tables() {
    let scene = Scene::new();
    for name in ["tanh", "neo_hookean"] {
        let printed = scene.succeeds(&format!("gradcheck {name}"));
        assert!(printed.contains(name) && printed.contains(", 0 failed"), "{printed}");
        assert!(!printed.contains("FAIL"), "{printed}");
    }
    scene.refuses("gradcheck nosuchop", &["nosuchop"]);
}

#[test]
fn a_reader_that_has_gone_is_no_fault() {
    let scene = Scene::with_clip(&[0], 3);
    let mut child = scene.command("check clip").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(text(&output.stderr), "");
}
