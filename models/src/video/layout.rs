//! What `all_data.json` and the folder `data/` say: cameras, frames and times, before any image is decoded.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde_json::Value;

use super::matrix;

/// Name of the file that lists the images of a clip.
pub(super) const LIST: &str = "all_data.json";
/// Largest list that is read into memory \[bytes\].
const MAX_LIST_BYTES: u64 = 256 << 20;
/// Frame number of the background plate.
pub(super) const PLATE: i64 = -1;
/// Frame number of the plate that marks excluded pixels.
pub(super) const EXCLUDED: i64 = -2;

/// One camera of the list.
#[derive(Debug, Clone)]
pub(super) struct View {
    pub c2w: [[f64; 4]; 3],
    pub intrinsic: matrix::Intrinsic,
    /// Time \[s\] of every listed frame ≥ 0.
    pub times: BTreeMap<i64, f64>,
}

/// The parsed list of a clip.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    pub root: PathBuf,
    pub views: BTreeMap<i64, View>,
}

struct Entry {
    camera: i64,
    frame: i64,
    time: f64,
    c2w: [[f64; 4]; 3],
    intrinsic: matrix::Intrinsic,
}

impl Layout {
    /// Reads and checks the list.
    pub fn read(root: &Path) -> Result<Layout> {
        if !root.is_dir() {
            let found = if root.exists() { "a file" } else { "nothing" };
            return Err(Error::new(ErrorKind::Input, "there is no clip folder")
                .at(root.display())
                .found(found)
                .wanted(format!("a folder with {LIST} and data/r_{{camera}}_{{frame}}.png"))
                .fix("give the path of the clip's folder"));
        }
        let path = root.join(LIST);
        let length = fs::metadata(&path).map_err(|e| no_list(&path, &e))?.len();
        if length > MAX_LIST_BYTES {
            return Err(malformed(&path, format!("{length} bytes"), format!("at most {MAX_LIST_BYTES} bytes")));
        }
        let text = fs::read(&path).map_err(|e| no_list(&path, &e))?;
        let list: Value = serde_json::from_slice(&text)
            .map_err(|e| malformed(&path, e, "a JSON list with one entry per image (NaN is not JSON)"))?;
        let Value::Array(list) = list else {
            return Err(malformed(&path, "JSON that is not a list", "a list with one entry per image"));
        };
        let mut views = BTreeMap::new();
        for (index, value) in list.iter().enumerate() {
            let place = || format!("{}, entry {index} ({})", path.display(), value["file_path"]);
            let wrong = |found: String| {
                let keys = "file_path (…/r_{camera}_{frame}.png), time [s], c2w (3×4 rotation and translation), \
                            intrinsic (3×3, pixels)";
                Error::new(ErrorKind::Input, "an entry of the image list is unusable")
                    .at(place())
                    .found(found)
                    .wanted(keys)
                    .fix("correct the entry or export the list again")
            };
            let entry = entry(value).map_err(wrong)?;
            insert(&mut views, &entry).map_err(wrong)?;
        }
        views.retain(|_, view: &mut View| !view.times.is_empty());
        if views.is_empty() {
            return Err(malformed(&path, "no entry with a frame number ≥ 0", "one entry per image"));
        }
        Ok(Layout { root: root.to_path_buf(), views })
    }

    /// Path of an image: prefix `r`, `a` or `m`. Only numbers enter it, whatever the list says.
    pub fn image(&self, prefix: char, camera: i64, frame: i64) -> PathBuf {
        self.root.join("data").join(format!("{prefix}_{camera}_{frame}.png"))
    }

    /// Whether that image exists.
    pub fn has_image(&self, prefix: char, camera: i64, frame: i64) -> bool {
        self.image(prefix, camera, frame).is_file()
    }

    /// The last component of the clip's path.
    pub fn name(&self) -> String {
        let absolute = self.root.canonicalize().unwrap_or_else(|_| self.root.clone());
        absolute.file_name().map_or_else(|| "clip".into(), |name| name.to_string_lossy().into_owned())
    }

    /// The frames that are both listed and on disk.
    pub fn usable_frames(&self, camera: i64) -> Vec<i64> {
        self.views[&camera].times.keys().copied().filter(|&frame| self.has_image('r', camera, frame)).collect()
    }
}

fn entry(value: &Value) -> Result<Entry, String> {
    let path = value["file_path"].as_str().ok_or("file_path is missing or not a string")?;
    let (camera, frame) = numbers(path).ok_or_else(|| format!("no camera and frame number in file_path {path:?}"))?;
    let time = match value["time"].as_f64() {
        Some(time) if time.is_finite() => time,
        _ => return Err(format!("time is {}, not a finite number", value["time"])),
    };
    let c2w = matrix::camera_to_world(&value["c2w"])?;
    let intrinsic = matrix::intrinsic(&value["intrinsic"])?;
    Ok(Entry { camera, frame, time, c2w, intrinsic })
}

/// Camera and frame of `…/r_{camera}_{frame}.png`; folders in front are ignored.
fn numbers(path: &str) -> Option<(i64, i64)> {
    let base = path.rsplit(['/', '\\']).next()?;
    let stem = base.rsplit_once('.').map_or(base, |(stem, _)| stem);
    let (camera, frame) = stem.strip_prefix("r_")?.rsplit_once('_')?;
    Some((camera.parse().ok()?, frame.parse().ok()?))
}

fn insert(views: &mut BTreeMap<i64, View>, entry: &Entry) -> Result<(), String> {
    let &Entry { camera, frame, time, c2w, intrinsic } = entry;
    if frame < EXCLUDED {
        return Err(format!("frame number {frame}"));
    }
    let view = views.entry(camera).or_insert_with(|| View { c2w, intrinsic, times: BTreeMap::new() });
    let moved = view.c2w.iter().flatten().zip(c2w.iter().flatten()).any(|(a, b)| (a - b).abs() > 1e-6);
    let zoomed = view.intrinsic.iter().zip(&intrinsic).any(|(a, b)| (a - b).abs() > 1e-6 * a.abs().max(1.0));
    if moved || zoomed {
        let what = if moved { "c2w" } else { "intrinsic" };
        return Err(format!("camera {camera} changes its {what} between frames; cameras must stand still"));
    }
    if frame >= 0 && view.times.insert(frame, time).is_some() {
        return Err(format!("camera {camera}, frame {frame} is listed twice"));
    }
    Ok(())
}

fn no_list(path: &Path, error: &std::io::Error) -> Error {
    Error::io(path, "read the image list", error)
        .wanted(format!("{LIST}: a JSON list of file_path, time, c2w, intrinsic"))
        .fix("export the clip with its cameras, or give the folder that holds the list")
}

fn malformed(path: &Path, found: impl std::fmt::Display, wanted: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::Input, "the image list is malformed")
        .at(path.display())
        .found(found)
        .wanted(wanted)
        .fix("export the list again")
}
