//! NeRF and D-NeRF: `transforms.json`, or one file per split, with a pose and an optional time for every image.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde_json::Value;

use super::files::{Files, Kind, count, inside, last_number, mask_beside, with_extension};
use super::poses::{Pose, moving, position};
use super::world::{Clock, Up};
use super::{Reading, View, json, malformed};
use crate::video::image::Image;
use crate::video::matrix;

/// The single file, and the files of the splits, which are read together.
const LISTS: [&str; 4] = ["transforms.json", "transforms_train.json", "transforms_val.json", "transforms_test.json"];
/// Camera models that reduce to a pinhole at zero distortion.
const PINHOLES: [&str; 7] =
    ["PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "FULL_OPENCV", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"];
/// Names of distortion coefficients.
const DISTORTION: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];
/// Default frame rate, without times or a given rate \[1/s\].
const FRAMES_PER_S: f64 = 24.0;
/// Times of different cameras that differ by less than this share of a camera's shortest interval belong to one
/// frame.
const SAME_FRAME: f64 = 0.25;

/// One image of the list.
struct Entry {
    camera: usize,
    time: Option<f64>,
    image: PathBuf,
    mask: Option<PathBuf>,
}

/// The lists that exist in a folder.
pub(super) fn lists(root: &Path) -> Vec<PathBuf> {
    LISTS.iter().map(|name| root.join(name)).filter(|path| path.is_file()).collect()
}

/// Reads all lists of a folder.
pub(super) fn read(root: &Path) -> Result<Reading> {
    let lists = lists(root);
    let mut poses = Vec::new();
    let mut entries: Vec<Entry> = Vec::new();
    let mut at: BTreeMap<PathBuf, usize> = BTreeMap::new();
    let mut repeated = 0;
    for list in &lists {
        let top = json(list)?;
        let Some(frames) = top["frames"].as_array() else {
            return Err(malformed(list, "no list \"frames\"", "an object with a list \"frames\", one entry per image"));
        };
        let mut measured = None;
        for (index, frame) in frames.iter().enumerate() {
            let wrong = |found: String| unusable(list, index, frame, found);
            let (image, mask) = paths(root, frame).map_err(wrong)?;
            let time = match &frame["time"] {
                Value::Null => None,
                value => {
                    Some(value.as_f64().filter(|t| t.is_finite()).ok_or_else(|| wrong(format!("time is {value}")))?)
                }
            };
            let pose = pose(&top, frame, || match measured {
                Some(size) => Ok(size),
                None => first_size(root, frames).inspect(|&size| measured = Some(size)),
            });
            let camera = position(&mut poses, pose.map_err(wrong)?, list)?;
            if let Some(&other) = at.get(&image) {
                let other = &entries[other];
                if other.camera != camera || other.time != time {
                    return Err(wrong("the image is listed twice, with different cameras or times".into()));
                }
                repeated += 1;
                continue;
            }
            at.insert(image.clone(), entries.len());
            entries.push(Entry { camera, time, image, mask });
        }
    }
    let list = lists.first().cloned().unwrap_or_else(|| root.join(LISTS[0]));
    if entries.is_empty() {
        return Err(malformed(&list, "no image", "at least one entry in \"frames\""));
    }
    let mut reading = assemble(root, list, poses, &entries)?;
    if repeated > 0 {
        reading.assumptions.push(format!("{repeated} entries that are listed twice alike are read once"));
    }
    Ok(reading)
}

