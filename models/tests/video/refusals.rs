//! Broken clips in other layouts than PAC-NeRF's: each is refused with the place, what was found, and a way out.

use std::fs;

use serde_json::{Value, json};

use super::builder::{has, message};
use super::rig::{RATE, camera_folders, colmap, folder, open, places, save, transforms, transforms_images};

fn seconds(frame: i64) -> Value {
    json!(frame as f64 / RATE)
}

#[test]
fn transforms_entries() {
    let builder = folder();
    transforms_images(&builder.root, true);
    let good = transforms(seconds);
    let identity = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    for (key, value, part) in [
        ("transform_matrix", json!([[1, 0, 0, 0], [0, 1, 0, 0]]), "transform_matrix is 2×4"),
        ("transform_matrix", json!([[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0]]), "not a rotation"),
        ("transform_matrix", json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0]]), "mirrors"),
        ("transform_matrix", json!([[1, 0, 0, null], [0, 1, 0, 0], [0, 0, 1, 0]]), "null"),
        ("time", json!("soon"), "time is"),
        ("k1", json!(0.1), "undistort"),
        ("p2", json!(-1e-9), "undistort"),
        ("camera_model", json!("OPENCV_FISHEYE"), "undistort"),
        ("is_fisheye", json!(true), "fisheye"),
        ("fl_x", json!(-3), "positive"),
        ("fl_x", json!("wide"), "fl_x is"),
        ("w", json!(1e300), "not a number of pixels"),
        ("file_path", json!("../../etc/passwd"), "leaves the clip's folder"),
        ("file_path", json!("/etc/passwd"), "leaves the clip's folder"),
        ("file_path", json!("images/../../x.png"), "leaves the clip's folder"),
        ("file_path", json!("C:\\x.png"), "leaves the clip's folder"),
        ("file_path", json!(7), "file_path is missing"),
        ("mask_path", json!("../mask.png"), "leaves the clip's folder"),
        ("file_path", json!("images/c0_000"), "listed twice"),
    ] {
        let mut list = good.clone();
        list["frames"][1][key] = value;
        save(&builder.root, "transforms.json", list.to_string());
        has(&message(open(&builder.root).unwrap_err()), &["transforms.json, frame 1", part]);
    }
    let mut list = good.clone();
    list["frames"][1]["transform_matrix"] = identity;
    save(&builder.root, "transforms.json", list.to_string());
    has(&message(open(&builder.root).unwrap_err()), &["is missing"]);
    let mut list = good.clone();
    list.as_object_mut().unwrap().remove("fl_x");
    save(&builder.root, "transforms.json", list.to_string());
    has(&message(open(&builder.root).unwrap_err()), &["neither fl_x nor camera_angle_x"]);
    list["camera_angle_x"] = json!(4.0);
    save(&builder.root, "transforms.json", list.to_string());
    has(&message(open(&builder.root).unwrap_err()), &["camera_angle_x is 4, not an angle"]);
}

#[test]
fn transforms_as_a_whole() {
    let builder = folder();
    transforms_images(&builder.root, true);
    let refused = |list: &Value, parts: &[&str]| {
        save(&builder.root, "transforms.json", list.to_string());
        has(&message(open(&builder.root).unwrap_err()), parts);
    };
    refused(&json!([]), &["no list \"frames\""]);
    refused(&json!({"frames": []}), &["no image"]);
    refused(&transforms(|frame| json!(frame as f64 / 3.0)), &["times from 0 to 1", "duration_s"]);
    refused(&transforms(|frame| if frame == 2 { Value::Null } else { seconds(frame) }), &["a time in 9 of 12"]);
    refused(&transforms(|_| json!(0.1)), &["a second image of camera"]);
    // sizes
    let mut list = transforms(seconds);
    list["w"] = json!(48);
    refused(&list, &["another image size", "24 × 16", "48 × 16"]);
    // ragged, late, and moving cameras
    let mut list = transforms(seconds);
    list["frames"].as_array_mut().unwrap().remove(4);
    refused(&list, &["camera 1 has frames 0 and 2–3, frame 1 is missing"]);
    let mut list = transforms(seconds);
    for entry in list["frames"].as_array_mut().unwrap() {
        if entry["file_path"].as_str().unwrap().contains("c1_") {
            entry["time"] = json!(entry["time"].as_f64().unwrap() + 0.005);
        }
    }
    refused(&list, &["not synchronous"]);
    let mut list = transforms(seconds);
    for (k, entry) in list["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
        entry["transform_matrix"][0][3] = json!(k);
    }
    refused(&list, &["the camera moves", "each from a place of its own"]);
    let one = list["frames"][0].clone();
    let many = (0..1030).map(|k| {
        let mut entry = one.clone();
        entry["file_path"] = json!(format!("images/{k}.png"));
        entry["transform_matrix"][0][3] = json!(k);
        entry
    });
    list["frames"] = many.collect();
    refused(&list, &["more than 1024 different poses"]);
    save(&builder.root, "transforms.json", "{\"frames\": [{\"time\": NaN}]}");
    has(&message(open(&builder.root).unwrap_err()), &["NaN is not JSON"]);
    save(&builder.root, "transforms.json", transforms(seconds).to_string());
    fs::remove_file(builder.root.join("images/c2_003.png")).unwrap();
    has(&message(open(&builder.root).unwrap_err()), &["c2_003.png does not exist", "frame 3 is missing"]);
}

