//! Spring-Gaus, synthetic: `camera.json` lists the cameras; each has a folder of frames.

use std::collections::BTreeSet;
use std::path::Path;

use gradreel::{Error, ErrorKind, Result};
use serde_json::Value;

use super::files::{count, inside, mask_beside, numbered};
use super::world::{Clock, Up};
use super::{MAX_CAMERAS, Reading, View, json, malformed};
use crate::video::matrix;

/// Name of the list of cameras.
pub(super) const LIST: &str = "camera.json";
/// Frame rate of the data set \[1/s\]: 0.03 s between frames.
const FRAMES_PER_S: f64 = 1.0 / 0.03;

/// Reads the list and the folders of frames.
pub(super) fn read(root: &Path) -> Result<Reading> {
    let list = root.join(LIST);
    let Value::Array(entries) = json(&list)? else {
        return Err(malformed(&list, "JSON that is not a list", "a list with one entry per camera"));
    };
    if entries.is_empty() || entries.len() > MAX_CAMERAS {
        return Err(malformed(&list, format!("{} cameras", entries.len()), format!("1 to {MAX_CAMERAS} cameras")));
    }
    let mut cameras: Vec<(String, [[f64; 4]; 3], matrix::Intrinsic)> = Vec::new();
    let (mut frames, mut folders, mut without_number) = (Vec::new(), BTreeSet::new(), 0);
    for (index, entry) in entries.iter().enumerate() {
        let wrong = |found: String| {
            Error::new(ErrorKind::Input, "an entry of the list of cameras is unusable")
                .at(format!("{}, entry {index} ({})", list.display(), entry["camera"]))
                .found(found)
                .wanted("camera (the name of its folder), c2w (3×4 or 4×4), K (3×3, pixels)")
                .fix("correct the entry or export the list again")
        };
        let read = || -> Result<_, String> {
            let name = match &entry["camera"] {
                Value::String(name) => name.clone(),
                Value::Number(number) if number.is_i64() => number.to_string(),
                _ => return Err("camera is missing or no name".into()),
            };
            let c2w = matrix::camera_to_world(&entry["c2w"], "c2w")?;
            let intrinsic = matrix::intrinsic(&entry["K"], "K")?;
            let folder = inside(root, &name)?;
            Ok((name, folder, c2w, intrinsic))
        };
        let (name, folder, c2w, intrinsic) = read().map_err(wrong)?;
        if !folders.insert(folder.clone()) {
            return Err(wrong(format!("a second camera {name:?}")));
        }
        let folder = root.join(folder);
        if !folder.is_dir() {
            return Err(wrong(format!("no folder {}", folder.display())));
        }
        let (found, without) = numbered(&folder)?;
        if found.is_empty() {
            return Err(wrong(format!("no frame in the folder {name:?}")));
        }
        without_number += without;
        frames.push(found);
        cameras.push((name, c2w, intrinsic));
    }
    let counted = count(&frames, |image| mask_beside(root, image));
    let mut assumptions: Vec<String> = counted.said.into_iter().collect();
    if without_number > 0 {
        assumptions.push(format!("{without_number} images without a number in their names are no frames"));
    }
    let views = (0..)
        .zip(cameras)
        .zip(counted.times)
        .map(|((id, (name, c2w, intrinsic)), times)| (id, View { name, c2w, intrinsic, size: None, times }));
    Ok(Reading {
        views: views.collect(),
        files: counted.files,
        list,
        axes: "OpenGL axes: x right, y up, looking along −z",
        up: Up::Custom([0.0, 1.0, 0.0]),
        metres: true,
        clock: Clock::Counted { per_s: FRAMES_PER_S },
        assumptions,
    })
}
