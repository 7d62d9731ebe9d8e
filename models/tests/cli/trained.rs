//! `gradreel train`: both stages, that a training can be stopped and gone on with, and what it refuses.

use std::fs;

use gradreel::io::TensorFile;
use gradreel_models::views::ModelSizes;

use crate::model::ball;
use crate::scene::{Scene, same_runs, text};

/// A model and a training as small as they can be.
pub const TINY: &str = r#"
steps = 3
checkpoint_every = 1
[optimiser]
batch = 2
targets = 2
rate = 1e-3
warmup = 1
[data]
rays = 1
nodes = 16
[validation]
every = 2
samples = 3
shapes = 1
steps = 2
[model]
image = 32
autoencoder.patch = 2
[model.denoiser.ring]
views = 4
[model.denoiser.unet]
inputs = 24
outputs = 12
multipliers = [1, 1, 1, 1]
heads = 2
context = 8
volumes = [8, 8, 16, 16]
[model.denoiser.volume]
latent = 12
features = 4
time = 16
spatial = [16, 16, 16, 16]
frustum = [8, 8, 16, 16]
voxels = 8
depth = 8
"#;

const BASE: &str = "train novel-view --quiet --config tiny.toml";

fn scene() -> Scene {
    let scene = Scene::new();
    scene.write("tiny.toml", TINY);
    scene
}

