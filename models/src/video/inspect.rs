//! Inventory of a clip's folder, complete or not.

use std::fmt;
use std::path::{Path, PathBuf};

use gradreel::Result;

use super::clip::{Clip, OpenOptions, WARNING};
use super::foreground::{Foreground, choose};
use super::image::Image;
use super::layout::{EXCLUDED, Format, Kind, Layout, PLATE};
use super::select::{ranges, select};

/// What a clip's folder holds, what is missing, and what opening it assumes.
#[derive(Debug, Clone)]
pub struct Inventory {
    /// Name of the folder.
    pub name: String,
    /// The folder.
    pub root: PathBuf,
    /// Recognised layout.
    pub layout: Format,
    /// One row per camera.
    pub cameras: Vec<CameraInventory>,
    /// Time between frames \[s\], if the frames are complete and evenly spaced.
    pub frame_dt: Option<f64>,
    /// Problems that prevent opening the clip; empty if there are none.
    pub problems: Vec<String>,
    /// Assumptions made when opening.
    pub assumptions: Vec<String>,
}

/// Inventory of one camera.
#[derive(Debug, Clone)]
pub struct CameraInventory {
    /// Number of the camera.
    pub id: i64,
    /// Where its images are; empty if its number identifies them.
    pub name: String,
    /// Width and height of its first image \[pixels\], if readable.
    pub size: Option<(usize, usize)>,
    /// Listed frames.
    pub listed: Vec<i64>,
    /// Listed frames whose image exists.
    pub usable: Vec<i64>,
    /// Whether there is a background plate (frame −1).
    pub has_plate: bool,
    /// Whether there is a plate of excluded pixels (frame −2).
    pub has_excluded: bool,
    /// Foreground source, if there is one.
    pub foreground: Option<Foreground>,
    /// Whether its images were synthesized from those of real cameras.
    pub imagined: bool,
}

impl Inventory {
    /// Whether the clip can be opened.
    pub fn is_complete(&self) -> bool {
        self.problems.is_empty()
    }
}

/// Inspects a clip's folder and tries to open the clip.
///
/// # Errors
/// As [`Clip::open`] if the folder is missing or has no readable list; all other problems are reported in
/// [`Inventory::problems`].
pub fn inspect(path: &Path) -> Result<Inventory> {
    inspect_and_open(path, &OpenOptions::default()).map(|(inventory, _)| inventory)
}

/// Like [`inspect()`], restricted to what `options` select; also returns the clip if it can be opened.
///
/// If opening fails, the folder is searched for further problems, so that all of them are reported at once.
///
/// # Errors
/// As [`inspect()`].
pub fn inspect_and_open(path: &Path, options: &OpenOptions) -> Result<(Inventory, Option<Clip>)> {
    let layout = Layout::read(path)?;
    let mut problems = Vec::new();
    let mut cameras: Vec<CameraInventory> = Vec::new();
    let opened = Clip::of_layout(&layout, options);
    for &id in layout.views.keys() {
        let chosen = options.cameras.as_ref().is_none_or(|chosen| chosen.contains(&id));
        let mut found = Vec::new();
        cameras.push(match opened.as_ref().ok().and_then(|clip| opened_camera(&layout, clip, id)) {
            Some(camera) => camera,
            None => camera(&layout, id, &mut found),
        });
        if chosen {
            problems.append(&mut found);
        }
    }
    let (clip, frame_dt, assumptions) = match opened {
        Ok(clip) => {
            problems.clear();
            let dt = Some(clip.frame_dt()).filter(|dt| *dt > 0.0);
            let assumptions = clip.assumptions.clone();
            (Some(clip), dt, assumptions)
        }
        Err(error) => {
            let error = error.to_string();
            if !problems.contains(&error) {
                problems.insert(0, error);
            }
            let times = select(&layout, options).map(|selection| selection.times).unwrap_or_default();
            (None, times.get(1).map(|second| second - times[0]), layout.assumptions.clone())
        }
    };
    let (name, format) = (layout.name(), layout.format);
    let inventory = Inventory { name, root: layout.root, layout: format, cameras, frame_dt, problems, assumptions };
    Ok((inventory, clip))
}

