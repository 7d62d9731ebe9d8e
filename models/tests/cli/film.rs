//! Films of one camera on the command line.

use std::fs;

use crate::scene::{Scene, bundled, text};

/// A folder of the bundled clip's first camera, without any calibration.
fn film() -> Scene {
    let scene = Scene::new();
    fs::create_dir(scene.path("film")).unwrap();
    for frame in 0..14 {
        let from = bundled().join(format!("data/r_0_{frame}.png"));
        fs::copy(from, scene.path(&format!("film/{frame}.png"))).unwrap();
    }
    scene
}

#[test]
fn a_film_is_looked_at() {
    let scene = film();
    let printed = scene.succeeds("check film --fps 24");
    for part in ["14 frames", "192 × 192", "elsewhere", "m away", "in the first 5 frames", "ground", "ready to open"] {
        assert!(printed.contains(part), "no {part:?} in: {printed}");
    }
    scene.refuses("check film", &["film", "--fps"]);
}

#[test]
fn a_film_is_reconstructed_and_resumed_and_made_again() {
    let scene = film();
    scene.refuses("reconstruct film --out out --config quick.toml", &["--fps"]);
    scene.succeeds("reconstruct film --fps 24 --frames 8 --out out --config quick.toml");
    let state = scene.state("out");
    let velocity: Vec<f64> = (0..3).map(|k| state["unknowns"]["velocity"][k].as_f64().unwrap()).collect();
    let error = velocity.iter().zip([-0.4, -0.6, 0.1]).map(|(v, truth)| (v - truth).powi(2)).sum::<f64>().sqrt();
    assert!(error < 0.15 * 0.728, "{velocity:?}");
    let config = fs::read_to_string(scene.path("out/config.toml")).unwrap();
    assert!(config.contains("frames_per_s = 24.0"), "{config}");
    let output = scene.run("reconstruct film --out out --resume --fps 12");
    assert!(output.status.code() == Some(2) && text(&output.stderr).contains("belongs to the run"));
    scene.succeeds("reconstruct film --out out --resume");
    scene.succeeds("simulate --from out --set young=1e6 --out again");
    assert!(scene.path("again/index.html").is_file());
}
