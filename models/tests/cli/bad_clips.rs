//! Clips that are broken in one place: refused with the place and a way out, before anything is written.

use std::fs;

use serde_json::Value;

use crate::scene::Scene;

const RUN: &str = "reconstruct clip --out out --config quick.toml";

fn paint(scene: &Scene, file: &str, (width, height): (u32, u32)) {
    let file = fs::File::create(scene.path(file)).unwrap();
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&vec![90; (width * height * 3) as usize]).unwrap();
}

#[test]
fn a_folder_that_is_not_there() {
    Scene::new().refuses("reconstruct nowhere --out out", &["nowhere", "all_data.json"]);
    Scene::new().refuses("reconstruct quick.toml", &["quick.toml", "a file"]);
}

#[test]
fn a_list_that_is_not_json() {
    let scene = Scene::with_clip(&[0, 3], 2);
    scene.write("clip/all_data.json", "[{\"file_path\": ");
    scene.refuses(RUN, &["all_data.json", "line 1"]);
    scene.write("clip/all_data.json", "");
    scene.refuses(RUN, &["all_data.json"]);
    fs::remove_file(scene.path("clip/all_data.json")).unwrap();
    scene.refuses(RUN, &["all_data.json"]);
}

#[test]
fn a_truncated_image() {
    let scene = Scene::with_clip(&[0, 3], 2);
    let whole = fs::read(scene.path("clip/data/r_3_1.png")).unwrap();
    scene.write("clip/data/r_3_1.png", &whole[..whole.len() / 2]);
    scene.refuses(RUN, &["r_3_1.png", "decode"]);
}

#[test]
fn an_image_of_another_size() {
    let scene = Scene::with_clip(&[0, 3], 2);
    paint(&scene, "clip/data/r_3_1.png", (80, 192));
    scene.refuses(RUN, &["r_3_1.png", "80 × 192", "192 × 192"]);
}

#[test]
fn a_camera_without_background() {
    let scene = Scene::with_clip(&[0, 3], 2);
    fs::remove_file(scene.path("clip/data/r_3_-1.png")).unwrap();
    scene.refuses(RUN, &["camera 3", "r_3_-1.png"]);
}

#[test]
fn a_scene_without_an_object() {
    let scene = Scene::with_clip(&[0, 3], 2);
    for frame in 0..2 {
        fs::copy(scene.path("clip/data/r_3_-1.png"), scene.path(&format!("clip/data/r_3_{frame}.png"))).unwrap();
    }
    scene.refuses(RUN, &["clip", "camera 3 never sees an object"]);
}

#[test]
fn a_missing_frame() {
    let scene = Scene::with_clip(&[0, 3], 4);
    fs::remove_file(scene.path("clip/data/r_3_2.png")).unwrap();
    scene.refuses(RUN, &["r_3_2.png", "frame 2 is missing"]);
}

#[test]
fn frames_at_uneven_times() {
    let scene = Scene::with_clip(&[0, 3], 4);
    let list = fs::read(scene.path("clip/all_data.json")).unwrap();
    let mut list: Vec<Value> = serde_json::from_slice(&list).unwrap();
    list.iter_mut().filter(|e| e["file_path"] == "./data/r_3_2.png").for_each(|e| e["time"] = 0.5.into());
    scene.write("clip/all_data.json", Value::from(list).to_string());
    scene.refuses(RUN, &["all_data.json", "synchronous"]);
}

#[test]
fn a_single_frame() {
    Scene::with_clip(&[0, 3], 1).refuses(RUN, &["clip", "two frames"]);
}

/// The object is at about y = 0.4 m, the cameras a metre or two away.
#[test]
fn a_ground_far_from_what_the_cameras_see() {
    let scene = Scene::with_clip(&[0, 3], 2);
    for (height, found) in [("1e9", "y = 1000000000.0 m"), ("-500", "y = -500.0 m"), ("1e300", "y = 1e300 m")] {
        scene.refuses(&format!("{RUN} --ground {height}"), &["the ground is far", found, "--ground auto"]);
    }
    scene.write("quick.toml", "[world]\nground = -500.0\n");
    scene.refuses(RUN, &["the ground is far", "y = -500.0 m"]);
}

#[test]
fn settings_that_are_no_text() {
    let scene = Scene::with_clip(&[0, 3], 2);
    scene.write("latin.toml", b"# caf\xe9\n[world]\nground = 0.0\n");
    scene.refuses("reconstruct clip --out out --config latin.toml", &["latin.toml", "UTF-8"]);
    scene.refuses("reconstruct clip --out out --config clip", &["clip", "a folder", "--config"]);
    scene.write("wide.toml", b"\xff\xfe[\0");
    scene.refuses("reconstruct clip --out out --config wide.toml", &["wide.toml", "UTF-16"]);
    // a byte order mark is no fault: the settings behind it hold
    scene.write("marked.toml", "\u{feff}[world]\nground = -500.0\n");
    scene.refuses("reconstruct clip --out out --config marked.toml", &["the ground is far"]);
}

#[test]
fn an_output_folder_with_something_in_it() {
    let scene = Scene::with_clip(&[0, 3], 2);
    fs::create_dir(scene.path("out")).unwrap();
    scene.write("out/config.toml", "mine");
    scene.refuses(RUN, &["out", "not empty", "--resume"]);
    scene.refuses("reconstruct clip --out quick.toml", &["quick.toml", "file"]);
}
