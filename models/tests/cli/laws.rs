//! Laws of one's own on the command line: checked, simulated, reconstructed with, and kept with a run.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::scene::Scene;

/// A law of `models/laws` or `examples/laws` under another name here.
fn copy(scene: &Scene, from: &str, to: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(from);
    fs::create_dir_all(scene.path(to).parent().unwrap()).unwrap();
    scene.write(to, fs::read_to_string(path).unwrap());
}

const FALL: &str = "[time]\nduration_s = 0.1\n[grid]\nspacing_m = 0.05\n[ground]\ncontact = \"sticky\"\n\
                    [[objects]]\nmaterial = \"stuff\"\nshape.sphere = { centre_m = [0, 0.12, 0], radius_m = 0.1 }\n\
                    velocity_m_s = [0, -1, 0]\n";

fn fall(law: &str) -> String {
    format!("{FALL}[materials.stuff]\nlaw = \"{law}\"\ndensity_kg_m3 = 1000\nyoung = 5e4\npoisson = 0.3\n")
}

#[test]
fn a_law_is_checked_in_a_table_and_in_json() {
    let scene = Scene::new();
    copy(&scene, "../examples/laws/ogden.wgsl", "ogden.wgsl");
    let table = scene.succeeds("check-law ogden.wgsl");
    for words in ["frame indifference", "symmetry of the stress", "energy", "wave speed", "WGSL", "neo_hookean"] {
        assert!(table.contains(words), "no {words} in {table}");
    }
    let plot = fs::read_to_string(scene.path("ogden.svg")).unwrap();
    assert!(["<svg", "uniaxial", "shear", "volumetric"].iter().all(|part| plot.contains(part)));
    let json: Value = serde_json::from_str(&scene.succeeds("check-law ogden.wgsl --no-plot --json")).unwrap();
    assert_eq!(json["passed"], true);
    assert_eq!(json["parameters"][2]["name"], "bulk");
    assert!(json["checks"].as_array().unwrap().len() > 8);

    let wrong = fs::read_to_string(scene.path("ogden.wgsl"))
        .unwrap()
        .replace("return left(point.f, tau)", "return diagonal(tau)");
    scene.write("wrong.wgsl", &wrong);
    let output = scene.run("check-law wrong.wgsl --no-plot");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).contains("FAIL"));

    scene.write("broken.wgsl", wrong.replace("p.bulk", "p.bilk"));
    scene.refuses("check-law broken.wgsl", &["broken.wgsl:18:", "bilk"]);
    scene.refuses("check-law missing.wgsl", &["missing.wgsl"]);
}

#[test]
fn a_scene_takes_a_law_from_a_file_and_keeps_it() {
    let scene = Scene::new();
    copy(&scene, "laws/neo_hookean.wgsl", "laws/mine.wgsl");
    scene.write("mine.toml", fall("laws/mine.wgsl"));
    scene.write("shipped.toml", fall("neo_hookean"));
    scene.succeeds("simulate mine.toml --out mine --frames npy --no-gif");
    scene.succeeds("simulate shipped.toml --out shipped --frames npy --no-gif");
    let totals = |out: &str| -> Value {
        serde_json::from_slice(&fs::read(scene.path(out).join("totals.json")).unwrap()).unwrap()
    };
    assert_eq!(totals("mine"), totals("shipped"), "the same law moves the same way");
    let text = |path: &str| fs::read_to_string(scene.path(path)).unwrap();
    assert_eq!(text("mine/mine.wgsl"), text("laws/mine.wgsl"));
    scene.write("laws/mine.wgsl", "fn stress() {");
    scene.refuses("simulate mine.toml --out again", &["laws/mine.wgsl:1:"]);
}

#[test]
fn a_run_keeps_its_law_and_goes_on_with_it() {
    let scene = Scene::with_clip(&[0, 3], 3);
    copy(&scene, "laws/neo_hookean.wgsl", "mine.wgsl");
    scene.succeeds("reconstruct clip --out out --config quick.toml --law mine.wgsl --start young=20kPa");
    let found = scene.parameters("out");
    assert!(found["young"]["value"].as_f64().unwrap() > 0.0);
    assert_eq!(found["young"]["unit"], "Pa");
    let config = fs::read_to_string(scene.path("out/config.toml")).unwrap();
    assert!(config.contains("law = \"mine.wgsl\"") && config.contains("name = \"mine\""), "{config}");
    // the file may go: the run has its own
    fs::remove_file(scene.path("mine.wgsl")).unwrap();
    scene.succeeds("reconstruct clip --out out --resume");
    scene.refuses("reconstruct clip --out b --law mine.wgsl", &["mine.wgsl"]);
    // a run without its law
    fs::remove_file(scene.path("out/mine.wgsl")).unwrap();
    scene.refuses("reconstruct clip --out out --resume", &["mine.wgsl"]);
}

