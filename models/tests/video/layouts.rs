//! The same film in every layout is the same clip.

use std::fs;

use gradreel_models::video::{Foreground, Format, inspect};
use serde_json::{Value, json};

use super::builder::has;
use super::rig::{
    FRAMES, LENS, Place, RATE, SIZE, camera_folders, colmap, folder, open, paint_mask, places, real_capture, reference,
    rotated, same, save, transforms, transforms_images, y_to_z,
};

#[test]
fn transforms_in_seconds() {
    let builder = folder();
    transforms_images(&builder.root, true);
    save(&builder.root, "transforms.json", transforms(|frame| json!(frame as f64 / RATE)).to_string());
    same(&open(&builder.root).unwrap(), &reference());
    let inventory = inspect(&builder.root).unwrap();
    assert!(inventory.is_complete() && inventory.layout == Format::Transforms, "{inventory}");
    has(&inventory.to_string(), &["NeRF", "up is z", "a unit is 1 m", "seconds", "camera 1 (images/c1_000.png)"]);
}

#[test]
fn transforms_of_splits_with_shares_of_a_duration() {
    let builder = folder();
    transforms_images(&builder.root, true);
    let whole = transforms(|frame| json!(frame as f64 / (FRAMES - 1) as f64));
    // the third camera is for tests only, and validation repeats an image of the training
    let frames = whole["frames"].as_array().unwrap();
    let third = |entry: &&Value| entry["file_path"].as_str().unwrap().contains("c2_");
    let split = |name: &str, frames: Vec<Value>| {
        let mut list = whole.clone();
        list["frames"] = frames.into();
        save(&builder.root, name, list.to_string());
    };
    split("transforms_train.json", frames.iter().filter(|e| !third(e)).cloned().collect());
    split("transforms_test.json", frames.iter().filter(third).cloned().collect());
    split("transforms_val.json", vec![frames[0].clone()]);
    let seconds = (FRAMES - 1) as f64 / RATE;
    save(&builder.root, "clip.toml", format!("duration_s = {seconds}"));
    same(&open(&builder.root).unwrap(), &reference());
    let text = inspect(&builder.root).unwrap().to_string();
    has(&text, &["shares of", "1 entries that are listed twice alike"]);
    save(&builder.root, "clip.toml", format!("frames_per_s = {RATE}"));
    same(&open(&builder.root).unwrap(), &reference());
}

/// D-NeRF's form: one angle of view, the size taken from the images, square pixels and a central principal point.
#[test]
fn transforms_by_angle_and_without_times() {
    let builder = folder();
    transforms_images(&builder.root, true);
    let mut list = transforms(|_| Value::Null);
    for key in ["fl_x", "fl_y", "cx", "cy", "w", "h", "camera_model"] {
        list.as_object_mut().unwrap().remove(key);
    }
    list["camera_angle_x"] = json!(2.0 * (12.0f64 / 30.0).atan());
    save(&builder.root, "transforms.json", list.to_string());
    let clip = open(&builder.root).unwrap();
    let mut wanted = reference();
    for camera in &mut wanted.cameras {
        (camera.fy, camera.cx, camera.cy) = (30.0, 12.0, 8.0);
    }
    same(&clip, &wanted);
    has(&inspect(&builder.root).unwrap().to_string(), &["no times are listed", "24.0000 frames per second"]);
}

#[test]
fn masks_of_other_layouts() {
    let wanted = reference();
    let builder = folder();
    transforms_images(&builder.root, false);
    let mut list = transforms(|frame| json!(frame as f64 / RATE));
    save(&builder.root, "transforms.json", list.to_string());
    has(&open(&builder.root).unwrap_err().to_string(), &["camera 0", "opaque", "masks/"]);
    for camera in 0..3 {
        for frame in 0..FRAMES {
            paint_mask(&builder.root.join(format!("masks/c{camera}_{frame:03}.png")));
        }
    }
    let clip = open(&builder.root).unwrap();
    assert!(clip.foreground.iter().all(|&f| f == Foreground::Mask));
    same(&clip, &wanted);
    // … or where the list says, for one camera
    for frame in 0..FRAMES {
        let from = builder.root.join(format!("masks/c1_{frame:03}.png"));
        fs::create_dir_all(builder.root.join("other")).unwrap();
        fs::rename(from, builder.root.join(format!("other/{frame}.png"))).unwrap();
    }
    has(&open(&builder.root).unwrap_err().to_string(), &["camera 1", "opaque"]);
    for entry in list["frames"].as_array_mut().unwrap() {
        let path = entry["file_path"].as_str().unwrap().to_owned();
        if path.contains("c1_") {
            let frame: i64 = path[path.len() - 3..].parse().unwrap();
            entry["mask_path"] = json!(format!("other/{frame}.png"));
        }
    }
    save(&builder.root, "transforms.json", list.to_string());
    same(&open(&builder.root).unwrap(), &wanted);
    fs::remove_file(builder.root.join("masks/c0_002.png")).unwrap();
    has(&open(&builder.root).unwrap_err().to_string(), &["camera 0 has masks for some frames only", "0–1 and 3"]);
}

