//! COLMAP: a text model (`cameras.txt`, `images.txt`), and a folder of frames for each of its images.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use gradreel::{Error, ErrorKind, Result};

use super::files::{count, inside, last_number, mask_beside, numbered};
use super::poses::{Pose, from_opencv};
use super::world::{Clock, Up};
use super::{MAX_CAMERAS, Reading, View, malformed, text};
use crate::video::matrix::Intrinsic;

/// Folders of models, in order of preference.
const MODELS: [&str; 3] = ["sparse/0", "sparse", "colmap/sparse/0"];
/// Folders that hold the cameras' folders of frames, in order of preference; the last is the clip's own.
const BASES: [&str; 3] = ["frames", "images", ""];
/// Maximum number of images without frames that a message names.
const NAMED: usize = 8;
/// Default frame rate \[1/s\].
const FRAMES_PER_S: f64 = 24.0;

/// `images.txt` of a folder's text model, if there is one.
pub(super) fn model(root: &Path) -> Option<PathBuf> {
    let folders = MODELS.iter().map(|folder| root.join(folder));
    let complete = |folder: &PathBuf| folder.join("cameras.txt").is_file() && folder.join("images.txt").is_file();
    folders.into_iter().find(complete).map(|folder| folder.join("images.txt"))
}

/// Whether the folder has a binary model.
pub(super) fn has_binary(root: &Path) -> bool {
    MODELS.iter().any(|folder| root.join(folder).join("images.bin").is_file())
}

/// A camera of `cameras.txt`: intrinsics and image size, or why it is unusable.
struct Lens {
    line: usize,
    read: Result<(Intrinsic, (usize, usize)), String>,
}

/// An image of `images.txt`.
struct Registered {
    name: String,
    c2w: [[f64; 4]; 3],
    camera: i64,
}

/// A folder of frames with the last number of its name, by which the cameras are sorted.
type FrameFolder = (Option<i64>, PathBuf);

/// Reads the model and lists the folders of frames.
pub(super) fn read(root: &Path) -> Result<Reading> {
    let list = model(root).unwrap_or_else(|| root.join(MODELS[0]).join("images.txt"));
    let cameras_list = list.with_file_name("cameras.txt");
    let lenses = lenses(&cameras_list)?;
    let mut cameras: BTreeMap<FrameFolder, (Pose, BTreeMap<i64, PathBuf>)> = BTreeMap::new();
    let (mut without_folder, mut without_number, mut known) = (Vec::new(), 0, BTreeMap::new());
    let content = text(&list)?;
    for (number, line) in image_lines(&content) {
        let wrong = |found: String| broken(&list, number, found, IMAGE);
        let Registered { name, c2w, camera } = image(line).map_err(wrong)?;
        let inner = inside(root, &name).map_err(wrong)?;
        let Some(folder) = folder(root, &inner, &mut known) else {
            without_folder.push(name);
            continue;
        };
        let Some(lens) = lenses.get(&camera) else {
            return Err(wrong(format!("camera {camera}, which cameras.txt lacks")));
        };
        // only cameras in use must be valid
        let (intrinsic, size) = lens.read.clone().map_err(|found| broken(&cameras_list, lens.line, found, CAMERA))?;
        let pose = Pose { c2w, intrinsic, size: Some(size) };
        let key = (last_number(&folder), folder);
        if let Some((other, _)) = cameras.get(&key) {
            if other.same(&pose) {
                continue;
            }
            let found = format!("another pose for the frames in {}", key.1.display());
            let wanted = "one pose for each folder of frames: cameras stand still, each with a folder of its own";
            return Err(broken(&list, number, found, wanted));
        }
        let (frames, without) = numbered(&key.1)?;
        without_number += without;
        cameras.insert(key, (pose, frames));
        if cameras.len() > MAX_CAMERAS {
            return Err(malformed(
                &list,
                format!("more than {MAX_CAMERAS} cameras"),
                "a camera for each folder of frames",
            ));
        }
    }
    if cameras.is_empty() {
        let first = without_folder.first().map_or("no image".to_owned(), |name| format!("the image {name}"));
        return Err(Error::new(ErrorKind::Input, "no camera of the model has a folder of frames")
            .at(root.display())
            .found(format!("{first} in {}", list.display()))
            .wanted("frames in a folder named as the image or its folder: frames/left/0001.png … for left.png or left/….png")
            .fix("put each camera's frames into such a folder, directly, or in frames or images"));
    }
    let mut assumptions = Vec::new();
    if !without_folder.is_empty() {
        let mut named = without_folder.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
        if without_folder.len() > NAMED {
            named += ", …";
        }
        let count = without_folder.len();
        assumptions.push(format!("{count} images of the model have no folder of frames and are left out: {named}"));
    }
    if without_number > 0 {
        assumptions.push(format!("{without_number} images without a number in their names are no frames"));
    }
    let frames: Vec<_> = cameras.values().map(|(_, frames)| frames.clone()).collect();
    let counted = count(&frames, |image| mask_beside(root, image));
    assumptions.extend(counted.said);
    let views = (0..).zip(&cameras).zip(counted.times).map(|((id, ((_, folder), (pose, _))), times)| {
        let name = folder.strip_prefix(root).unwrap_or(folder).display().to_string();
        (id, View { name, c2w: pose.c2w, intrinsic: pose.intrinsic, size: pose.size, times })
    });
    Ok(Reading {
        views: views.collect(),
        files: counted.files,
        list,
        axes: "OpenCV axes in the model (y down, looking along z), turned to OpenGL's",
        up: Up::Cameras,
        metres: false,
        clock: Clock::Counted { per_s: FRAMES_PER_S },
        assumptions,
    })
}

