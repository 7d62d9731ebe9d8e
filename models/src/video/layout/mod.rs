//! The contents of a clip's folder before any image is decoded: cameras, frames, times and files.
//!
//! Each layout has its own reader, which returns a [`Reading`] in the layout's coordinates and times. The side file
//! `clip.toml` ([`side`]) and [`world`] then convert it to metres, y up and seconds, and report their assumptions.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use serde_json::Value;

use super::matrix;
use crate::text;

mod colmap;
mod files;
mod pac_nerf;
mod poses;
mod real_capture;
mod side;
mod spring_gaus;
mod transforms;
mod world;

use files::Files;
pub(super) use files::Kind;
pub(super) use pac_nerf::{EXCLUDED, PLATE};
use world::{Clock, Up};

/// Maximum size of a list \[bytes\].
const MAX_LIST_BYTES: u64 = 256 << 20;
/// Maximum number of cameras of a clip; more poses indicate a moving camera.
const MAX_CAMERAS: usize = 1024;

/// Layout of a clip's folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Format {
    /// `all_data.json` and `data/r_{camera}_{frame}.png`, as in PAC-NeRF's data set.
    PacNerf,
    /// `camera.json` and `{camera}/{frame}.png`, as in Spring-Gaus' synthetic data set.
    SpringGaus,
    /// `dynamic/cameras_calib.json` and `dynamic/sequences/{object}/{number}.json`, as in Spring-Gaus' real captures.
    RealCapture,
    /// `transforms.json`, or `transforms_train.json`, `…_val.json` and `…_test.json`, as in NeRF, D-NeRF and
    /// derivatives.
    Transforms,
    /// A COLMAP text model, and a folder of frames for each camera.
    Colmap,
}

impl Format {
    /// All layouts, in order of precedence where a folder matches several.
    pub(in crate::video) const ALL: [Format; 5] =
        [Format::PacNerf, Format::SpringGaus, Format::RealCapture, Format::Transforms, Format::Colmap];

    /// Whether a folder has the file that identifies the layout.
    pub(in crate::video) fn is_at(self, root: &Path) -> bool {
        self.list(root).is_some()
    }

    /// Its name in `clip.toml`.
    fn key(self) -> &'static str {
        match self {
            Format::PacNerf => "pac_nerf",
            Format::SpringGaus => "spring_gaus",
            Format::RealCapture => "real_capture",
            Format::Transforms => "transforms",
            Format::Colmap => "colmap",
        }
    }

    /// The file that identifies the layout, if the folder has it.
    fn list(self, root: &Path) -> Option<PathBuf> {
        match self {
            Format::PacNerf => [root.join(pac_nerf::LIST)].into_iter().find(|path| path.is_file()),
            Format::SpringGaus => [root.join(spring_gaus::LIST)].into_iter().find(|path| path.is_file()),
            Format::RealCapture => [root.join(real_capture::LIST)].into_iter().find(|path| path.is_file()),
            Format::Transforms => transforms::lists(root).into_iter().next(),
            Format::Colmap => colmap::model(root),
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Format::PacNerf => "PAC-NeRF (all_data.json, data/r_{camera}_{frame}.png)",
            Format::SpringGaus => "Spring-Gaus, synthetic (camera.json, {camera}/{frame}.png)",
            Format::RealCapture => "Spring-Gaus, real capture (dynamic/cameras_calib.json, dynamic/sequences)",
            Format::Transforms => "NeRF, D-NeRF (transforms.json)",
            Format::Colmap => "COLMAP text model (cameras.txt, images.txt, a folder of frames per camera)",
        })
    }
}

/// The image lists that are searched for, for messages.
const KNOWN: &str = "all_data.json (PAC-NeRF), camera.json or dynamic/cameras_calib.json (Spring-Gaus), transforms.json \
                     (NeRF, D-NeRF), or sparse/0/cameras.txt and images.txt (COLMAP)";