/// A model in units of 0.4 m, tilted and moved, from numbers that start at 10 and count by 5.
#[test]
fn a_colmap_model_with_a_side_file() {
    for (model, base) in [("sparse/0", "frames"), ("sparse", "images"), ("colmap/sparse/0", "")] {
        let builder = folder();
        let (sin, cos) = 0.35f64.sin_cos();
        // about a horizontal axis, so that turning upright by the shortest way undoes it
        let turn = [cos, 0.6 * sin, 0.0, 0.8 * sin];
        let (unit, origin) = (0.4, [3.0, -1.0, 0.5]);
        let moved: Vec<_> = places().iter().map(|place| place.seen_from(turn, unit, origin)).collect();
        colmap(&builder.root, model, &moved);
        camera_folders(&builder.root, base, 10, 5, true);
        let up = rotated(turn, [0.0, 1.0, 0.0]);
        let side = format!("up = {up:?}\nmetres_per_unit = {unit}\norigin = {origin:?}\nframes_per_s = {RATE:?}\n");
        save(&builder.root, "clip.toml", side);
        same(&open(&builder.root).unwrap(), &reference());
        let text = inspect(&builder.root).unwrap().to_string();
        has(&text, &["COLMAP", "numbers 10, 15, …", "a unit is 0.4 m (clip.toml)", "cam2): 24 × 16"]);
    }
}

/// Cameras held upright on a ring that look down alike: their mean is up.
#[test]
fn a_colmap_model_alone_takes_up_from_the_cameras() {
    let builder = folder();
    let ring: Vec<_> = (0..3)
        .map(|k| {
            let half = std::f64::consts::PI * f64::from(k) / 3.0;
            // upright and looking along −z is half a turn about x in COLMAP's axes; then pitch, then around
            let (pitch, around) = ((0.2f64).sin_cos(), half.sin_cos());
            let place = Place { q: [0.0, 1.0, 0.0, 0.0], centre: [0.0; 3] };
            let place = place.seen_from([pitch.1, -pitch.0, 0.0, 0.0], 1.0, [0.0, 0.5, 2.0]);
            place.seen_from([around.1, 0.0, around.0, 0.0], 1.0, [0.0; 3])
        })
        .collect();
    let wanted: Vec<_> = ring.iter().map(|place| place.c2w()).collect();
    let laid: Vec<_> = ring.iter().map(|place| place.seen_from(y_to_z(), 1.0, [0.0; 3])).collect();
    colmap(&builder.root, "sparse/0", &laid);
    camera_folders(&builder.root, "frames", 0, 1, true);
    let clip = open(&builder.root).unwrap();
    for (camera, wanted) in clip.cameras.iter().zip(&wanted) {
        let apart = camera.c2w.iter().flatten().zip(wanted.iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f64::max) < 1e-9, "{camera:?} {wanted:?}");
    }
    assert!((clip.frame_dt() - 1.0 / 24.0).abs() < 1e-12);
    let text = inspect(&builder.root).unwrap().to_string();
    has(
        &text,
        &["up is z, the mean of the cameras' upward directions", "metres_per_unit", "24.0000 frames per second"],
    );
}

#[test]
fn spring_gaus_synthetic() {
    let builder = folder();
    let [fx, fy, cx, cy] = LENS;
    let camera = |(camera, place): (usize, Place)| {
        let mut c2w = place.c2w().map(Vec::from).to_vec();
        c2w.push(vec![0.0, 0.0, 0.0, 1.0]);
        json!({"camera": format!("cam{camera}"), "K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "c2w": c2w})
    };
    let list: Vec<Value> = places().into_iter().enumerate().map(camera).collect();
    save(&builder.root, "camera.json", Value::from(list).to_string());
    camera_folders(&builder.root, "", 0, 1, true);
    let mut wanted = reference();
    wanted.times = (0..FRAMES).map(|frame| 0.03 * frame as f64).collect();
    same(&open(&builder.root).unwrap(), &wanted);
    assert_eq!(inspect(&builder.root).unwrap().layout, Format::SpringGaus);
}

/// Calibration with rotation vectors, z down, and masks; two sequences, so that the file must be given.
#[test]
fn spring_gaus_real_capture() {
    let builder = folder();
    let (calibration, sequence) = real_capture(&builder.root);
    save(&builder.root, "dynamic/cameras_calib.json", calibration.to_string());
    save(&builder.root, "dynamic/sequences/bun/0.json", sequence.to_string());
    let mut wanted = reference();
    wanted.times = (0..FRAMES).map(|frame| frame as f64 / 120.0).collect();
    same(&open(&builder.root).unwrap(), &wanted);
    save(&builder.root, "dynamic/sequences/bun/1.json", sequence.to_string());
    has(&open(&builder.root).unwrap_err().to_string(), &["several sequences", "bun/0.json", "bun/1.json"]);
    let clip = open(&builder.root.join("dynamic/sequences/bun/1.json")).unwrap();
    assert_eq!(clip.name, "bun-1");
    same(&clip, &wanted);
}

#[test]
fn a_folder_of_several_layouts_says_so() {
    let builder = folder();
    transforms_images(&builder.root, true);
    save(&builder.root, "transforms.json", transforms(|frame| json!(frame as f64 / RATE)).to_string());
    colmap(&builder.root, "colmap/sparse/0", &places());
    camera_folders(&builder.root, "frames", 0, 1, true);
    let inventory = inspect(&builder.root).unwrap();
    assert_eq!(inventory.layout, Format::Transforms);
    has(&inventory.to_string(), &["could also be colmap", "clip.toml"]);
    save(&builder.root, "clip.toml", "layout = \"colmap\"\nup = \"y\"\n");
    let clip = open(&builder.root).unwrap();
    same(&clip, &reference());
    assert_eq!(inspect(&builder.root).unwrap().layout, Format::Colmap);
    assert_eq!((clip.cameras[0].width, clip.cameras[0].height), SIZE);
    save(&builder.root, "clip.toml", "layout = \"pac_nerf\"");
    has(&open(&builder.root).unwrap_err().to_string(), &["pac_nerf", "no such image list"]);
}
