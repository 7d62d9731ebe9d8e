//! What a folder holds, without insisting that it is complete.

use std::fmt;
use std::path::{Path, PathBuf};

use gradreel::Result;

use super::clip::OpenOptions;
use super::foreground::{Foreground, choose};
use super::image::Image;
use super::layout::{EXCLUDED, Format, Kind, Layout, PLATE};
use super::select::{ranges, select};

/// What a clip's folder holds, what is missing, and what opening it will assume.
#[derive(Debug, Clone)]
pub struct Inventory {
    /// Name of the folder.
    pub name: String,
    /// The folder.
    pub root: PathBuf,
    /// How the folder is laid out.
    pub layout: Format,
    /// One row per camera.
    pub cameras: Vec<CameraInventory>,
    /// Time between frames \[s\], if the frames are complete and evenly spaced.
    pub frame_dt: Option<f64>,
    /// What keeps the clip from being opened; empty if it can be.
    pub problems: Vec<String>,
    /// What opening will take for granted.
    pub assumptions: Vec<String>,
}

/// What there is of one camera.
#[derive(Debug, Clone)]
pub struct CameraInventory {
    /// Number of the camera.
    pub id: i64,
    /// Where its images are, in words; empty if its number says it.
    pub name: String,
    /// Width and height of its first image \[pixels\], if that could be read.
    pub size: Option<(usize, usize)>,
    /// Frames that are listed.
    pub listed: Vec<i64>,
    /// Frames that are listed and whose image exists.
    pub usable: Vec<i64>,
    /// Whether there is a background plate (frame −1).
    pub has_plate: bool,
    /// Whether there is a plate of excluded pixels (frame −2).
    pub has_excluded: bool,
    /// How the object will be told from the background, if there is a way.
    pub foreground: Option<Foreground>,
    /// Whether nobody filmed with it: its images were imagined from those of others.
    pub imagined: bool,
}

impl Inventory {
    /// Whether nothing was found that would keep the clip from being opened.
    pub fn is_complete(&self) -> bool {
        self.problems.is_empty()
    }
}

/// Looks at a clip's folder: reads the list, every image's header, and the first image of each camera.
///
/// # Errors
/// As [`Clip::open`](super::Clip::open) if there is no folder or no readable list; everything else that is wrong is
/// reported in [`Inventory::problems`].
pub fn inspect(path: &Path) -> Result<Inventory> {
    let layout = Layout::read(path)?;
    let mut problems = Vec::new();
    let mut frame_dt = None;
    match select(&layout, &OpenOptions::default()) {
        Ok(selection) => {
            frame_dt = selection.times.get(1).map(|second| second - selection.times[0]);
        }
        Err(error) => problems.push(error.to_string()),
    }
    let cameras: Vec<CameraInventory> = layout.views.keys().map(|&id| camera(&layout, id, &mut problems)).collect();
    let assumptions = assumptions(&layout, &cameras, frame_dt);
    let (name, format) = (layout.name(), layout.format);
    Ok(Inventory { name, root: layout.root, layout: format, cameras, frame_dt, problems, assumptions })
}

fn camera(layout: &Layout, id: i64, problems: &mut Vec<String>) -> CameraInventory {
    let listed: Vec<i64> = layout.views[&id].times.keys().copied().collect();
    let usable = layout.usable_frames(id);
    let mut size = None;
    let mut transparent = false;
    for &frame in &usable {
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
        choose(layout, id, &usable, transparent).map_err(|error| problems.push(error.to_string())).ok()
    };
    let (has_plate, has_excluded) = (layout.has(Kind::Image, id, PLATE), layout.has(Kind::Image, id, EXCLUDED));
    let name = layout.views[&id].name.clone();
    let imagined = layout.imagined.contains(&id);
    CameraInventory { id, name, size, listed, usable, has_plate, has_excluded, foreground, imagined }
}

fn assumptions(layout: &Layout, cameras: &[CameraInventory], frame_dt: Option<f64>) -> Vec<String> {
    let mut list = layout.assumptions.clone();
    if cameras.iter().any(|camera| camera.foreground == Some(Foreground::Plate)) {
        list.push("whatever differs from the background plate by more than a soft shadow is the object".into());
    }
    for camera in cameras {
        let Some((width, height)) = camera.size else { continue };
        let [_, _, cx, cy] = layout.views[&camera.id].intrinsic;
        if !(0.0..=width as f64).contains(&cx) || !(0.0..=height as f64).contains(&cy) {
            list.push(format!(
                "camera {} looks past its image: principal point ({cx}, {cy}) outside {width} × {height} pixels; are \
                 the intrinsics of another image size?",
                camera.id
            ));
        }
    }
    if frame_dt.is_none() && cameras.iter().all(|camera| camera.listed.len() == 1) {
        list.push("a single frame: shape only, no motion".into());
    }
    list
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
        for (title, lines) in [("assumed", &self.assumptions), ("problem", &self.problems)] {
            for line in lines {
                writeln!(f, "  {title}: {}", line.replace('\n', "\n    "))?;
            }
        }
        if self.is_complete() { write!(f, "  ready to open") } else { write!(f, "  cannot be opened as it is") }
    }
}