fn assemble(root: &Path, list: PathBuf, poses: Vec<Pose>, entries: &[Entry]) -> Result<Reading> {
    let timed = entries.iter().filter(|entry| entry.time.is_some()).count();
    if timed != 0 && timed != entries.len() {
        return Err(malformed(
            &list,
            format!("a time in {timed} of {} entries", entries.len()),
            "a time in all, or in none",
        ));
    }
    let name = |camera: usize| {
        let first = entries.iter().find(|entry| entry.camera == camera).map(|entry| entry.image.as_path());
        first.and_then(|path| path.strip_prefix(root).ok()).map_or_else(String::new, |path| path.display().to_string())
    };
    let mut assumptions = Vec::new();
    let (times, files, clock) = if timed == 0 {
        let mut cameras = vec![BTreeMap::new(); poses.len()];
        let alone = entries.len() == poses.len();
        for entry in entries {
            let number = if alone { Some(0) } else { last_number(&entry.image) };
            let Some(number) = number else {
                let found = format!("neither a time nor a number in {}", entry.image.display());
                return Err(malformed(&list, found, "\"time\" in each entry, or frame numbers in the file names"));
            };
            if cameras[entry.camera].insert(number, entry.image.clone()).is_some() {
                let found = format!("two images of camera {} with the number {number}", entry.camera);
                return Err(malformed(&list, found, "\"time\" in each entry, or frame numbers in the file names"));
            }
        }
        let masks: BTreeMap<&Path, Option<&PathBuf>> =
            entries.iter().map(|entry| (entry.image.as_path(), entry.mask.as_ref())).collect();
        let counted = count(&cameras, |image| masks.get(image).copied().flatten().cloned());
        assumptions.extend(counted.said);
        if !alone {
            assumptions.push("no times are listed: frames by the last number in the file names".to_owned());
        }
        (counted.times, counted.files, Clock::Counted { per_s: FRAMES_PER_S })
    } else {
        let (times, files) = by_time(&list, poses.len(), entries)?;
        let all = || entries.iter().filter_map(|entry| entry.time);
        let first = all().fold(f64::INFINITY, f64::min);
        let last = all().fold(f64::NEG_INFINITY, f64::max);
        let unit = first >= 0.0 && last <= 1.0 + 1e-9;
        let whole = first <= 1e-9 && last >= 1.0 - 1e-9;
        (times, files, if unit { Clock::Unit { whole } } else { Clock::Seconds })
    };
    let views = (0..).zip(poses).zip(times).map(|((camera, pose), times)| {
        let Pose { c2w, intrinsic, size } = pose;
        (camera as i64, View { name: name(camera), c2w, intrinsic, size, times })
    });
    Ok(Reading {
        views: views.collect(),
        files,
        list,
        axes: "OpenGL axes: x right, y up, looking along −z; cameras numbered in the order of the list",
        up: Up::Custom([0.0, 0.0, 1.0]),
        metres: false,
        clock,
        assumptions,
    })
}

