//! `gradreel reconstruct --method published`: what a run leaves, how it goes on, and what is refused with the reason.

use std::fs;

use serde_json::{Value, json};

use crate::model::weights;
use crate::scene::{QUICK, Scene, text};

/// Settings of a run of seconds.
const CHAIN: &str = "[published]\nsteps = 2\nguidance = 1.0\nfield = 40\nrays = 128\nnodes = 3000\nvelocity = 2\nstarts = 1\nmaterial = 2\n";

const RUN: &str = "reconstruct clip --cameras 0 --method published --weights tiny.safetensors";

fn scene(frames: i64) -> Scene {
    let scene = Scene::with_clip(&[0, 3], frames);
    weights().write(scene.path("tiny.safetensors")).unwrap();
    let quick = QUICK.replace("dx = 0.05", "dx = 0.08").replace("iterations = 6", "iterations = 3");
    scene.write("chain.toml", quick + CHAIN);
    scene
}

fn published(scene: &Scene, out: &str) -> Value {
    serde_json::from_slice(&fs::read(scene.path(out).join("published.json")).unwrap()).unwrap()
}

#[test]
fn a_run_leaves_the_usual_report_and_a_picture_of_every_stage() {
    let scene = scene(9);
    let output = scene.run(&format!("{RUN} --config chain.toml --out out --material plasticine"));
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{told}");
    for part in
        ["stage 1 of 6: boxes", "stage 2 of 6: views of every frame", "stage 6 of 6: material", "beside the weights"]
    {
        assert!(told.contains(part), "no {part:?} in {told}");
    }
    for file in [
        "parameters.json",
        "index.html",
        "input_and_reconstruction.gif",
        "last_frame.png",
        "particles/frame_008.ply",
        "boxes.png",
        "views.png",
        "field.png",
        "temporal_field.safetensors",
        "views/frame_008.safetensors",
    ] {
        assert!(scene.path("out").join(file).is_file(), "no {file}");
    }
    let parameters = scene.parameters("out");
    for name in ["young", "poisson", "yield_stress", "velocity_x", "velocity_y", "velocity_z"] {
        let entry = parameters[name].as_object().unwrap();
        assert!(entry.contains_key("interval_90") && entry.contains_key("determined"), "{name}: {entry:?}");
        assert!(entry["value"].is_number() && entry["source"] == "fitted", "{name}: {entry:?}");
    }
    let page = fs::read_to_string(scene.path("out/index.html")).unwrap();
    for part in [
        "Stage 1 of 6: boxes",
        "Stage 2 of 6: views of every frame",
        "Stage 3 of 6: temporal field",
        "Motion of the field",
    ] {
        assert!(page.contains(part), "no {part:?}");
    }
    // the weights have no module: the run says how the object comes to its place
    let notes = scene.state("out")["notes"].to_string();
    assert!(notes.contains("moved to where the film has it"), "{notes}");
    let state = published(&scene, "out");
    assert_eq!((state["placing"].as_str(), state["boxes"].as_array().unwrap().len()), (Some("moved"), 9));
    let stages: Vec<&str> =
        state["finished"].as_array().unwrap().iter().map(|d| d["stage"].as_str().unwrap()).collect();
    assert_eq!(stages, ["boxes", "views", "field", "particles", "velocity", "material"]);
    // a finished run has nothing left to do; its settings are its own
    let before = fs::read(scene.path("out/published.json")).unwrap();
    scene.succeeds("reconstruct clip --out out --resume -q");
    assert_eq!(fs::read(scene.path("out/published.json")).unwrap(), before);
    let edited = fs::read_to_string(scene.path("out/config.toml")).unwrap().replace("field = 40", "field = 80");
    scene.write("out/config.toml", edited);
    scene.refuses("reconstruct clip --out out --resume", &["published.field: 40 → 80"]);
}