/// One camera.
#[derive(Debug, Clone)]
pub(super) struct View {
    /// Where its images are; empty if its number identifies them.
    pub name: String,
    pub c2w: [[f64; 4]; 3],
    pub intrinsic: matrix::Intrinsic,
    /// Width and height that the intrinsics refer to, if the layout states them.
    pub size: Option<(usize, usize)>,
    /// Time \[s\] of every listed frame ≥ 0.
    pub times: BTreeMap<i64, f64>,
}

/// Result of a layout's reader, in the layout's own coordinates and times.
struct Reading {
    views: BTreeMap<i64, View>,
    files: Files,
    /// The file that lists the cameras.
    list: PathBuf,
    /// Camera axes of the layout, for messages.
    axes: &'static str,
    up: Up,
    /// Whether the layout's unit is defined as the metre.
    metres: bool,
    clock: Clock,
    assumptions: Vec<String>,
}

/// A clip's folder as described by its lists.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    pub root: PathBuf,
    pub format: Format,
    pub views: BTreeMap<i64, View>,
    /// The file that lists the cameras.
    pub list: PathBuf,
    /// Assumptions made about axes, unit and times.
    pub assumptions: Vec<String>,
    /// Cameras whose images were synthesized.
    pub imagined: Vec<i64>,
    files: Files,
    name: String,
}

impl Layout {
    /// Recognises the layout; reads and checks its lists.
    pub fn read(path: &Path) -> Result<Layout> {
        let (root, sequence) = match real_capture::sequence_file(path) {
            Some(root) => (root, Some(path)),
            None => (path.to_path_buf(), None),
        };
        if !root.is_dir() {
            let found = if root.exists() { "a file" } else { "nothing" };
            return Err(Error::new(ErrorKind::Input, "there is no clip folder")
                .at(root.display())
                .found(found)
                .wanted(format!("a folder with {KNOWN}"))
                .fix("give the path of the clip's folder"));
        }
        let side = side::Side::read(&root)?;
        let (format, mut assumptions) = match sequence {
            Some(_) => (Format::RealCapture, Vec::new()),
            None => recognise(&root, side.layout)?,
        };
        let mut name = last_component(&root);
        let mut reading = match format {
            Format::PacNerf => pac_nerf::read(&root)?,
            Format::SpringGaus => spring_gaus::read(&root)?,
            Format::RealCapture => {
                let (reading, chosen) = real_capture::read(&root, sequence)?;
                name = chosen;
                reading
            }
            Format::Transforms => transforms::read(&root)?,
            Format::Colmap => colmap::read(&root)?,
        };
        assumptions.push(format!("cameras stand still, without lens distortion; {}", reading.axes));
        assumptions.append(&mut reading.assumptions);
        world::settle(&mut reading, &side)?;
        assumptions.append(&mut reading.assumptions);
        let Reading { views, files, list, .. } = reading;
        let imagined = side.imagined;
        if let Some(unknown) = imagined.iter().find(|id| !views.contains_key(id)) {
            let known: Vec<String> = views.keys().map(i64::to_string).collect();
            return Err(Error::new(ErrorKind::Input, "clip.toml calls a camera imagined that the clip does not have")
                .at(root.join(side::NAME).display())
                .found(format!("camera {unknown}"))
                .wanted(format!("some of {}", known.join(", ")))
                .fix("correct imagined, or leave it out if every view was filmed"));
        }
        Ok(Layout { root, format, views, list, assumptions, imagined, files, name })
    }

    /// Path of an image or mask, existing or not; `None` if the layout has no such file.
    pub fn path(&self, kind: Kind, camera: i64, frame: i64) -> Option<PathBuf> {
        self.files.path(&self.root, kind, camera, frame)
    }

    /// Path of a file for which [`Layout::has`] is true, or of the image of a listed frame.
    ///
    /// # Panics
    /// If the layout has no such file.
    pub fn file(&self, kind: Kind, camera: i64, frame: i64) -> PathBuf {
        self.path(kind, camera, frame).expect("a listed image, or a file that was found")
    }