/// Inventory of a camera of an opened clip.
fn opened_camera(layout: &Layout, clip: &Clip, id: i64) -> Option<CameraInventory> {
    let at = clip.cameras.iter().position(|camera| camera.id == id)?;
    Some(CameraInventory {
        size: Some((clip.cameras[at].width, clip.cameras[at].height)),
        foreground: Some(clip.foreground[at]),
        ..listed_camera(layout, id)
    })
}

/// Inventory of a camera from the lists and file names alone.
fn listed_camera(layout: &Layout, id: i64) -> CameraInventory {
    CameraInventory {
        id,
        name: layout.views[&id].name.clone(),
        size: None,
        listed: layout.views[&id].times.keys().copied().collect(),
        usable: layout.usable_frames(id),
        has_plate: layout.has(Kind::Image, id, PLATE),
        has_excluded: layout.has(Kind::Image, id, EXCLUDED),
        foreground: None,
        imagined: layout.imagined.contains(&id),
    }
}

/// Inventory of a camera from the headers of its images and its first image; appends to `problems`.
fn camera(layout: &Layout, id: i64, problems: &mut Vec<String>) -> CameraInventory {
    let listed = listed_camera(layout, id);
    let usable = &listed.usable;
    let mut size = None;
    let mut transparent = false;
    for &frame in usable {
        let path = layout.file(Kind::Image, id, frame);
        let read = match size {
            None => Image::read_frame(&path).map(|image| {
                transparent = image.is_transparent_somewhere();
                (image.width, image.height)
            }),
            Some(_) => Image::frame_size(&path),
        };
        match (read, size) {
            (Err(error), _) => problems.push(error.to_string()),
            (Ok(found), None) => {
                problems.extend(layout.check_size(id, &path, found).err().map(|error| error.to_string()));
                size = Some(found);
            }
            (Ok(found), Some(first)) if found != first => problems.push(format!(
                "{} has {} × {} pixels, the first image of camera {id} {} × {}",
                path.display(),
                found.0,
                found.1,
                first.0,
                first.1
            )),
            _ => {}
        }
    }
    let foreground = if usable.is_empty() {
        None
    } else {
        choose(layout, id, usable, transparent).map_err(|error| problems.push(error.to_string())).ok()
    };
    CameraInventory { size, foreground, ..listed }
}

impl fmt::Display for Inventory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = |count: usize, one: &str| if count == 1 { format!("1 {one}") } else { format!("{count} {one}s") };
        writeln!(f, "clip {} ({})", self.name, self.root.display())?;
        writeln!(f, "  layout: {}", self.layout)?;
        let frames = self.cameras.iter().map(|camera| camera.usable.len()).max().unwrap_or(0);
        write!(f, "  {}, up to {}", plural(self.cameras.len(), "camera"), plural(frames, "frame"))?;
        match self.frame_dt {
            Some(dt) => writeln!(f, ", {:.4} s apart ({:.1} per second)", dt, 1.0 / dt)?,
            None => writeln!(f)?,
        }
        for camera in &self.cameras {
            let size = camera.size.map_or("unknown size".into(), |(w, h)| format!("{w} × {h}"));
            let foreground = camera.foreground.map_or("nothing to tell the object by".into(), |s| s.to_string());
            let name = if camera.name.is_empty() { String::new() } else { format!(" ({})", camera.name) };
            write!(
                f,
                "  camera {}{name}: {size}, frames {}, object by {foreground}",
                camera.id,
                ranges(&camera.usable)
            )?;
            let excluded = if camera.has_excluded { ", some pixels excluded" } else { "" };
            writeln!(f, "{excluded}{}", if camera.imagined { ", imagined" } else { "" })?;
        }
        for (title, lines) in [("assumed: ", &self.assumptions), ("problem: ", &self.problems)] {
            for line in lines {
                let title = if line.starts_with(WARNING) { "" } else { title };
                writeln!(f, "  {title}{}", line.replace('\n', "\n    "))?;
            }
        }
        f.write_str(match (self.is_complete(), self.frame_dt) {
            (false, _) => "  cannot be used as it is",
            (true, Some(_)) => "  ready to open",
            (true, None) => "  ready to open as views (--views), not to reconstruct: a single frame shows no motion",
        })
    }
}