/// Frames by time: times closer than a share of the shortest interval of any camera form one frame.
fn by_time(list: &Path, cameras: usize, entries: &[Entry]) -> Result<(Vec<BTreeMap<i64, f64>>, Files)> {
    let mut order: Vec<(f64, &Entry)> = entries.iter().map(|entry| (entry.time.unwrap_or(0.0), entry)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut latest = vec![f64::NEG_INFINITY; cameras];
    let mut shortest = f64::INFINITY;
    for &(time, entry) in &order {
        let gap = time - latest[entry.camera];
        if gap > 0.0 {
            shortest = shortest.min(gap);
        }
        latest[entry.camera] = time;
    }
    let span = order[order.len() - 1].0 - order[0].0;
    if shortest.is_infinite() && span > 0.0 {
        return Err(moving(list, format!("{} images at different times, each from a place of its own", entries.len())));
    }
    let tolerance = if shortest.is_finite() { SAME_FRAME * shortest } else { 0.0 };
    let mut times = vec![BTreeMap::new(); cameras];
    let mut files = BTreeMap::new();
    let (mut frame, mut since) = (0, order[0].0);
    for (time, entry) in order {
        if time - since > tolerance {
            (frame, since) = (frame + 1, time);
        }
        let camera = entry.camera as i64;
        if times[entry.camera].insert(frame, time).is_some() {
            let found = format!("a second image of camera {camera} at {time}: {}", entry.image.display());
            return Err(malformed(list, found, "one image of a camera at each time"));
        }
        files.insert((Kind::Image, camera, frame), entry.image.clone());
        if let Some(mask) = &entry.mask {
            files.insert((Kind::Mask, camera, frame), mask.clone());
        }
    }
    Ok((times, Files::Listed(files)))
}

fn paths(root: &Path, frame: &Value) -> Result<(PathBuf, Option<PathBuf>), String> {
    let listed = frame["file_path"].as_str().ok_or("file_path is missing or not a string")?;
    let image = with_extension(root.join(inside(root, listed)?));
    let mask = match &frame["mask_path"] {
        Value::Null => mask_beside(root, &image),
        Value::String(listed) => Some(with_extension(root.join(inside(root, listed)?))),
        other => return Err(format!("mask_path is {other}, not a string")),
    };
    Ok((image, mask))
}

/// Width and height of the first existing image.
fn first_size(root: &Path, frames: &[Value]) -> Result<(usize, usize), String> {
    let exists = frames.iter().filter_map(|frame| paths(root, frame).ok()).find(|(image, _)| image.is_file());
    let (image, _) = exists.ok_or("no width \"w\", and none of the listed images exists to take it from")?;
    Image::frame_size(&image).map_err(|error| error.to_string())
}

fn pose(top: &Value, frame: &Value, measure: impl FnOnce() -> Result<(usize, usize), String>) -> Result<Pose, String> {
    let given = |key: &str| if frame[key].is_null() { &top[key] } else { &frame[key] };
    let number = |key: &str| match given(key) {
        Value::Null => Ok(None),
        value => match value.as_f64().filter(|x| x.is_finite()) {
            Some(x) => Ok(Some(x)),
            None => Err(format!("{key} is {value}, not a finite number")),
        },
    };
    for key in DISTORTION {
        if number(key)?.is_some_and(|k| k != 0.0) {
            return Err(format!("lens distortion, {key} = {}; undistort the images first", given(key)));
        }
    }
    match given("camera_model") {
        Value::Null => {}
        Value::String(model) if PINHOLES.contains(&model.to_uppercase().as_str()) => {}
        other => return Err(format!("camera_model {other}; undistort the images to a pinhole camera first")),
    }
    if given("is_fisheye").as_bool() == Some(true) {
        return Err("a fisheye lens; undistort the images to a pinhole camera first".into());
    }
    let c2w = matrix::camera_to_world(&frame["transform_matrix"], "transform_matrix")?;
    let side = |key: &str| match number(key)? {
        None => Ok(None),
        Some(x) if (1.0..=65_536.0).contains(&x) && x.fract() == 0.0 => Ok(Some(x as usize)),
        Some(x) => Err(format!("{key} is {x}, not a number of pixels")),
    };
    let focal = [number("fl_x")?, number("fl_y")?];
    let centre = [number("cx")?, number("cy")?];
    let size = match (side("w")?, side("h")?) {
        (Some(w), Some(h)) => Some((w, h)),
        _ if focal[0].is_none() || centre.contains(&None) => Some(measure()?),
        _ => None,
    };
    let (w, h) = size.map_or((0.0, 0.0), |(w, h)| (w as f64, h as f64));
    let from_angle = |key: &str, pixels: f64| match number(key)? {
        Some(angle) if angle > 0.0 && angle < std::f64::consts::PI => Ok(Some(0.5 * pixels / (0.5 * angle).tan())),
        Some(angle) => Err(format!("{key} is {angle}, not an angle in radians between 0 and π")),
        None => Ok(None),
    };
    let fx = match focal[0] {
        Some(fx) => fx,
        None => from_angle("camera_angle_x", w)?.ok_or("neither fl_x nor camera_angle_x is given")?,
    };
    let fy = match (focal[1], focal[0]) {
        (Some(fy), _) => fy,
        (None, Some(fx)) => fx,
        (None, None) => from_angle("camera_angle_y", h)?.unwrap_or(fx),
    };
    if fx <= 0.0 || fy <= 0.0 {
        return Err(format!("focal lengths must be positive, found {fx} and {fy}"));
    }
    Ok(Pose { c2w, intrinsic: [fx, fy, centre[0].unwrap_or(0.5 * w), centre[1].unwrap_or(0.5 * h)], size })
}

fn unusable(list: &Path, index: usize, frame: &Value, found: String) -> Error {
    Error::new(ErrorKind::Input, "an entry of the image list is unusable")
        .at(format!("{}, frame {index} ({})", list.display(), frame["file_path"]))
        .found(found)
        .wanted(
            "file_path inside the folder, transform_matrix (4×4, camera to world), and fl_x, fl_y, cx, cy, w, h or \
             camera_angle_x here or at the top; no distortion",
        )
        .fix("correct the entry or export the list again")
}
