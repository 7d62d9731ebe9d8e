//! The folder for the results: looked at before anything is read.

use std::fs;

use crate::scene::Scene;

#[test]
fn a_place_that_cannot_be_written_is_refused_before_the_clip_is_read() {
    let scene = Scene::with_clip(&[0, 3], 2);
    // there is no such clip: a clip that was looked at would be what is refused
    scene.write("README.md", "# mine");
    fs::create_dir(scene.path("full")).unwrap();
    scene.write("full/notes.txt", "mine");
    let long = "x".repeat(300);
    let nested = format!("new/{long}/run");
    for (out, parts) in [
        ("README.md", ["README.md", "not a folder"]),
        ("README.md/below", ["README.md", "not a folder"]),
        ("full", ["full", "not empty"]),
        (long.as_str(), ["xxx", "--out"]),
        (nested.as_str(), ["xxx", "--out"]),
    ] {
        scene.refuses(&format!("reconstruct nowhere --out {out}"), &parts);
        scene.refuses(&format!("bench ablation nowhere --out {out}"), &parts);
    }
    assert!(!scene.path("new").exists());
    scene.refuses("reconstruct nowhere --out new", &["nowhere"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_system_folder_that_takes_no_files() {
    let scene = Scene::with_clip(&[0, 3], 2);
    scene.refuses("reconstruct nowhere --out /proc/gradreel/run", &["/proc/gradreel/run", "--out"]);
}

#[test]
fn results_do_not_lie_among_what_they_are_made_from() {
    let scene = Scene::with_clip(&[0, 3], 2);
    for out in ["clip/out", "clip/data/deep/er", "./clip/../clip/out"] {
        scene.refuses(&format!("reconstruct clip --out {out} --config quick.toml"), &["clip", "--out", "among"]);
    }
    scene.refuses("reconstruct clip --out clip", &["clip", "not empty"]);
}
