//! Lists of cameras as other programs write them: with marks, other ends of lines, odd names, and paths of many kinds.

use std::fs;
use std::path::Path;

use gradreel_models::video::{Foreground, inspect};
use serde_json::{Value, json};

use super::builder::{Builder, has, in_square, message};
use super::rig::{
    FRAMES, LENS, RATE, SIZE, camera_folders, colmap, folder, open, paint_mask, places, real_capture, reference, same,
    save, transforms, transforms_images,
};

const MARK: &str = "\u{feff}";

fn seconds(frame: i64) -> Value {
    json!(frame as f64 / RATE)
}

/// Puts a byte order mark in front of a file, and ends its lines as Windows does.
fn mark(root: &Path, name: &str) {
    let text = fs::read_to_string(root.join(name)).unwrap();
    save(root, name, format!("{MARK}{}", text.replace('\n', "\r\n")));
}

/// A model of three cameras, the side file with what it leaves open, and the frames.
fn model(builder: &Builder) {
    colmap(&builder.root, "sparse/0", &places());
    camera_folders(&builder.root, "frames", 0, 1, true);
    save(&builder.root, "clip.toml", format!("up = \"y\"\nframes_per_s = {RATE:?}\n"));
}

/// `camera.json` of cameras that are called so.
fn spring_gaus(names: [Value; 3]) -> Value {
    let [fx, fy, cx, cy] = LENS;
    let entry = |(name, place): (Value, super::rig::Place)| json!({"camera": name, "K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "c2w": place.c2w()});
    names.into_iter().zip(places()).map(entry).collect()
}

#[test]
fn byte_order_marks_in_every_list() {
    let wanted = reference();
    let builder = folder();
    transforms_images(&builder.root, true);
    save(&builder.root, "transforms.json", transforms(seconds).to_string());
    mark(&builder.root, "transforms.json");
    save(&builder.root, "clip.toml", format!("{MARK}up = \"z\"\r\n"));
    same(&open(&builder.root).unwrap(), &wanted);

    let builder = folder();
    model(&builder);
    for name in ["sparse/0/images.txt", "sparse/0/cameras.txt", "clip.toml"] {
        mark(&builder.root, name);
    }
    same(&open(&builder.root).unwrap(), &wanted);

    let mut builder = Builder::square(&[0], 2);
    builder.save();
    mark(&builder.root, "all_data.json");
    assert_eq!(open(&builder.root).unwrap().frame_count(), 2);
    builder.entries.clear();

    let builder = folder();
    camera_folders(&builder.root, "", 0, 1, true);
    save(&builder.root, "camera.json", format!("{MARK}{}", spring_gaus(["cam0", "cam1", "cam2"].map(Value::from))));
    save(&builder.root, "clip.toml", format!("frames_per_s = {RATE:?}"));
    same(&open(&builder.root).unwrap(), &wanted);

    let builder = folder();
    let (calibration, sequence) = real_capture(&builder.root);
    save(&builder.root, "dynamic/cameras_calib.json", format!("{MARK}{calibration}"));
    save(&builder.root, "dynamic/sequences/bun/0.json", format!("{MARK}{sequence}"));
    save(&builder.root, "clip.toml", format!("frames_per_s = {RATE:?}"));
    same(&open(&builder.root).unwrap(), &wanted);
}

#[test]
fn lists_that_are_no_text_are_named() {
    let builder = folder();
    model(&builder);
    for name in ["sparse/0/images.txt", "sparse/0/cameras.txt", "clip.toml"] {
        let whole = fs::read(builder.root.join(name)).unwrap();
        save(&builder.root, name, [&whole[..], b"# caf\xe9\n"].concat());
        has(&message(open(&builder.root).unwrap_err()), &[name, "UTF-8"]);
        save(&builder.root, name, b"\xff\xfe1\0 \0");
        has(&message(open(&builder.root).unwrap_err()), &[name, "UTF-16"]);
        save(&builder.root, name, whole);
    }
    assert!(open(&builder.root).is_ok());
}

/// Numbers, spaces and dots in the names of images, which may be those of folders.
#[test]
fn colmap_names_of_many_kinds() {
    let wanted = reference();
    for names in [["0", "01", "2"], ["0", "01", "2 2 2"], ["cam 0.png", "cam 1.JPG", "cam 2"], ["a.0", "a.1", "a.2"]] {
        let builder = folder();
        let root = &builder.root;
        model(&builder);
        let mut images = fs::read_to_string(root.join("sparse/0/images.txt")).unwrap();
        for (camera, name) in names.into_iter().enumerate() {
            let frames = name.trim_end_matches(".png").trim_end_matches(".JPG");
            fs::rename(root.join(format!("frames/cam{camera}")), root.join("frames").join(frames)).unwrap();
            images = images.replace(&format!(" cam{camera}.png"), &format!(" {name}"));
        }
        save(root, "sparse/0/images.txt", &images);
        same(&open(root).unwrap(), &wanted);
        // without the blank line of an image that has no points
        save(root, "sparse/0/images.txt", images.replace("\n\n", "\n"));
        same(&open(root).unwrap(), &wanted);
    }
}

#[test]
fn a_colmap_image_without_frames_is_named() {
    let builder = folder();
    model(&builder);
    let path = builder.root.join("sparse/0/images.txt");
    let images = fs::read_to_string(&path).unwrap();
    fs::write(&path, images + "9 1 0 0 0 0 0 0 1 07\n\n10 1 0 0 0 0 0 0 77 over there.png\n\n").unwrap();
    same(&open(&builder.root).unwrap(), &reference());
    has(&inspect(&builder.root).unwrap().to_string(), &["3 cameras", "2 images", "left out: 07, over there.png"]);
}

#[test]
fn a_colmap_camera_that_is_not_used_may_be_anything() {
    let builder = folder();
    model(&builder);
    let path = builder.root.join("sparse/0/cameras.txt");
    let cameras = fs::read_to_string(&path).unwrap();
    fs::write(&path, cameras + "2 OPENCV 24 16 30 31 12.5 7.75 0.1 0 0 0\n3 THIN_PRISM_FISHEYE 24 16 1\n4 PINHOLE\n")
        .unwrap();
    same(&open(&builder.root).unwrap(), &reference());
    let path = builder.root.join("sparse/0/images.txt");
    let images = fs::read_to_string(&path).unwrap();
    for (used, line, part) in [(2, 3, "distortion"), (3, 4, "THIN_PRISM_FISHEYE"), (4, 5, "2 words")] {
        fs::write(&path, images.replace(" 1 cam1.png", &format!(" {used} cam1.png"))).unwrap();
        let place = format!("cameras.txt, line {line}");
        has(&message(open(&builder.root).unwrap_err()), &[&place, part]);
    }
}

/// A path may be absolute or climb, if it ends inside the folder.
#[test]
fn paths_that_end_inside_the_folder() {
    let wanted = reference();
    let builder = folder();
    transforms_images(&builder.root, true);
    let name = builder.root.file_name().unwrap().to_string_lossy().into_owned();
    let root = builder.root.display().to_string();
    for before in [format!("{root}/"), format!("../{name}/"), "images/../".into(), format!("{root}/../{name}/./")] {
        let mut list = transforms(seconds);
        for entry in list["frames"].as_array_mut().unwrap() {
            let path = entry["file_path"].as_str().unwrap().trim_start_matches("./").to_owned();
            entry["file_path"] = json!(format!("{before}{path}"));
        }
        save(&builder.root, "transforms.json", list.to_string());
        same(&open(&builder.root).unwrap(), &wanted);
    }
    let mut list = transforms(seconds);
    for outside in [format!("{root}/../x.png"), format!("{root}-other/images/c0_000"), format!("../../{name}/x.png")] {
        list["frames"][1]["file_path"] = json!(outside);
        save(&builder.root, "transforms.json", list.to_string());
        has(&message(open(&builder.root).unwrap_err()), &["frame 1", "leaves the clip's folder"]);
    }
    // the folder itself is no file
    list["frames"][1]["file_path"] = json!(root);
    save(&builder.root, "transforms.json", list.to_string());
    has(&message(open(&builder.root).unwrap_err()), &["frame 1", "names no file"]);
}

#[test]
fn absolute_paths_in_the_other_layouts() {
    let wanted = reference();
    let builder = folder();
    let root = builder.root.display().to_string();
    camera_folders(&builder.root, "", 0, 1, true);
    let names = [json!(format!("{root}/cam0")), json!("./cam1"), json!("cam2")];
    save(&builder.root, "camera.json", spring_gaus(names).to_string());
    save(&builder.root, "clip.toml", format!("frames_per_s = {RATE:?}"));
    same(&open(&builder.root).unwrap(), &wanted);
    // the same folder twice is not two cameras
    save(&builder.root, "camera.json", spring_gaus(["cam0", "./cam0", "cam2"].map(Value::from)).to_string());
    has(&message(open(&builder.root).unwrap_err()), &["camera.json, entry 1", "a second camera"]);
    save(&builder.root, "camera.json", spring_gaus(["cam0", "cam1", "cam7"].map(Value::from)).to_string());
    has(&message(open(&builder.root).unwrap_err()), &["camera.json, entry 2", "no folder"]);
    // numbers as names
    for camera in 0..3 {
        fs::rename(builder.root.join(format!("cam{camera}")), builder.root.join(camera.to_string())).unwrap();
    }
    save(&builder.root, "camera.json", spring_gaus([json!(0), json!("1"), json!(2)]).to_string());
    same(&open(&builder.root).unwrap(), &wanted);

    let builder = folder();
    let (calibration, mut sequence) = real_capture(&builder.root);
    save(&builder.root, "dynamic/cameras_calib.json", calibration.to_string());
    save(&builder.root, "clip.toml", format!("frames_per_s = {RATE:?}"));
    let first = sequence["C1"][0].as_str().unwrap().to_owned();
    let images = builder.root.join("dynamic/videos_images/C1");
    sequence["C1"][0] = json!(images.join(&first).display().to_string());
    save(&builder.root, "dynamic/sequences/bun/0.json", sequence.to_string());
    same(&open(&builder.root).unwrap(), &wanted);
    sequence["C1"][1] = json!(first);
    save(&builder.root, "dynamic/sequences/bun/0.json", sequence.to_string());
    has(&message(open(&builder.root).unwrap_err()), &["0.json", "C1", "twice"]);
}

/// The last row of a product of matrices in single precision.
#[test]
fn last_rows_of_little_precision() {
    let builder = folder();
    transforms_images(&builder.root, true);
    let mut list = transforms(seconds);
    for (k, entry) in list["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
        entry["transform_matrix"][3] =
            json!([[0.0, 0.0, 0.0, 1.0000000000000002], [-1e-7, 0.0, 3e-8, 0.9999999]][k % 2]);
    }
    save(&builder.root, "transforms.json", list.to_string());
    same(&open(&builder.root).unwrap(), &reference());
    for row in [[0.0, 0.0, 0.0, 2.0], [0.1, 0.0, 0.0, 1.0]] {
        list["frames"][1]["transform_matrix"][3] = json!(row);
        save(&builder.root, "transforms.json", list.to_string());
        has(&message(open(&builder.root).unwrap_err()), &["frame 1", "fourth row"]);
    }
}

#[test]
fn a_listed_mask_must_exist() {
    let builder = folder();
    transforms_images(&builder.root, true);
    let mut list = transforms(seconds);
    for entry in list["frames"].as_array_mut().unwrap() {
        entry["mask_path"] = json!("masks/none_0.png");
    }
    save(&builder.root, "transforms.json", list.to_string());
    has(&message(open(&builder.root).unwrap_err()), &["mask of camera 0 does not exist", "masks/none_0.png"]);
    let inventory = inspect(&builder.root).unwrap();
    assert!(!inventory.is_complete(), "{inventory}");
    // a folder is no mask
    fs::create_dir_all(builder.root.join("masks/none_0.png")).unwrap();
    has(&message(open(&builder.root).unwrap_err()), &["mask of camera 0 does not exist"]);
}

/// Masks that the list names count where it has no times, too.
#[test]
fn listed_masks_without_times() {
    let builder = folder();
    transforms_images(&builder.root, false);
    let mut list = transforms(|_| Value::Null);
    for (k, entry) in list["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
        paint_mask(&builder.root.join(format!("other/{k}.png")));
        entry["mask_path"] = json!(format!("other/{k}.png"));
    }
    assert_eq!(list["frames"].as_array().unwrap().len() as i64, 3 * FRAMES);
    save(&builder.root, "transforms.json", list.to_string());
    let clip = open(&builder.root).unwrap();
    assert!(clip.foreground.iter().all(|&foreground| foreground == Foreground::Mask));
    same(&clip, &reference());
}

/// Colour type, depth, palette, and a sample where the square is or is not.
type Kind<'a> = (png::ColorType, png::BitDepth, Option<&'a [u8]>, fn(bool) -> Vec<u8>);

/// Writes a mask of the square in one of the ways of segmentation tools; `value` is a sample where the square is or is not.
fn write_mask(
    path: &Path,
    colour: png::ColorType,
    depth: png::BitDepth,
    palette: Option<&[u8]>,
    value: fn(bool) -> Vec<u8>,
) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let (width, height) = SIZE;
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), width as u32, height as u32);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if let Some(palette) = palette {
        encoder.set_palette(palette.to_vec());
    }
    let samples = (0..width * height).flat_map(|i| value(in_square(i % width, i / width)));
    encoder.write_header().unwrap().write_image_data(&samples.collect::<Vec<u8>>()).unwrap();
}

