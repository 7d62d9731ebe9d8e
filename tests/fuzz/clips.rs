//! The lists of calibrated clips: the pictures are whole, a text file beside them is not.

use std::fs;
use std::path::Path;

use gradreel_models::video::{Clip, OpenOptions, inspect};
use serde_json::{Value, json};

use crate::builder::Builder;
use crate::harness::fuzz;
use crate::mutate::TEXTS;
use crate::rig::{LENS, RATE, camera_folders, colmap, folder, places, save, transforms, transforms_images};

/// Looks at a clip and opens it: what is told to be complete opens, or says why not.
fn read(root: &Path) -> bool {
    drop(inspect(root));
    Clip::open(root, &OpenOptions::default()).is_ok()
}

/// A file of a clip that is written anew for each mutation.
fn fuzz_file(target: &str, clip: &Builder, name: &str, more: &[&str]) {
    let path = clip.root.join(name);
    let mut seeds = vec![fs::read(&path).unwrap()];
    seeds.extend(more.iter().map(|text| text.as_bytes().to_vec()));
    fuzz(target, &seeds, &TEXTS, |bytes| {
        fs::write(&path, bytes).unwrap();
        read(&clip.root)
    });
}

#[test]
fn all_data() {
    let clip = Builder::square(&[0, 1], 2);
    clip.image('r', 0, -1, false, &|_, _| [90; 4]);
    clip.save();
    fuzz_file("all-data", &clip, "all_data.json", &[]);
}

#[test]
fn transforms_json() {
    let clip = folder();
    transforms_images(&clip.root, true);
    let angle = json!({"camera_angle_x": 0.8, "frames": transforms(|_| Value::Null)["frames"]}).to_string();
    save(&clip.root, "transforms.json", transforms(|frame| json!(frame as f64 / RATE)).to_string());
    fuzz_file("transforms", &clip, "transforms.json", &[&angle]);
}

#[test]
fn colmap_images() {
    let clip = folder();
    colmap(&clip.root, "sparse/0", &places());
    camera_folders(&clip.root, "frames", 0, 1, true);
    save(&clip.root, "clip.toml", format!("frames_per_s = {RATE:?}\nmetres_per_unit = 1.0\nup = \"y\"\n"));
    fuzz_file("colmap-images", &clip, "sparse/0/images.txt", &[]);
}

#[test]
fn colmap_cameras() {
    let clip = folder();
    colmap(&clip.root, "sparse/0", &places());
    camera_folders(&clip.root, "frames", 0, 1, true);
    save(&clip.root, "clip.toml", format!("frames_per_s = {RATE:?}\nmetres_per_unit = 1.0\nup = \"y\"\n"));
    let [fx, _, cx, cy] = LENS;
    let simple = format!("1 SIMPLE_PINHOLE 24 16 {fx} {cx} {cy}\n");
    fuzz_file("colmap-cameras", &clip, "sparse/0/cameras.txt", &[&simple]);
}

#[test]
fn clip_toml() {
    let clip = folder();
    colmap(&clip.root, "sparse/0", &places());
    camera_folders(&clip.root, "frames", 0, 1, true);
    let side = "layout = \"colmap\"\nup = [0.0, 1.0, 0.0]\nmetres_per_unit = 0.4\norigin = [3.0, -1.0, 0.5]\nframes_per_s = 24.0\n";
    save(&clip.root, "clip.toml", side);
    fuzz_file("clip-toml", &clip, "clip.toml", &["up = \"y\"\nduration_s = 1.5\nimagined = [2]\n"]);
}
