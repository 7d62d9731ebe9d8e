//! A reconstructed object simulated again under other conditions.

use std::fs;

use serde_json::Value;

use crate::scene::Scene;

fn json(scene: &Scene, name: &str) -> Value {
    serde_json::from_slice(&fs::read(scene.path(name)).unwrap()).unwrap()
}

/// Heights of the particles of a frame.
fn heights(scene: &Scene, name: &str) -> Vec<f32> {
    let bytes = fs::read(scene.path(name)).unwrap();
    gradreel_models::scenes::positions_of(&bytes).unwrap().iter().map(|x| x[1] as f32).collect()
}

#[test]
fn what_was_reconstructed_moves_under_other_conditions() {
    let scene = Scene::with_clip(&[0, 3], 4);
    scene.succeeds("reconstruct clip --out run --config quick.toml");
    let printed = scene.succeeds("simulate --from run --out same");
    assert!(printed.contains("index.html"), "{printed}");
    // Nothing changed: the same motion, and the same numbers.
    for frame in 0..4 {
        let file = |run: &str| fs::read(scene.path(&format!("{run}/particles/frame_{frame:03}.ply"))).unwrap();
        assert_eq!(file("run"), file("same"), "frame {frame}");
    }
    assert_eq!(json(&scene, "run/parameters.json")["parameters"], json(&scene, "same/parameters.json")["parameters"]);

    // Without gravity and velocity it stays where it is; the material is as given.
    let changes = "--set young=5e4 --gravity 0,0,0 --velocity 0,0,0";
    let printed = scene.succeeds(&format!("simulate --from run --out still {changes}"));
    assert!(printed.contains("E 5.0000e4 Pa instead of"), "{printed}");
    let (first, last) =
        (heights(&scene, "still/particles/frame_000.ply"), heights(&scene, "still/particles/frame_003.ply"));
    let moved = first.iter().zip(&last).map(|(a, b)| (a - b).abs()).fold(0.0f32, f32::max);
    assert!(moved < 1e-4, "moved by {moved} m without gravity");
    let young = &json(&scene, "still/parameters.json")["parameters"]["young"];
    assert_eq!((young["value"].as_f64(), young["source"].as_str()), (Some(5e4), Some("given")), "{young}");
    assert!(young["interval_90"].is_null(), "a given number has no interval: {young}");
    let page = fs::read_to_string(scene.path("still/index.html")).unwrap();
    assert!(page.contains("the object reconstructed from it, with E 5.0000e4 Pa instead of"));
    // The result is a run, too; and the first is as it was.
    scene.succeeds("simulate --from still --out again --gravity 0,-9.8,0");
    assert_eq!(json(&scene, "run/state.json")["unknowns"], json(&scene, "same/state.json")["unknowns"]);

    for (arguments, words) in [
        ("--set yung=1e5", ["yung", "did you mean `young`?"]),
        ("--set young=-1", ["young", "cannot have this value"]),
        ("--clip nowhere", ["no clip folder", "--clip"]),
    ] {
        scene.refuses(&format!("simulate --from run --out refused {arguments}"), &words);
        assert!(!scene.path("refused").exists(), "{arguments} left a folder");
    }
    let output = scene.run("simulate --from run --out refused --gravity 0,1");
    let message = crate::scene::text(&output.stderr);
    assert!(output.status.code() == Some(2) && message.contains("three numbers"), "{message}");
    scene.refuses("simulate --from nowhere", &["nowhere"]);
}
