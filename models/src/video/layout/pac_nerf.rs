//! PAC-NeRF: `all_data.json` lists every image with its camera and time; `data/` holds the numbered images.

use std::collections::BTreeMap;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use serde_json::Value;

use super::files::Files;
use super::world::{Clock, Up};
use super::{Reading, View, json, malformed};
use crate::video::matrix;

/// Name of the file that lists the images of a clip.
pub(super) const LIST: &str = "all_data.json";
/// Frame number of the background plate.
pub(in super::super) const PLATE: i64 = -1;
/// Frame number of the plate that marks excluded pixels.
pub(in super::super) const EXCLUDED: i64 = -2;

struct Entry {
    camera: i64,
    frame: i64,
    time: f64,
    c2w: [[f64; 4]; 3],
    intrinsic: matrix::Intrinsic,
}

/// Reads and checks the list.
pub(super) fn read(root: &Path) -> Result<Reading> {
    let path = root.join(LIST);
    let Value::Array(list) = json(&path)? else {
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
    Ok(Reading {
        views,
        files: Files::Numbered,
        list: path,
        axes: "OpenGL axes: x right, y up, looking along −z",
        up: Up::Custom([0.0, 1.0, 0.0]),
        metres: true,
        clock: Clock::Seconds,
        assumptions: Vec::new(),
    })
}

fn entry(value: &Value) -> Result<Entry, String> {
    let path = value["file_path"].as_str().ok_or("file_path is missing or not a string")?;
    let (camera, frame) = numbers(path).ok_or_else(|| format!("no camera and frame number in file_path {path:?}"))?;
    let time = match value["time"].as_f64() {
        Some(time) if time.is_finite() => time,
        _ => return Err(format!("time is {}, not a finite number", value["time"])),
    };
    let c2w = matrix::camera_to_world(&value["c2w"], "c2w")?;
    let intrinsic = matrix::intrinsic(&value["intrinsic"], "intrinsic")?;
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
    let view = views.entry(camera).or_insert_with(|| View {
        name: String::new(),
        c2w,
        intrinsic,
        size: None,
        times: BTreeMap::new(),
    });
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