/// Frames of one seed begin with the same noise; another seed is another run.
#[test]
fn all_frames_have_the_noise_of_the_seed() {
    let scene = scene(3);
    scene.succeeds(&format!("{RUN} --config chain.toml --out a --seed 5 -q"));
    scene.succeeds(&format!("{RUN} --config chain.toml --out b --seed 5 -q"));
    scene.succeeds(&format!("{RUN} --config chain.toml --out c --seed 6 -q"));
    let views = |out: &str| fs::read(scene.path(out).join("views/frame_001.safetensors")).unwrap();
    assert_eq!(views("a"), views("b"));
    assert_ne!(views("a"), views("c"));
    assert_eq!(published(&scene, "a")["boxes"], published(&scene, "c")["boxes"]);
}

#[test]
fn boxes_of_a_detector() {
    let scene = scene(3);
    let run = format!("{RUN} --config chain.toml --out out --boxes boxes.json");
    // those of the masks, as a detector would leave them
    scene.succeeds(&format!("{RUN} --config chain.toml --out masks -q"));
    let found = published(&scene, "masks")["boxes"].clone();
    let pixels = |frame: usize, corner: &str, axis: usize| 192.0 * found[frame][corner][axis].as_f64().unwrap();
    let coco = |frame: usize| {
        let [x, y] = [0, 1].map(|axis| pixels(frame, "low", axis));
        let [w, h] = [0, 1].map(|axis| pixels(frame, "high", axis) - pixels(frame, "low", axis));
        json!({"image_id": frame, "category_id": 1, "bbox": [x, y, w, h], "score": 0.9})
    };
    scene.write("boxes.json", json!([coco(0), coco(1)]).to_string());
    scene.refuses(&run, &["boxes.json", "no box in some frames", "frames 2"]);
    scene.write(
        "boxes.json",
        json!([coco(0), coco(1), {"image_id": 2, "bbox": [0, 0, 3, 3], "score": 0.9}]).to_string(),
    );
    scene.refuses(&run, &["boxes.json", "nothing of the object", "frames 2"]);
    scene.write("boxes.json", "{\"boxes\": [1, 2]}");
    scene.refuses(&run, &["boxes.json", "no file of boxes"]);
    scene.refuses(&run.replace("boxes.json", "none.json"), &["none.json", "--boxes"]);
    scene.write("boxes.json", json!([coco(0), coco(1), coco(2)]).to_string());
    scene.succeeds(&format!("{run} -q"));
    // read once: the run has them now
    fs::remove_file(scene.path("boxes.json")).unwrap();
    scene.succeeds("reconstruct clip --out out --resume -q");
}

#[test]
fn what_does_not_apply_is_refused_with_the_reason() {
    let scene = scene(3);
    let refuses = |options: &str, parts: &[&str]| scene.refuses(&format!("{RUN} {options}"), parts);
    refuses("--material auto", &["--material auto", "told the family"]);
    refuses("--spin", &["--spin", "without spin"]);
    refuses("--ground auto", &["--ground auto", "several cameras"]);
    refuses("--ground-contact friction", &["--ground-contact", "hypotheses"]);
    refuses("--ground-contact auto", &["--ground-contact"]);
    refuses("--imagine", &["--imagine", "every frame itself", "--weights"]);
    scene.refuses(
        "reconstruct clip --method published --weights tiny.safetensors",
        &["one camera", "cameras 0, 3", "--cameras 0"],
    );
    scene.refuses("reconstruct clip --cameras 0 --weights tiny.safetensors", &["--weights", "--method published"]);
    scene.refuses("reconstruct clip --cameras 0 --boxes boxes.json", &["--boxes", "--method published"]);
    scene.refuses("reconstruct clip --cameras 0 --seed 3", &["--seed", "--imagine"]);
    scene.refuses(&RUN.replace("tiny.safetensors", "none.safetensors"), &["none.safetensors"]);
    scene.write("bad.toml", "[published]\nnodes = 3\n");
    refuses("--config bad.toml", &["published.nodes", "512"]);
}
