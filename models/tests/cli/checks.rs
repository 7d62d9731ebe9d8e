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