    /// Whether that file exists.
    pub fn has(&self, kind: Kind, camera: i64, frame: i64) -> bool {
        self.path(kind, camera, frame).is_some_and(|path| path.is_file())
    }

    /// The last component of the clip's path.
    pub fn name(&self) -> String {
        self.name.clone()
    }

    /// Frames that are listed and whose image exists.
    pub fn usable_frames(&self, camera: i64) -> Vec<i64> {
        self.views[&camera].times.keys().copied().filter(|&frame| self.has(Kind::Image, camera, frame)).collect()
    }

    /// Rejects images whose size differs from that of the camera's intrinsics.
    pub fn check_size(&self, camera: i64, image: &Path, (width, height): (usize, usize)) -> Result<()> {
        match self.views[&camera].size {
            Some((w, h)) if (w, h) != (width, height) => Err(Error::new(
                ErrorKind::Input,
                format!("the intrinsics of camera {camera} are for another image size"),
            )
            .at(image.display())
            .found(format!("{width} × {height} pixels"))
            .wanted(format!("{w} × {h} pixels, as in {}", self.list.display()))
            .fix("give the images at that size, or correct size, focal lengths and principal point in the list")),
            _ => Ok(()),
        }
    }
}

/// The layout of a folder by the files present, and notes about other layouts that it matches.
fn recognise(root: &Path, wanted: Option<Format>) -> Result<(Format, Vec<String>)> {
    let found: Vec<Format> = Format::ALL.into_iter().filter(|format| format.list(root).is_some()).collect();
    let chosen = match wanted {
        Some(format) if found.contains(&format) => format,
        Some(format) => {
            return Err(Error::new(ErrorKind::Input, "the folder does not have the layout that clip.toml names")
                .at(root.join(side::NAME).display())
                .found(format!("layout = {:?}, but no such image list in the folder", format.key()))
                .wanted(KNOWN)
                .fix("correct the layout, or leave it out to have it recognised"));
        }
        None => match found.first() {
            Some(&format) => format,
            None => {
                let binary = colmap::has_binary(root);
                return Err(Error::new(ErrorKind::Input, "the folder has no image list that is known")
                    .at(root.display())
                    .found(if binary { "a COLMAP model in binary form" } else { "none of the files below" })
                    .wanted(KNOWN)
                    .fix(if binary {
                        "convert it: colmap model_converter --input_path sparse/0 --output_path sparse/0 --output_type TXT"
                    } else {
                        "export the clip with its cameras, or give the folder that holds the list"
                    }));
            }
        },
    };
    let others: Vec<&str> = found.iter().filter(|&&f| f != chosen).map(|f| f.key()).collect();
    let mut said = Vec::new();
    if !others.is_empty() {
        let what = format!(
            "read as {:?}; the folder could also be {}: name the one that is meant as layout = \"…\" in {}",
            chosen.key(),
            others.join(" or "),
            side::NAME
        );
        said.push(what);
    }
    Ok((chosen, said))
}

fn last_component(root: &Path) -> String {
    let absolute = root.canonicalize().unwrap_or_else(|_| root.to_path_buf());
    absolute.file_name().map_or_else(|| "clip".into(), |name| name.to_string_lossy().into_owned())
}

/// Reads a list as JSON.
fn json(path: &Path) -> Result<Value> {
    serde_json::from_str(&text(path)?).map_err(|e| malformed(path, e, "JSON (NaN is not JSON)"))
}

/// Reads a list as text.
fn text(path: &Path) -> Result<String> {
    let fix = "export the clip with its cameras, or give the folder that holds them";
    text::read(path, "the image list", fix, MAX_LIST_BYTES)
}

fn malformed(path: &Path, found: impl fmt::Display, wanted: impl fmt::Display) -> Error {
    Error::new(ErrorKind::Input, "the image list is malformed")
        .at(path.display())
        .found(found)
        .wanted(wanted)
        .fix("export the list again")
}
