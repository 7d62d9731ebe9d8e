//! Scenes, and what the folder of a run holds.

use std::fs;

use gradreel_models::identify::{Config, Run};
use gradreel_models::physics::{Law, WgslLaw};
use gradreel_models::runtime::run_folder::RunFolder;
use gradreel_models::scenes::SceneFile;
use gradreel_models::video::{Clip, OpenOptions};

use crate::builder::Builder;
use crate::harness::fuzz;
use crate::mutate::TEXTS;

fn text(bytes: &[u8]) -> Option<&str> {
    str::from_utf8(bytes).ok()
}

#[test]
fn scenes() {
    let seeds =
        ["rubber", "sand", "several", "water"].map(|name| fs::read(format!("examples/scenes/{name}.toml")).unwrap());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    fuzz("scene", &seeds, &TEXTS, |bytes| {
        fs::write(&path, bytes).unwrap();
        SceneFile::read(&path).is_ok()
    });
}

#[test]
fn settings_of_runs() {
    let whole = Config::default().to_toml().unwrap();
    let few =
        "[clip]\nshrink = 5\n[geometry]\ndx = 0.05\n[geometry.fit]\niterations = 6\n[material]\nname = \"elastic\"\n";
    let seeds = [whole, few.to_owned()].map(String::into_bytes);
    fuzz("config", &seeds, &TEXTS, |bytes| text(bytes).is_some_and(|text| Config::parse(text).is_ok()));
}

#[test]
fn states_of_runs() {
    let mut clip = Builder::square(&[0, 1], 2);
    clip.save();
    let clip = {
        let opened = Clip::open(&clip.root, &OpenOptions::default()).unwrap();
        clip.entries.clear();
        opened
    };
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("run");
    drop(Run::create(RunFolder::create(&root).unwrap(), Config::default(), &clip).unwrap());
    let path = root.join("state.json");
    let seeds = [fs::read(&path).unwrap()];
    fuzz("state", &seeds, &TEXTS, |bytes| {
        fs::write(&path, bytes).unwrap();
        RunFolder::open(&root).and_then(Run::open).is_ok()
    });
}

/// Laws in WGSL, parsed, lowered and traced with their derivative.
#[test]
fn laws() {
    let shipped = ["fixed_corotated", "newtonian", "snow", "von_mises"].map(|name| format!("models/laws/{name}.wgsl"));
    let examples = ["ogden", "maxwell", "fibres"].map(|name| format!("examples/laws/{name}.wgsl"));
    let seeds: Vec<Vec<u8>> = shipped.iter().chain(&examples).map(|path| fs::read(path).unwrap()).collect();
    let words: [&[u8]; 14] = [
        b"for (var i = 0; i < 1000; i++) {",
        b"loop {",
        b"if p.young > 1.0 {",
        b"return ",
        b"array<f32, 100000>",
        b"f64",
        b"vec4(",
        b"/*",
        b"{",
        b"}",
        b"svd(",
        b"i32(",
        b" 99999999999999999999 ",
        b"/// x [-], linear, ",
    ];
    fuzz("law", &seeds, &words, |bytes| {
        text(bytes).is_some_and(|text| WgslLaw::parse("law.wgsl", text).map(Law::of).is_ok())
    });
}