#[test]
fn colmap_models() {
    let builder = folder();
    let root = &builder.root;
    let fresh = || {
        colmap(root, "sparse/0", &places());
        fs::read_to_string(root.join("sparse/0/images.txt")).unwrap()
    };
    let images = fresh();
    has(&message(open(root).unwrap_err()), &["no camera of the model has a folder of frames", "cam0.png"]);
    camera_folders(root, "frames", 0, 1, true);
    save(root, "clip.toml", "up = \"y\"");
    assert_eq!(open(root).unwrap().cameras.len(), 3);
    for (from, to, part) in [
        (" 1 cam1.png", " 9 cam1.png", "camera 9"),
        (" 1 cam1.png", " one cam1.png", "\"one\""),
        (" 1 cam1.png", " 1 ../cam1.png", "leaves the clip's folder"),
        (" 1 cam1.png", " cam1.png", "9 words"),
        (" 1 cam1.png", " 1 cam0.png", "another pose for the frames in"),
    ] {
        save(root, "sparse/0/images.txt", images.replace(from, to));
        has(&message(open(root).unwrap_err()), &["images.txt, line 5", part]);
    }
    for (line, part) in [("2 nan 0 0 0 0 0 0 1 cam1.png", "\"nan\""), ("2 1 1 0 0 0 0 0 1 cam1.png", "quaternion")] {
        save(root, "sparse/0/images.txt", line);
        has(&message(open(root).unwrap_err()), &["line 1", part]);
    }
    fresh();
    for (line, part) in [
        ("1 SIMPLE_RADIAL 24 16 30 12 8 0.01", "image_undistorter"),
        ("1 OPENCV_FISHEYE 24 16 30 30 12 8 0 0 0 0", "image_undistorter"),
        ("1 PINHOLE 24 16 30 12 8", "3 parameters"),
        ("1 PINHOLE 24 16 30 inf 12 8", "\"inf\""),
        ("1 PINHOLE 24 99999999999 30 30 12 8", "a side of"),
        ("1 PINHOLE 24 16 30 0 12 8", "positive"),
        ("1 PINHOLE", "2 words"),
    ] {
        save(root, "sparse/0/cameras.txt", line);
        has(&message(open(root).unwrap_err()), &["cameras.txt, line 1", part]);
    }
    save(root, "sparse/0/cameras.txt", "1 OPENCV 24 16 30 31 12 8 0 0 0 0\n");
    assert_eq!(open(root).unwrap().cameras[0].fy, 31.0);
    save(root, "sparse/0/cameras.txt", "1 SIMPLE_PINHOLE 48 32 30 24 16\n");
    has(&message(open(root).unwrap_err()), &["another image size", "48 × 32"]);
    fresh();
    fs::remove_file(root.join("frames/cam2/f_0001.png")).unwrap();
    has(&message(open(root).unwrap_err()), &["camera 2 has frames 0 and 2–3, frame 1 is missing", "frames/cam2"]);
    fs::copy(root.join("frames/cam2/f_0002.png"), root.join("frames/cam2/g_2.png")).unwrap();
    has(&message(open(root).unwrap_err()), &["two images are frame 2", "f_0002.png and g_2.png"]);
    fs::rename(root.join("sparse/0/images.txt"), root.join("sparse/0/images.bin")).unwrap();
    has(&message(open(root).unwrap_err()), &["binary form", "model_converter"]);
}

