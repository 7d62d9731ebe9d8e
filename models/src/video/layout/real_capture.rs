//! Spring-Gaus, real captures: one calibration of a few cameras, and many sequences of several objects.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde_json::Value;

use super::files::{Files, Kind, inside, last};
use super::poses::from_opencv;
use super::world::{Clock, Up};
use super::{MAX_CAMERAS, Reading, View, json, malformed};
use crate::folder::entries;
use crate::vector::rotation;
use crate::video::matrix;

/// The calibration.
pub(super) const LIST: &str = "dynamic/cameras_calib.json";
/// Frame rate of the data set \[1/s\].
const FRAMES_PER_S: f64 = 120.0;

/// The data set's folder, if `path` is a sequence: `…/dynamic/sequences/{object}/{number}.json`.
pub(super) fn sequence_file(path: &Path) -> Option<PathBuf> {
    let part = |up: usize| path.ancestors().nth(up)?.file_name();
    let fits = path.is_file() && part(2)? == "sequences" && part(3)? == "dynamic";
    let root = path.ancestors().nth(4)?;
    fits.then(|| if root.as_os_str().is_empty() { PathBuf::from(".") } else { root.to_path_buf() })
}

/// Reads the calibration and a sequence; also returns a name for the clip.
pub(super) fn read(root: &Path, sequence: Option<&Path>) -> Result<(Reading, String)> {
    let sequence = sequence.map_or_else(|| only_sequence(root), |path| Ok(path.to_path_buf()))?;
    let list = root.join(LIST);
    let calibration = json(&list)?;
    let frames = json(&sequence)?;
    let wrong = |path: &Path, found: String| {
        malformed(path, found, "camera_matrix, and rvecs and tvecs of each camera; file names of each camera's frames")
    };
    let mut intrinsic =
        matrix::intrinsic(&calibration["camera_matrix"], "camera_matrix").map_err(|found| wrong(&list, found))?;
    // OpenCV's pixel centres are at whole numbers
    intrinsic[2] += 0.5;
    intrinsic[3] += 0.5;
    let Value::Object(entries) = &frames else {
        return Err(wrong(&sequence, "JSON that is not an object".into()));
    };
    let images = root.join("dynamic/videos_images");
    let (mut views, mut files) = (BTreeMap::new(), BTreeMap::new());
    for (name, names) in entries {
        let Value::Array(names) = names else { continue };
        let id = views.len() as i64;
        if views.len() == MAX_CAMERAS {
            return Err(wrong(&sequence, format!("more than {MAX_CAMERAS} cameras")));
        }
        let turn = vector(&calibration[name]["rvecs"]);
        let shift = vector(&calibration[name]["tvecs"]);
        let (Some(turn), Some(shift)) = (turn, shift) else {
            return Err(wrong(&list, format!("no three rvecs and three tvecs of camera {name}")));
        };
        let (mut times, mut listed) = (BTreeMap::new(), BTreeSet::new());
        for (frame, file) in (0..).zip(names) {
            let file = file.as_str().ok_or_else(|| format!("the file name {file} of camera {name}"));
            // joining a folder and an absolute path yields the absolute path
            let path = |file: &str| Path::new(name).join(file).to_string_lossy().into_owned();
            let image = file.and_then(|file| inside(&images, &path(file))).map_err(|found| wrong(&sequence, found))?;
            if !listed.insert(image.clone()) {
                return Err(wrong(&sequence, format!("the image {} of camera {name} twice", image.display())));
            }
            let mask = root.join("dynamic/videos_masks").join(image.with_extension("png"));
            if mask.is_file() {
                files.insert((Kind::Mask, id, frame), mask);
            }
            files.insert((Kind::Image, id, frame), images.join(image));
            times.insert(frame, frame as f64);
        }
        let c2w = from_opencv(&rotation(turn), shift);
        views.insert(id, View { name: name.clone(), c2w, intrinsic, size: None, times });
    }
    if views.is_empty() {
        return Err(wrong(&sequence, "no list of frames".into()));
    }
    let mut assumptions = vec!["principal point counted from the centre of the first pixel, as OpenCV does".to_owned()];
    let distortion = calibration["distortion_coefficient"].to_string();
    if distortion.contains(|c: char| c.is_ascii_digit() && c != '0') {
        assumptions.push(format!("the lens distortion {distortion} is neglected, as is the custom of this layout"));
    }
    let object = sequence.parent().map_or_else(String::new, last);
    let name = format!("{object}-{}", last(&sequence.with_extension("")));
    let reading = Reading {
        views,
        files: Files::Listed(files),
        list,
        axes: "OpenCV axes in the calibration (y down, looking along z), turned to OpenGL's",
        up: Up::Custom([0.0, 0.0, -1.0]),
        metres: true,
        clock: Clock::Counted { per_s: FRAMES_PER_S },
        assumptions,
    };
    Ok((reading, name))
}

/// The sequence of a folder that has exactly one.
fn only_sequence(root: &Path) -> Result<PathBuf> {
    let folder = root.join("dynamic/sequences");
    let inside = |folder: &Path| entries(folder, "the sequences").map_err(|e| e.fix("give the whole data set"));
    let mut found = Vec::new();
    for object in inside(&folder)?.iter().filter(|path| path.is_dir()) {
        found.extend(inside(object)?.into_iter().filter(|path| path.extension().is_some_and(|e| e == "json")));
    }
    if let [only] = found.as_slice() {
        return Ok(only.clone());
    }
    let names: Vec<String> = found.iter().take(12).map(|path| path.display().to_string()).collect();
    Err(Error::new(ErrorKind::Input, "the folder holds several sequences, or none")
        .at(folder.display())
        .found(if names.is_empty() { "no sequence".to_owned() } else { names.join(", ") })
        .wanted("one sequence")
        .fix("give the path of the sequence's file, …/dynamic/sequences/{object}/{number}.json, as the clip"))
}

/// Three finite numbers, at any depth of nested lists.
fn vector(value: &Value) -> Option<[f64; 3]> {
    fn numbers(value: &Value, depth: usize, found: &mut Vec<f64>) {
        match value {
            Value::Array(list) if depth < 4 => list.iter().take(4).for_each(|v| numbers(v, depth + 1, found)),
            other => found.push(other.as_f64().unwrap_or(f64::NAN)),
        }
    }
    let mut found = Vec::new();
    numbers(value, 0, &mut found);
    <[f64; 3]>::try_from(found).ok().filter(|v| v.iter().all(|x| x.is_finite()))
}