/// The folder of frames of a registered image: named like the image, with or without its extension, or the folder
/// that contains the image.
fn folder(root: &Path, image: &Path, known: &mut BTreeMap<PathBuf, bool>) -> Option<PathBuf> {
    let parent = image.parent().filter(|parent| !parent.as_os_str().is_empty()).map(Path::to_path_buf);
    let names = [Some(image.to_path_buf()), Some(image.with_extension("")), parent];
    let mut places = names.into_iter().flatten().flat_map(|name| BASES.map(|base| root.join(base).join(&name)));
    // a folder shared by many images is listed once; an unlistable folder causes an error when read
    let mut holds_frames = |path: &PathBuf| {
        let listed = || path.is_dir() && numbered(path).map_or(true, |(frames, _)| !frames.is_empty());
        *known.entry(path.clone()).or_insert_with(listed)
    };
    places.find(|path| holds_frames(path))
}

const CAMERA: &str = "CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS";
const IMAGE: &str = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME";

/// Trimmed lines other than comments, with their numbers from 1.
fn lines(content: &str) -> impl Iterator<Item = (usize, &str)> {
    (1..).zip(content.lines().map(str::trim)).filter(|(_, line)| !line.starts_with('#'))
}

/// The image lines. Each is followed by a line of points, three numbers per point, which may be blank or missing.
fn image_lines(content: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut behind_image = false;
    lines(content).filter(move |(_, line)| {
        let mut count = 0;
        let numbers = line.split_whitespace().inspect(|_| count += 1).all(|word| word.parse::<f64>().is_ok());
        let points = behind_image && numbers && count % 3 == 0;
        let is_image = !line.is_empty() && !points;
        behind_image = is_image;
        is_image
    })
}

fn lenses(path: &Path) -> Result<BTreeMap<i64, Lens>> {
    let content = text(path)?;
    let mut lenses = BTreeMap::new();
    for (line, words) in lines(&content).filter(|(_, line)| !line.is_empty()) {
        let words: Vec<&str> = words.split_whitespace().collect();
        let id = integer(words[0]).map_err(|found| broken(path, line, found, CAMERA))?;
        if lenses.insert(id, Lens { line, read: lens(&words) }).is_some() {
            return Err(broken(path, line, format!("a second camera {id}"), CAMERA));
        }
    }
    Ok(lenses)
}

fn lens(words: &[&str]) -> Result<(Intrinsic, (usize, usize)), String> {
    let [_, model, width, height, parameters @ ..] = words else {
        return Err(format!("{} words", words.len()));
    };
    let side = |word: &str| match integer(word)? {
        n @ 1..=65_536 => Ok(n as usize),
        n => Err(format!("a side of {n} pixels")),
    };
    let size = (side(width)?, side(height)?);
    let p: Vec<f64> = parameters.iter().map(|word| number(word)).collect::<Result<_, _>>()?;
    // number of focal lengths, and of all parameters
    let (focal, count) = match *model {
        "SIMPLE_PINHOLE" => (1, 3),
        "PINHOLE" => (2, 4),
        "SIMPLE_RADIAL" => (1, 4),
        "RADIAL" => (1, 5),
        "OPENCV" => (2, 8),
        "FULL_OPENCV" => (2, 12),
        _ => return Err(format!("the camera model {model}; undistort the images: colmap image_undistorter")),
    };
    if p.len() != count {
        return Err(format!("{} parameters for {model}, which has {count}", p.len()));
    }
    if let Some(k) = p[focal + 2..].iter().find(|&&k| k != 0.0) {
        return Err(format!("lens distortion ({model}, a coefficient of {k}); undistort: colmap image_undistorter"));
    }
    if p[0] <= 0.0 || p[focal - 1] <= 0.0 {
        return Err(format!("focal lengths must be positive, found {} and {}", p[0], p[focal - 1]));
    }
    Ok(([p[0], p[focal - 1], p[focal], p[focal + 1]], size))
}

fn image(line: &str) -> Result<Registered, String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    if words.len() < 10 {
        return Err(format!("{} words", words.len()));
    }
    let mut n = [0.0; 7];
    for (value, word) in n.iter_mut().zip(&words[1..]) {
        *value = number(word)?;
    }
    let camera = integer(words[8])?;
    let length = n[..4].iter().map(|q| q * q).sum::<f64>().sqrt();
    if (length - 1.0).abs() > 1e-2 {
        return Err(format!("a quaternion of length {length}"));
    }
    let [w, x, y, z] = [n[0], n[1], n[2], n[3]].map(|q| q / length);
    let rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let c2w = from_opencv(&rotation, [n[4], n[5], n[6]]);
    Ok(Registered { name: rest(line, 9).to_owned(), c2w, camera })
}

/// The rest of a line after this many words; spaces inside a file name are kept.
fn rest(line: &str, words: usize) -> &str {
    (0..words).fold(line, |line, _| line.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim_start()))
}

fn number(word: &str) -> Result<f64, String> {
    f64::from_str(word).ok().filter(|x| x.is_finite()).ok_or_else(|| format!("{word:?}, which is not a finite number"))
}

fn integer(word: &str) -> Result<i64, String> {
    word.parse().map_err(|_| format!("{word:?}, which is not a whole number"))
}

fn broken(path: &Path, line: usize, found: String, wanted: &str) -> Error {
    Error::new(ErrorKind::Input, "a line of the COLMAP model is unusable")
        .at(format!("{}, line {line}", path.display()))
        .found(found)
        .wanted(wanted)
        .fix("export the model again: colmap model_converter --output_type TXT")
}