#[test]
fn spring_gaus_lists() {
    let builder = folder();
    let root = &builder.root;
    camera_folders(root, "", 0, 1, true);
    let good = json!([{"camera": "cam0", "K": [[30, 0, 12], [0, 30, 8], [0, 0, 1]],
                       "c2w": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2]]}]);
    save(root, "camera.json", good.to_string());
    assert_eq!(open(root).unwrap().frame_count(), 4);
    for (key, value, part) in [
        ("camera", json!("../cam0"), "leaves the clip's folder"),
        ("camera", json!(3), "no folder"),
        ("camera", json!([3]), "camera is missing"),
        ("K", json!([[30, 1, 12], [0, 30, 8], [0, 0, 1]]), "skew"),
        ("c2w", json!("here"), "not a list of rows"),
    ] {
        let mut list = good.clone();
        list[0][key] = value;
        save(root, "camera.json", list.to_string());
        has(&message(open(root).unwrap_err()), &["camera.json, entry 0", part]);
    }
    save(root, "camera.json", "[]");
    has(&message(open(root).unwrap_err()), &["0 cameras"]);
}

#[test]
fn side_files() {
    let builder = folder();
    transforms_images(&builder.root, true);
    save(&builder.root, "transforms.json", transforms(seconds).to_string());
    for (text, part) in [
        ("ups = \"y\"", "did you mean `up`?"),
        ("metre_per_unit = 1.0", "did you mean `metres_per_unit`?"),
        ("layout = \"colmp\"", "did you mean `colmap`?"),
        ("up = \"w\"", "up = \"w\""),
        ("up = [0, 0, 0]", "not zero"),
        ("up = [0.0, nan, 1.0]", "up = "),
        ("metres_per_unit = 0.0", "metres_per_unit = 0"),
        ("frames_per_s = -1.0", "frames_per_s"),
        ("duration_s = inf", "duration_s"),
        ("origin = [0.0, inf, 0.0]", "three finite numbers"),
        ("frames_per_s = 2.0\nduration_s = 1.0", "both"),
        ("up", "clip.toml"),
    ] {
        save(&builder.root, "clip.toml", text);
        has(&message(open(&builder.root).unwrap_err()), &["clip.toml", part]);
    }
}

/// Lists with a few characters changed, dropped or doubled are read or refused, and nothing else.
#[test]
fn damaged_lists() {
    let builder = folder();
    let root = &builder.root;
    transforms_images(root, true);
    camera_folders(root, "frames", 0, 1, true);
    colmap(root, "sparse/0", &places());
    save(root, "transforms.json", transforms(seconds).to_string());
    let (mut read, mut refused) = (0, 0);
    for (list, layout) in
        [("transforms.json", "transforms"), ("sparse/0/images.txt", "colmap"), ("sparse/0/cameras.txt", "colmap")]
    {
        let whole = fs::read(root.join(list)).unwrap();
        let mut state = 17u64;
        let mut draw = |bound: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % bound
        };
        save(root, "clip.toml", format!("layout = \"{layout}\"\nup = \"y\""));
        for _ in 0..60 {
            let mut bytes = whole.clone();
            for _ in 0..=draw(3) {
                let at = draw(bytes.len());
                match draw(3) {
                    0 => bytes[at] = b"0123456789-.,[]{}\"e x\n"[draw(22)],
                    1 => drop(bytes.drain(at..(at + 1 + draw(20)).min(bytes.len()))),
                    _ => bytes.insert(at, bytes[at]),
                }
            }
            save(root, list, bytes);
            match open(root) {
                Ok(clip) => read += usize::from(clip.cameras.iter().all(|camera| camera.fx > 0.0)),
                Err(error) => refused += usize::from(message(error).contains("fix")),
            }
        }
        save(root, list, whole);
    }
    assert!(read > 0 && refused > 0 && read + refused == 180, "{read} read, {refused} refused");
}