#[test]
fn settings_name_a_law_beside_them() {
    let scene = Scene::with_clip(&[0, 3], 3);
    copy(&scene, "laws/neo_hookean.wgsl", "settings/mine.wgsl");
    let quick = fs::read_to_string(scene.path("quick.toml")).unwrap();
    scene.write("settings/own.toml", format!("{quick}[material]\nlaw = \"mine.wgsl\"\nheld = [\"poisson\"]\n"));
    scene.succeeds("reconstruct clip --out out --config settings/own.toml");
    assert!(scene.path("out/mine.wgsl").is_file());
}

#[cfg(unix)]
#[test]
fn a_simulation_goes_on_with_the_law_that_it_has_kept() {
    let scene = Scene::new();
    copy(&scene, "../examples/laws/layers.wgsl", "laws/mine.wgsl");
    let parameters = "lower = 2e4\nupper = 6e4\nbulk = 1e5\nfibres = 2e4\n";
    let fall = fall("laws/mine.wgsl").replace("young = 5e4\npoisson = 0.3\n", parameters);
    scene.write("fall.toml", fall.replace("duration_s = 0.1", "duration_s = 0.42"));
    let arguments = "simulate fall.toml --frames npy --no-gif --out";
    scene.succeeds(&format!("{arguments} whole"));
    // stopped after some frames
    let mut child = scene.command(&format!("{arguments} parts")).spawn().unwrap();
    while !scene.path("parts/frames/frame_0002.npy").is_file() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let code = child.wait().unwrap().code();
    // the file here is another law by now
    copy(&scene, "../examples/laws/ogden.wgsl", "laws/mine.wgsl");
    // on a very fast machine it may have finished
    if code == Some(130) {
        scene.succeeds(&format!("{arguments} parts --resume"));
    } else {
        assert_eq!(code, Some(0));
    }
    let last = |out: &str| fs::read(scene.path(out).join("frames/frame_0010.npy")).unwrap();
    assert!(last("parts") == last("whole"));
}

#[test]
fn clips_of_a_law_are_drawn_from_its_priors_and_fitted_with_it() {
    let scene = Scene::new();
    copy(&scene, "../examples/laws/ogden.wgsl", "rubber.wgsl");
    scene.succeeds("bench coverage --law rubber.wgsl --clips 1 --quick --out out -q");
    let text = |name: &str| fs::read_to_string(scene.path("out").join(name)).unwrap();
    let line: Value = serde_json::from_str(text("clips.jsonl").lines().next().unwrap()).unwrap();
    assert_eq!(line["family"], "rubber");
    for name in ["first", "second", "bulk"] {
        assert!(line["truth"][name].as_f64().unwrap() > 0.0, "{line}");
    }
    assert!(text("coverage.toml").contains("law = \"rubber.wgsl\""));
    // the folder has its own copy
    fs::remove_file(scene.path("rubber.wgsl")).unwrap();
    scene.succeeds("bench coverage --out out --resume -q");
    scene.refuses("bench coverage --law rubber.wgsl --clips 1 --out other", &["rubber.wgsl"]);
    scene.refuses("bench calibrate out", &["five families", "rubber.wgsl"]);
}

#[test]
fn rollouts_are_compared_with_the_same_law_in_rust() {
    let scene = Scene::new();
    copy(&scene, "laws/neo_hookean.wgsl", "neo_hookean.wgsl");
    let table = scene.succeeds("bench laws neo_hookean.wgsl --markdown results.md");
    assert!(
        table.contains("| neo_hookean |") && fs::read_to_string(scene.path("results.md")).unwrap().contains(&table)
    );
    let line = scene.succeeds("check-law neo_hookean.wgsl --no-plot --against neo_hookean");
    assert!(line.contains("rollout:") && line.contains("of neo_hookean"), "{line}");
    scene.refuses("check-law neo_hookean.wgsl --no-plot --against neo_hokean", &["did you mean `neo_hookean`"]);
    copy(&scene, "../examples/laws/ogden.wgsl", "ogden.wgsl");
    scene.refuses("bench laws ogden.wgsl", &["ogden.wgsl", "no law of this name"]);
}
