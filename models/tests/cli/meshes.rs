//! `gradreel train novel-view --objects`: a training on meshes, that it goes on and is evaluated with the same ones, and what is
//! refused.

use std::fs;

use crate::mesh_files::{cube, cube_glb, obj};
use crate::scene::{Scene, text};
use crate::trained::TINY;

const RUN: &str = "train novel-view --config tiny.toml --objects things --out run";

/// Boxes in colours, the textured cube, and two files that cannot be used.
fn scene() -> Scene {
    let scene = Scene::new();
    scene.write("tiny.toml", TINY);
    fs::create_dir_all(scene.path("things/boxes")).unwrap();
    for number in 0..5 {
        let mut model = cube();
        model.uvs.clear();
        model.places.iter_mut().for_each(|x| x[1] *= 0.4 + 0.2 * number as f32);
        model.colours = vec![[0.2 * number as f32, 0.4, 0.6]; 24];
        scene.write(&format!("things/boxes/{number}.obj"), obj(&model, ""));
    }
    scene.write("things/cube.glb", cube_glb());
    scene.write("things/cut.glb", &cube_glb()[..400]);
    scene.write("things/out.obj", "mtllib ../tiny.toml\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    scene
}

#[test]
fn meshes_are_trained_on_and_shown() {
    let scene = scene();
    let output = scene.run(RUN);
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{told}");
    for part in [
        "6 meshes: 5 to train on, 1 never",
        "2 files cannot be used",
        "at: cut.glb",
        "at: out.obj: ../tiny.toml",
        "cut short",
    ] {
        assert!(told.contains(part), "no {part:?} in {told}");
    }
    let table = fs::read_to_string(scene.path("run/meshes.csv")).unwrap();
    let rows: Vec<&str> = table.lines().skip(1).collect();
    let count = |part: &str| rows.iter().filter(|row| row.contains(part)).count();
    assert_eq!(
        [rows.len(), count("\",true,false,12,"), count("\",false,true,12,"), count("\",false,false,,")],
        [8, 5, 1, 2]
    );
    let settings = fs::read_to_string(scene.path("run/settings.toml")).unwrap();
    for part in ["[objects]", "held_out = 0.1", "mark = \"8-"] {
        assert!(settings.contains(part), "no {part:?} in {settings}");
    }
    let evaluate = "train novel-view --weights run/model.safetensors --objects things --config data.toml --evaluate 2";
    scene.write("data.toml", TINY.split("[model]").next().unwrap());
    let output = scene.run(&format!("{evaluate} --out measured"));
    let (table, told) = (text(&output.stdout), text(&output.stderr));
    assert!(table.contains("2 unseen objects") && told.contains("1 never trained on"), "{table}{told}");
    assert_eq!(fs::read_to_string(scene.path("measured/objects.csv")).unwrap().lines().count(), 1 + 2);
    // the settings of the run name the folder themselves
    let again = evaluate.replace("--objects things", "").replace("data.toml", "run/settings.toml");
    assert!(scene.succeeds(&format!("{again} --quiet --out again")).contains("2 unseen objects"));
    assert!(scene.path("again/meshes.csv").is_file());
}

#[test]
fn a_single_mesh_is_trained_on_and_shown_and_that_is_told() {
    let scene = Scene::new();
    scene.write("tiny.toml", TINY);
    fs::create_dir(scene.path("things")).unwrap();
    scene.write("things/cube.glb", cube_glb());
    let output = scene.run(&format!("{RUN} --steps 1"));
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{told}");
    assert!(told.contains("1 mesh to train on; none is held out"), "{told}");
}

/// A training that is resumed, its folder elsewhere by then, is the training that was not interrupted.
#[cfg(unix)]
#[test]
fn a_training_on_meshes_goes_on() {
    let scene = scene();
    let run = "train novel-view --config tiny.toml --objects things --steps 14";
    scene.succeeds(&format!("{run} --quiet --out straight"));
    let mut child = scene.command(&format!("{run} --out stopped")).spawn().unwrap();
    while !scene.path("stopped/state.safetensors").is_file() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it took a step");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let kill = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(kill.unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    fs::rename(scene.path("things"), scene.path("moved")).unwrap();
    scene.refuses("train novel-view --quiet --out stopped --resume", &["things", "meshes"]);
    scene.succeeds("train novel-view --quiet --out stopped --resume --objects moved");
    for file in ["log.csv", "validation.csv", "meshes.csv", "previews/step_0000014.png"] {
        let [ours, theirs] = ["stopped", "straight"].map(|run| fs::read(scene.path(run).join(file)).unwrap());
        assert!(ours == theirs, "{file} differs");
    }
    scene.write("moved/cube.glb", &cube_glb()[1..]);
    scene.refuses("train novel-view --quiet --out stopped --resume --objects moved", &["meshes changed", "meshes.csv"]);
}

#[test]
fn a_share_of_the_samples_is_procedural() {
    let scene = scene();
    let losses = |name: &str, share: Option<f64>| {
        let objects = share.map_or(String::new(), |share| format!("[objects]\nprocedural = {share:?}\n"));
        scene.write("mixed.toml", format!("{TINY}{objects}"));
        let things = if share.is_some() { "--objects things" } else { "" };
        scene.succeeds(&format!("train novel-view --quiet --config mixed.toml {things} --steps 4 --out {name}"));
        let log = fs::read_to_string(scene.path(&format!("{name}/log.csv"))).unwrap();
        let of_row = |row: &str| row.split(',').nth(1).unwrap().to_owned();
        log.lines().skip(1).map(of_row).collect::<Vec<_>>()
    };
    let [made, all, none, half] = [("made", None), ("all", Some(1.0)), ("none", Some(0.0)), ("half", Some(0.5))]
        .map(|(n, share)| losses(n, share));
    assert_eq!(all, made, "with a share of 1 no mesh is trained on");
    assert_ne!(none[0], made[0]);
    assert!(half != all && half != none, "{half:?}");
}

#[test]
fn folders_that_cannot_be_used_are_refused() {
    let scene = scene();
    let run = |folder: &str| format!("train novel-view --config tiny.toml --out out --objects {folder}");
    scene.refuses(&run("nowhere"), &["nowhere", "folder"]);
    scene.refuses(&run("things/cube.glb"), &["things/cube.glb", "no folder"]);
    fs::create_dir(scene.path("empty")).unwrap();
    scene.refuses(&run("empty"), &["no meshes", ".glb"]);
    scene.write("empty/a.glb", "glTF");
    scene.refuses(&run("empty"), &["no mesh in the folder can be used", "a.glb", "cut short"]);
    for (text, part) in [
        ("held_out = 1.5", "held_out"),
        ("held_out = 1.0", "held out"),
        ("held = 1", "held"),
        ("folder = 3", "folder"),
        ("procedural = -0.1", "objects.procedural"),
        ("procedural = nan", "objects.procedural"),
    ] {
        scene.write("wrong.toml", format!("[objects]\n{text}\n"));
        scene.refuses("train novel-view --config wrong.toml --out out --objects things", &[part]);
    }
    scene.write("wrong.toml", "[objects]\nheld_out = 0.2\n");
    scene.refuses("train novel-view --config wrong.toml --out out", &["objects.folder"]);
    scene.succeeds("train novel-view --quiet --config tiny.toml --out plain --steps 1");
    scene.refuses("train novel-view --out plain --resume --objects things", &["procedural", "--objects"]);
    let printed = scene.succeeds("train novel-view --print-config --objects things");
    assert!(printed.contains("[objects]") && printed.contains("things\"") && !printed.contains("mark"), "{printed}");
}