#[test]
fn both_stages_and_what_they_leave() {
    let scene = scene();
    scene.succeeds(&format!("{BASE} --out base"));
    let log = fs::read_to_string(scene.path("base/log.csv")).unwrap();
    assert_eq!(log.lines().count(), 1 + 3, "{log}");
    let looks = fs::read_to_string(scene.path("base/validation.csv")).unwrap();
    let steps: Vec<&str> = looks.lines().skip(1).map(|row| row.split(',').next().unwrap()).collect();
    assert_eq!(steps, ["2", "3"], "{looks}");
    for row in looks.lines().chain(log.lines()).filter(|row| row.starts_with(char::is_numeric)) {
        assert!(row.split(',').all(|number| number.parse::<f64>().is_ok_and(f64::is_finite)), "{row}");
    }
    let page = fs::read_to_string(scene.path("base/index.html")).unwrap();
    assert!(page.contains("3 of 3 steps") && page.matches("<svg").count() >= 3);
    let png = fs::read(scene.path("base/previews/step_0000003.png")).unwrap();
    let info = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap().info().clone();
    assert_eq!((info.width, info.height), (2 * 5 * 32, 2 * 2 * 32));
    let printed = scene.succeeds("weights check base/model.safetensors");
    assert!(printed.contains("fit"), "{printed}");

    // the module: everything else stays as it was
    let aware = "train novel-view --quiet --stage spatial-aware --weights base/model.safetensors";
    scene.write("more.toml", TINY.split("[model]").next().unwrap());
    scene.succeeds(&format!("{aware} --config more.toml --steps 2 --out aware"));
    let [before, after] =
        ["base", "aware"].map(|run| TensorFile::read(scene.path(run).join("model.safetensors")).unwrap());
    let sizes = ModelSizes::from_json(&after.metadata[ModelSizes::METADATA]).unwrap();
    assert_eq!(sizes.denoiser.spatial_aware.unwrap().features, 16);
    for (name, tensor) in &before.tensors {
        assert_eq!(tensor.slice::<f32>(), after.tensors[name].slice::<f32>(), "{name}");
    }
    let added: Vec<&String> = after.tensors.keys().filter(|name| !before.tensors.contains_key(*name)).collect();
    assert!(added.len() > 50 && added.iter().all(|name| name.starts_with("spatial_aware.")));

    // what was trained can be used
    ball(scene.path("ball.png"), [0; 4]);
    let synthesize = "synthesize ball.png --quiet --weights aware/model.safetensors --crop 0 --steps 2";
    scene.succeeds(&format!("{synthesize} --elevation 30 --out views"));
    let state = TensorFile::read(scene.path("views/state.safetensors")).unwrap();
    let seen = state.get("seen").unwrap().to_vec().unwrap();
    assert!(seen.len() == 4 && seen[0] < 0.5 && seen[2] > 0.5, "{seen:?}");
    scene.succeeds(&format!("{synthesize} --elevation 30 --distance 1.25 --out lifted"));
    let state = TensorFile::read(scene.path("lifted/state.safetensors")).unwrap();
    assert_eq!(state.get("seen").unwrap().to_vec().unwrap(), [&seen[..], &[1.25]].concat());
    let refused = "synthesize ball.png --weights base/model.safetensors --elevation 30 --distance 1 --out none";
    scene.refuses(refused, &["--distance", "spatial-aware module"]);
    scene.refuses(&format!("{synthesize} --elevation 30 --distance 0 --out none"), &["far away", "1.5"]);
    let evaluate = "train novel-view --quiet --weights aware/model.safetensors --config more.toml --evaluate 2";
    let table = scene.succeeds(&format!("{evaluate} --out measured"));
    for part in ["2 unseen objects", "box and distance", "without the module", "factor"] {
        assert!(table.contains(part), "no {part:?} in {table}");
    }
    let rows = fs::read_to_string(scene.path("measured/objects.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 2 * 3);
}

/// A model that un-projects its input is trained on as one that does not.
#[test]
fn a_training_goes_on_without_the_input_in_space() {
    let scene = scene();
    scene.write("with.toml", TINY.replace("depth = 8", "depth = 8\ninput = true"));
    scene.succeeds("train novel-view --quiet --config with.toml --steps 1 --out with");
    scene.succeeds("weights convert with/model.safetensors without.safetensors --without-input");
    let [with, without] = ["with/model.safetensors", "without.safetensors"].map(|name| {
        let file = TensorFile::read(scene.path(name)).unwrap();
        let sizes = ModelSizes::from_json(&file.metadata[ModelSizes::METADATA]).unwrap();
        (file, sizes.denoiser.volume.input)
    });
    assert!(with.1 && !without.1);
    for (name, tensor) in &with.0.tensors {
        match without.0.tensors.get(name) {
            None => assert!(name.starts_with("spatial_volume.input_encoder."), "{name}"),
            Some(kept) if name == "spatial_volume.spatial_volume_feats.init_conv.weight" => {
                // four views of four features, and then the input's
                assert_eq!((tensor.dims()[1], kept.dims()[1]), (20, 16));
                let rows = tensor.slice::<f32>().chunks(20 * 27).map(|row| &row[..16 * 27]);
                assert!(rows.eq(kept.slice::<f32>().chunks(16 * 27)));
            }
            Some(kept) => assert_eq!(tensor.slice::<f32>(), kept.slice::<f32>(), "{name}"),
        }
    }
    scene.succeeds(&format!("{BASE} --weights without.safetensors --steps 1 --out on"));
    scene.refuses("weights convert without.safetensors again.safetensors --without-input", &["un-project"]);
}

#[cfg(unix)]
#[test]
fn a_training_goes_on_where_it_was_stopped() {
    use std::io::Read;
    use std::process::Command;

    let scene = scene();
    let run = "train novel-view --config tiny.toml --steps 14";
    let mut child = scene.command(&format!("{run} --out stopped")).spawn().unwrap();
    while !scene.path("stopped/state.safetensors").is_file() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it took a step");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let mut told = String::new();
    child.stderr.take().unwrap().read_to_string(&mut told).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{told}");
    assert!(told.contains("train novel-view --out stopped --resume") && !told.contains("panicked"), "{told}");
    assert!(!scene.path("stopped/model.safetensors").exists(), "nothing is claimed that was not found");
    scene.succeeds("train novel-view --quiet --out stopped --resume");
    scene.succeeds(&format!("{run} --quiet --out straight"));
    same_runs(&scene.path("stopped"), &scene.path("straight"));
    assert!(scene.path("straight/model.safetensors").is_file());
    // a finished training has nothing left to do
    scene.succeeds("train novel-view --quiet --out stopped --resume");
    same_runs(&scene.path("stopped"), &scene.path("straight"));
}

#[test]
fn settings_are_printed_and_read_again() {
    let scene = scene();
    let print = |more: &str| scene.succeeds(&format!("train novel-view --print-config {more}"));
    let base = print("");
    for part in ["stage = \"base\"", "reach = 0.0", "[model.denoiser.unet]", "patch = 4"] {
        assert!(base.contains(part), "no {part:?} in {base}");
    }
    assert!(!base.contains("spatial_aware"));
    scene.write("printed.toml", &base);
    assert_eq!(print("--config printed.toml"), base);
    let other = print("--config tiny.toml --steps 7 --batch 5 --seed 9");
    for part in ["steps = 7", "batch = 5", "seed = 9", "patch = 2", "checkpoint_every = 1"] {
        assert!(other.contains(part), "no {part:?} in {other}");
    }
    let module = print("--stage spatial-aware");
    for part in
        ["stage = \"spatial-aware\"", "reach = 1.0", "[model.denoiser.spatial_aware]", "trained = [\"spatial_aware\"]"]
    {
        assert!(module.contains(part), "no {part:?} in {module}");
    }
}

#[test]
fn what_cannot_be_trained_is_refused() {
    let scene = scene();
    scene.refuses("train novel-view --stage spatial-aware --out out", &["--weights", "base model"]);
    scene.refuses("train novel-view --out nowhere --resume", &["nowhere"]);
    scene.refuses("train novel-view --weights nowhere.safetensors", &["nowhere.safetensors"]);
    for (text, part) in [
        ("stepps = 3", "stepps"),
        ("steps = 0", "steps"),
        ("stage = \"both\"", "stage"),
        ("[optimiser]\nbatch = 0", "batch"),
        ("[optimiser]\ntargets = 17", "targets"),
        ("[data]\nscale = [0.5, 0.1]", "scale"),
        ("[model]\nimage = 66", "image"),
        ("steps", "wrong.toml"),
    ] {
        scene.write("wrong.toml", text);
        scene.refuses("train novel-view --config wrong.toml --out out", &[part]);
    }
    let output = scene.run("train novel-view --out out --resume --steps 3");
    assert!(output.status.code() == Some(2) && text(&output.stderr).contains("--steps"));
}