#[test]
fn masks_of_many_kinds() {
    use png::BitDepth::{Eight, Sixteen};
    use png::ColorType::{Grayscale, Indexed, Rgba};
    let wanted = reference();
    let builder = folder();
    let root = &builder.root;
    transforms_images(root, false);
    save(root, "transforms.json", transforms(seconds).to_string());
    let paint = |colour, depth, palette: Option<&[u8]>, value| {
        for (camera, frame) in (0..3).flat_map(|camera| (0..FRAMES).map(move |frame| (camera, frame))) {
            write_mask(&root.join(format!("masks/c{camera}_{frame:03}.png")), colour, depth, palette, value);
        }
    };
    let classes: &[u8] = &[0, 0, 0, 128, 0, 0, 0, 128, 0];
    let kinds: [Kind<'_>; 5] = [
        (Grayscale, Eight, None, |inside| vec![u8::from(inside)]),
        (Indexed, Eight, Some(classes), |inside| vec![u8::from(inside)]),
        (Grayscale, Sixteen, None, |inside| vec![0, if inside { 255 } else { 0 }]),
        (Grayscale, Sixteen, None, |inside| vec![0, u8::from(inside)]),
        (Rgba, Eight, None, |inside| if inside { vec![70, 40, 20, 255] } else { vec![70, 40, 20, 0] }),
    ];
    for (colour, depth, palette, value) in kinds {
        paint(colour, depth, palette, value);
        same(&open(root).unwrap(), &wanted);
        assert!(inspect(root).unwrap().is_complete());
    }
    // numbers of several things: the object is not told, and looking says so, too
    paint(Grayscale, Eight, None, |inside| vec![u8::from(inside)]);
    let mut samples = vec![0u8; SIZE.0 * SIZE.1];
    samples[..3].copy_from_slice(&[1, 2, 3]);
    let mut encoder =
        png::Encoder::new(fs::File::create(root.join("masks/c1_002.png")).unwrap(), SIZE.0 as u32, SIZE.1 as u32);
    encoder.set_color(Grayscale);
    encoder.write_header().unwrap().write_image_data(&samples).unwrap();
    has(&message(open(root).unwrap_err()), &["c1_002.png", "the brightest value is 3 of 255"]);
    let inventory = inspect(root).unwrap();
    assert!(!inventory.is_complete() && inventory.to_string().contains("c1_002.png"), "{inventory}");
}

/// Notes that computers leave beside pictures are no frames.
#[test]
fn hidden_files_in_folders_of_frames() {
    let builder = folder();
    model(&builder);
    for camera in 0..3 {
        save(&builder.root, &format!("frames/cam{camera}/._f_0001.png"), "note");
        save(&builder.root, &format!("frames/cam{camera}/.DS_Store"), "note");
    }
    same(&open(&builder.root).unwrap(), &reference());
    let builder = folder();
    let (calibration, sequence) = real_capture(&builder.root);
    save(&builder.root, "dynamic/cameras_calib.json", calibration.to_string());
    save(&builder.root, "dynamic/sequences/bun/0.json", sequence.to_string());
    save(&builder.root, "dynamic/sequences/bun/._0.json", "note");
    assert_eq!(open(&builder.root).unwrap().cameras.len(), 3);
}
