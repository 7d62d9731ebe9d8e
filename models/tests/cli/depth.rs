//! `gradreel train depth` and `bench depth`: what they leave, that a training can be stopped and gone on with, and what they
//! refuse.

use std::fs;

use safetensors::tensor::{Dtype, TensorView, serialize};

use crate::scene::{Scene, same_runs, text};

/// A training as small as it can be.
const TINY: &str = r#"
steps = 3
checkpoint_every = 1
[optimiser]
batch = 2
warmup = 1
[data]
solids = 2
nodes = 12
[validation]
every = 2
pictures = 4
[model]
channels = [8, 8, 8, 8]
blocks = [1, 1, 1, 1]
"#;

const TRAIN: &str = "train depth --quiet --shapes shapes --config tiny.toml";

/// Boxes as a file of shapes.
fn boxes(sides: &[[f32; 3]]) -> Vec<u8> {
    let quads = [[0u16, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let triangles = quads.map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    let corner = |side: &[f32; 3], n: usize| -> [i16; 3] {
        std::array::from_fn(|k| ((if n >> k & 1 == 1 { 0.5 } else { -0.5 }) * side[k] * 65534.0) as i16)
    };
    let corners: Vec<i16> =
        sides.iter().flat_map(|side| (0..8).flat_map(|n| corner(side, n)).collect::<Vec<_>>()).collect();
    let count = sides.len();
    let offsets = |each: u32| (0..=count as u32).flat_map(|k| (each * k).to_le_bytes()).collect::<Vec<u8>>();
    let bytes: [(&str, Dtype, Vec<usize>, Vec<u8>); 5] = [
        ("vertices", Dtype::I16, vec![8 * count, 3], corners.iter().flat_map(|x| x.to_le_bytes()).collect()),
        ("colours", Dtype::U8, vec![8 * count, 3], (0..24 * count).map(|i| (40 + 9 * i % 200) as u8).collect()),
        (
            "triangles",
            Dtype::U16,
            vec![12 * count, 3],
            (0..count)
                .flat_map(|_| triangles.as_flattened().as_flattened().iter().flat_map(|x| x.to_le_bytes()))
                .collect(),
        ),
        ("vertex_offsets", Dtype::U32, vec![count + 1], offsets(8)),
        ("triangle_offsets", Dtype::U32, vec![count + 1], offsets(12)),
    ];
    let views =
        bytes.iter().map(|(name, dtype, shape, bytes)| (*name, TensorView::new(*dtype, shape.clone(), bytes).unwrap()));
    serialize(views, None).unwrap()
}

fn scene() -> Scene {
    let scene = Scene::new();
    scene.write("tiny.toml", TINY);
    fs::create_dir(scene.path("shapes")).unwrap();
    scene.write("shapes/shapes_train.safetensors", boxes(&[[1.0, 0.4, 0.6], [0.3, 1.0, 0.8], [0.7, 0.5, 1.0]]));
    scene.write("shapes/shapes_val.safetensors", boxes(&[[1.0, 0.3, 0.3], [0.5, 1.0, 0.7]]));
    scene.write("shapes/shapes_test.safetensors", boxes(&[[0.8, 1.0, 0.4], [1.0, 1.0, 0.3]]));
    scene
}

#[test]
fn a_training_and_what_it_leaves() {
    let scene = scene();
    scene.succeeds(&format!("{TRAIN} --out run"));
    let [log, looks] =
        ["log.csv", "validation.csv"].map(|name| fs::read_to_string(scene.path("run").join(name)).unwrap());
    assert_eq!(log.lines().count(), 1 + 3, "{log}");
    let steps: Vec<&str> = looks.lines().skip(1).map(|row| row.split(',').next().unwrap()).collect();
    assert_eq!(steps, ["2", "3"], "{looks}");
    for row in looks.lines().chain(log.lines()).filter(|row| row.starts_with(char::is_numeric)) {
        assert!(row.split(',').all(|number| number.parse::<f64>().is_ok_and(f64::is_finite)), "{row}");
    }
    let page = fs::read_to_string(scene.path("run/index.html")).unwrap();
    assert!(page.contains("3 of 3 steps") && page.matches("<svg").count() >= 4);
    let png = fs::read(scene.path("run/previews/step_0000003.png")).unwrap();
    let info = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap().info().clone();
    // ten pictures a row, each twice as large
    assert_eq!(info.width, 2 * 10 * 64);

    // its weights are measured, and begin another training
    let bench = "bench depth --quiet --shapes shapes --weights run/model.safetensors --quick --json found.json";
    let table = scene.succeeds(bench);
    for part in ["IoU: network", "to the right side", "test split", "procedural"] {
        assert!(table.contains(part), "no {part:?} in {table}");
    }
    let found: serde_json::Value = serde_json::from_slice(&fs::read(scene.path("found.json")).unwrap()).unwrap();
    assert_eq!(found[0]["pictures"], 4);
    assert!(found[1]["network"]["mean"].as_f64().unwrap() > 0.0);
    scene.succeeds(&format!("{TRAIN} --resume run/model.safetensors --steps 1 --out more"));
    let settings = fs::read_to_string(scene.path("more/settings.toml")).unwrap();
    assert!(settings.contains("model.safetensors"), "{settings}");
}

#[test]
fn a_training_begins_from_the_weights_of_the_program() {
    let scene = scene();
    let settings = TINY.split("[model]").next().unwrap();
    scene.write("on.toml", settings);
    let run = "train depth --quiet --shapes shapes --config on.toml --resume built-in --steps 1 --out on";
    scene.succeeds(run);
    let settings = fs::read_to_string(scene.path("on/settings.toml")).unwrap();
    assert!(settings.contains("built-in") && settings.contains("[model]"), "{settings}");
    scene.refuses(&format!("{TRAIN} --resume built-in --out other"), &["weight"]);
}

#[cfg(unix)]
#[test]
fn a_training_goes_on_where_it_was_stopped() {
    use std::io::Read;
    use std::process::Command;

    let scene = scene();
    let run = "train depth --shapes shapes --config tiny.toml --steps 30";
    let mut child = scene.command(&format!("{run} --out stopped")).spawn().unwrap();
    while !scene.path("stopped/state.safetensors").is_file() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it took a step");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let mut told = String::new();
    child.stderr.take().unwrap().read_to_string(&mut told).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{told}");
    assert!(told.contains("train depth --out stopped --resume") && !told.contains("panicked"), "{told}");
    // the folder of the shapes has moved
    fs::rename(scene.path("shapes"), scene.path("moved")).unwrap();
    scene.refuses("train depth --quiet --out stopped --resume", &["shapes"]);
    scene.succeeds("train depth --quiet --out stopped --resume --shapes moved");
    fs::rename(scene.path("moved"), scene.path("shapes")).unwrap();
    scene.succeeds(&format!("{run} --quiet --out straight"));
    same_runs(&scene.path("stopped"), &scene.path("straight"));
    // a finished training has nothing left to do
    scene.succeeds("train depth --quiet --out stopped --resume");
    same_runs(&scene.path("stopped"), &scene.path("straight"));
}

#[test]
fn what_cannot_be_trained_is_refused() {
    let scene = scene();
    scene.refuses("train depth --out out", &["--shapes", "shapes_train.safetensors"]);
    scene.refuses("train depth --shapes nowhere --out out", &["nowhere"]);
    scene.refuses("train depth --shapes shapes --resume", &["--out"]);
    scene.refuses("train depth --out none --resume", &["none"]);
    for (settings, part) in [
        ("steps = 0", "steps"),
        ("[optimiser]\nbatch = 0", "optimiser.batch"),
        ("[optimiser]\nhold = 2.0", "optimiser.hold"),
        ("[data]\nnodes = 2", "data.nodes"),
        ("[model]\nchannels = [8, 8, 8, 9]\nblocks = [1, 1, 1, 1]", "multiples of 8"),
        ("steps = ", "wrong.toml"),
    ] {
        scene.write("wrong.toml", settings);
        scene.refuses("train depth --shapes shapes --config wrong.toml --out out", &[part]);
    }
    let whole = fs::read(scene.path("shapes/shapes_train.safetensors")).unwrap();
    scene.write("shapes/shapes_train.safetensors", &whole[..whole.len() - 9]);
    scene.refuses(&format!("{TRAIN} --out out"), &["shapes_train.safetensors"]);
    scene.write("shapes/shapes_train.safetensors", b"not a file of shapes");
    scene.refuses(&format!("{TRAIN} --out out"), &["shapes_train.safetensors"]);
    scene.refuses("bench depth --shapes shapes --weights tiny.toml", &["tiny.toml"]);
    scene.refuses("bench depth --shapes nowhere", &["nowhere"]);

    // a run keeps its settings and its shapes
    scene.write("shapes/shapes_train.safetensors", &whole);
    scene.succeeds(&format!("{TRAIN} --steps 1 --out run"));
    scene.refuses("train depth --out run --resume --steps 5", &["--steps"]);
    scene.write("shapes/shapes_train.safetensors", boxes(&[[1.0, 0.4, 0.5]]));
    scene.refuses("train depth --out run --resume", &["changed"]);
}

#[test]
fn settings_are_printed_and_read_again() {
    let scene = scene();
    let printed = scene.succeeds("train depth --print-config --shapes shapes --steps 77 --seed 5");
    for part in ["steps = 77", "seed = 5", "[optimiser]", "procedural", "[model]", "shapes_val.safetensors"] {
        assert!(printed.contains(part), "no {part:?} in {printed}");
    }
    scene.write("printed.toml", &printed);
    assert_eq!(scene.succeeds("train depth --print-config --config printed.toml"), printed);
    let help = text(&scene.run("train depth --help").stdout);
    assert!(help.contains("--resume built-in"), "{help}");
}
