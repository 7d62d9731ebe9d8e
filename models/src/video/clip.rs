//! A clip in memory: opening it, and access to its times and frames.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use gradreel::{Error, ErrorKind, Result};
use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::camera::Camera;
use super::foreground::{Foreground, Source, same_size};
use super::image::Image;
use super::layout::{Kind, Layout};
use super::plausible;
use super::select::{Selection, select};
use super::story::Story;

/// Maximum memory of a clip, and memory per pixel: the decoded image, colour, coverage and weight \[bytes\].
const MOST_BYTES: u64 = 8 << 30;
const BYTES_PER_PIXEL: u64 = 4 + 4 * (3 + 1 + 1);

/// One image of one camera: the object alone on white.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Colour `[H, W, 3]`, sRGB 0…1, composited on white with `alpha`.
    pub rgb: Array3<f32>,
    /// Coverage by the object `[H, W]`, 0…1.
    pub alpha: Array2<f32>,
    /// Weight of each pixel `[H, W]`: 0 where the pixel is excluded, 1 elsewhere.
    pub weight: Array2<f32>,
}

/// The images of several synchronous, static cameras.
///
/// ```no_run
/// use gradreel_models::video::{Clip, OpenOptions};
///
/// let clip = Clip::open("examples/clips/bird".as_ref(), &OpenOptions::default())?;
/// println!("{} cameras, {} frames every {} s", clip.cameras.len(), clip.frame_count(), clip.frame_dt());
/// let pixel = clip.frames[0][3].rgb[[80, 80, 0]];
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Clip {
    /// Name of the clip's folder, or of the sequence in it.
    pub name: String,
    /// The clip's folder.
    pub root: PathBuf,
    /// The cameras, in the requested order (ascending by number by default).
    pub cameras: Vec<Camera>,
    /// Time of each frame \[s\].
    pub times: Vec<f64>,
    /// Frame numbers as in the file names.
    pub frame_numbers: Vec<i64>,
    /// `frames[camera][frame]`.
    pub frames: Vec<Vec<Frame>>,
    /// Foreground source of each camera.
    pub foreground: Vec<Foreground>,
    /// For each camera, whether it is imagined: its images were synthesized from those of real cameras.
    pub imagined: Vec<bool>,
    /// Assumptions made about axes, unit and times. Lines that begin with `warning: ` mark implausible values.
    pub assumptions: Vec<String>,
    /// Position and ballistic motion of the object, for single-camera drops (see [`crate::monocular`]).
    pub flight: Option<Flight>,
    /// Synthesized views of the first frame, for single-camera drops.
    pub around: Option<Around>,
    /// What happens in the film, for clips of one.
    pub story: Option<Arc<Story>>,
}

/// Synthesized views of the first frame from other viewpoints.
#[derive(Debug, Clone)]
pub struct Around {
    /// The synthesized views, in the clip's world coordinates.
    pub views: Vec<(Camera, Frame)>,
    /// Number of views that may disagree on any point of the object.
    pub dissent: usize,
}

/// The ballistic phase at the start of the clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flight {
    /// Centre of the object in the first frame \[m\].
    pub centre: [f64; 3],
    /// Velocity in the first frame \[m/s\].
    pub velocity: [f64; 3],
    /// Covariance of the velocity \[m²/s²\]; the variance is largest along the line of sight.
    pub velocity_covariance: [[f64; 3]; 3],
    /// Covariance of the velocity with the relative distance \[m/s\]: a more distant object is faster.
    pub velocity_with_distance: [f64; 3],
    /// Gravity \[m/s²\].
    pub gravity: [f64; 3],
    /// Number of ballistic frames, counted from the first.
    pub frames: usize,
    /// Depth of the object's centre in the first frame, along the camera axis \[m\].
    pub distance: f64,
    /// Size of the object in the first frame, perpendicular to the line of sight, along the longer side of its
    /// silhouette \[m\].
    pub diameter: f64,
    /// Relative standard deviation of the object's distance, and hence of every length.
    pub deviation: f64,
    /// Whether the metric scale of the whole world, ground included, follows from this drop. Otherwise the camera
    /// is calibrated and only the object's depth is uncertain.
    pub scales_world: bool,
    /// What is known of the camera's pitch, together with the rest.
    pub pitch: PitchSpread,
}

/// How uncertain the downward pitch of a camera is, and its covariances with what the fall tells; zero where the pitch is known.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PitchSpread {
    /// Standard deviation \[rad\].
    pub deviation: f64,
    /// Covariance with the velocity \[rad m/s\].
    pub with_velocity: [f64; 3],
    /// Covariance with the relative distance \[rad\].
    pub with_distance: f64,
}

/// Prefix of those lines of [`Clip::assumptions`] that warn of implausible values.
pub(crate) const WARNING: &str = "warning: ";

/// Selection of what to open of a clip; the default is everything.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct OpenOptions {
    /// Numbers of the cameras to use; `None` for all.
    pub cameras: Option<Vec<i64>>,
    /// Number of the first frame to use; `None` for the first one listed.
    pub first_frame: Option<i64>,
    /// Largest number of frames to use; `None` for all.
    pub max_frames: Option<usize>,
    /// Whether the progress of reading a film is shown on stderr.
    pub progress: bool,
}

impl Flight {
    /// Minimum number of ballistic frames.
    pub const LEAST_FRAMES: usize = 3;

    /// Standard deviations of the velocity \[m/s\].
    pub fn velocity_deviation(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.velocity_covariance[axis][axis].max(0.0).sqrt())
    }

    /// Position of the object's centre after `t` seconds of free flight \[m\].
    pub fn at(&self, t: f64) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.centre[axis] + self.velocity[axis] * t + 0.5 * self.gravity[axis] * t * t)
    }
}

/// A half-open rectangle of pixels: columns `left..right`, rows `top..bottom`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelRect {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// Column after the last.
    pub right: usize,
    /// Row after the last.
    pub bottom: usize,
}

impl PixelRect {
    /// Number of columns.
    pub fn width(&self) -> usize {
        self.right - self.left
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.bottom - self.top
    }
}

/// Rejects, from the image headers, a set of images that would need too much memory.
fn check_bytes(layout: &Layout, jobs: &[(i64, i64)]) -> Result<()> {
    let pixels = |&(c, f): &(i64, i64)| {
        let (width, height) = Image::frame_size(&layout.file(Kind::Image, c, f))?;
        Ok(width as u64 * height as u64)
    };
    let pixels: u64 = jobs.par_iter().map(pixels).collect::<Result<Vec<u64>>>()?.iter().sum();
    if pixels <= MOST_BYTES / BYTES_PER_PIXEL {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Input, "the clip is too large")
        .at(layout.root.display())
        .found(format!("{} images of {} megapixels in all", jobs.len(), pixels / 1_000_000))
        .wanted(format!("at most {} megapixels", MOST_BYTES / BYTES_PER_PIXEL / 1_000_000))
        .fix("take fewer cameras or frames (--cameras, --frames), or export the images and their cameras smaller"))
}

impl Clip {
    /// The clip reduced to one camera.
    ///
    /// # Panics
    /// When there is no camera at this position.
    #[must_use]
    pub fn single(&self, position: usize) -> Self {
        Self {
            cameras: vec![self.cameras[position].clone()],
            frames: vec![self.frames[position].clone()],
            foreground: vec![self.foreground[position]],
            imagined: vec![self.imagined[position]],
            ..self.clone()
        }
    }

    /// The assumptions line by line, prefixed with `warning: ` for implausible values and with `assumed: `
    /// otherwise.
    pub fn said(&self) -> impl Iterator<Item = String> + '_ {
        self.assumptions.iter().map(|line| match line.starts_with(WARNING) {
            true => line.clone(),
            false => format!("assumed: {line}"),
        })
    }

    /// The first frame with the synthesized views around it, real views first; `None` without synthesized views.
    pub fn all_around(&self) -> Option<Self> {
        let first = |frames: &Vec<Frame>| vec![frames[0].clone()];
        let around = self.around.as_ref()?;
        let (cameras, views): (Vec<Camera>, Vec<Vec<Frame>>) =
            around.views.iter().map(|(camera, frame)| (camera.clone(), vec![frame.clone()])).unzip();
        let count = cameras.len();
        Some(Self {
            cameras: [&self.cameras[..], &cameras].concat(),
            times: self.times[..1].to_vec(),
            frame_numbers: self.frame_numbers[..1].to_vec(),
            frames: self.frames.iter().map(first).chain(views).collect(),
            foreground: self.foreground.iter().copied().chain(vec![Foreground::White; count]).collect(),
            imagined: self.imagined.iter().copied().chain(vec![true; count]).collect(),
            around: None,
            story: None,
            ..self.clone()
        })
    }

    /// Reads a clip: the list, every selected image (in parallel), and the object's alpha in each image.
    ///
    /// `path` is the clip's folder, in any of the layouts of [`Format`](super::Format); for a real capture of
    /// Spring-Gaus, it is the file of the sequence.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the file and a remedy, if the folder or list is missing or malformed; a matrix
    /// is unusable; an image is missing, corrupt, too large or of a different size than the other images of its
    /// camera; all images together need too much memory; frames are missing or unevenly spaced in time; times,
    /// lenses or positions are implausible; a camera has no foreground source; some frame shows the object in no
    /// camera; or some camera never shows it.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Clip> {
        Self::of_layout(&Layout::read(path)?, options)
    }

    /// Like [`Clip::open`], for a folder whose lists were already read.
    pub(super) fn of_layout(layout: &Layout, options: &OpenOptions) -> Result<Clip> {
        let Selection { cameras: ids, frames: numbers, times, said } = select(layout, options)?;
        let mut assumptions = [layout.assumptions.clone(), said].concat();
        let jobs: Vec<(i64, i64)> = ids.iter().flat_map(|&c| numbers.iter().map(move |&f| (c, f))).collect();
        check_bytes(layout, &jobs)?;
        let images: Vec<Image> =
            jobs.par_iter().map(|&(c, f)| Image::read_frame(&layout.file(Kind::Image, c, f))).collect::<Result<_>>()?;
        let count = numbers.len();
        let mut cameras = Vec::new();
        let mut sources = Vec::new();
        for (&id, images) in ids.iter().zip(images.chunks(count)) {
            let size = [images[0].width, images[0].height];
            layout.check_size(id, &layout.file(Kind::Image, id, numbers[0]), (size[0], size[1]))?;
            for (&number, image) in numbers.iter().zip(images) {
                same_size(&layout.file(Kind::Image, id, number), (image.width, image.height), id, size)?;
            }
            sources.push(Source::choose(layout, id, &numbers, images)?);
            let view = &layout.views[&id];
            let [fx, fy, cx, cy] = view.intrinsic;
            let camera = Camera { id, width: size[0], height: size[1], fx, fy, cx, cy, c2w: view.c2w };
            assumptions.extend(plausible::camera(&camera, &layout.list)?);
            cameras.push(camera);
        }
        if sources.iter().any(|source| source.foreground == Foreground::Plate) {
            let what = "whatever differs from the background plate by more than a soft shadow is the object";
            assumptions.push(what.to_owned());
        }
        let mut made = jobs
            .par_iter()
            .zip(&images)
            .enumerate()
            .map(|(job, (&(c, f), image))| sources[job / count].frame(layout, c, f, image))
            .collect::<Result<Vec<Frame>>>()?
            .into_iter();
        let frames: Vec<Vec<Frame>> = ids.iter().map(|_| made.by_ref().take(count).collect()).collect();
        let foreground = sources.iter().map(|source| source.foreground).collect();
        let mut clip = Clip {
            name: layout.name(),
            root: layout.root.clone(),
            cameras,
            times,
            frame_numbers: numbers,
            frames,
            foreground,
            imagined: Vec::new(),
            assumptions,
            flight: None,
            around: None,
            story: None,
        };
        let imagined: Vec<i64> = layout.imagined.iter().filter(|id| ids.contains(id)).copied().collect();
        clip.imagine(&imagined)?;
        clip.check_visible()?;
        Ok(clip)
    }

    /// Marks the cameras with these numbers as imagined and all others as real.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for an unknown camera number, or if no real camera remains; the clip is unchanged then.
    pub fn imagine(&mut self, ids: &[i64]) -> Result<()> {
        let known = || self.cameras.iter().map(|camera| camera.id.to_string()).collect::<Vec<_>>().join(", ");
        if let Some(unknown) = ids.iter().find(|id| self.cameras.iter().all(|camera| camera.id != **id)) {
            return Err(Error::new(ErrorKind::Input, "a view is to be imagined that is not in use")
                .at(self.root.display())
                .found(format!("camera {unknown}"))
                .wanted(format!("some of {}", known()))
                .fix("correct the list of imagined cameras, or choose that camera, too"));
        }
        let imagined: Vec<bool> = self.cameras.iter().map(|camera| ids.contains(&camera.id)).collect();
        if !imagined.contains(&false) {
            return Err(Error::new(ErrorKind::Input, "no view of the clip is real")
                .at(self.root.display())
                .found(format!("all of cameras {} are imagined", known()))
                .wanted("at least one camera that somebody filmed with")
                .fix("use the real camera, too (--cameras), or correct imagined in clip.toml"));
        }
        self.imagined = imagined;
        Ok(())
    }

    /// Number of frames of every camera.
    pub fn frame_count(&self) -> usize {
        self.times.len()
    }

    /// Time between two frames \[s\]; 0 for a clip of one frame.
    pub fn frame_dt(&self) -> f64 {
        match self.times.as_slice() {
            [first, .., last] => (last - first) / (self.times.len() - 1) as f64,
            _ => 0.0,
        }
    }

    /// The clip shrunk by an integer factor (box averages; see [`Frame::scaled`] and [`Camera::scaled`]).
    ///
    /// # Panics
    /// If the factor is zero or leaves no pixel.
    #[track_caller]
    #[must_use]
    pub fn scaled(&self, factor: usize) -> Clip {
        let cameras = self.cameras.iter().map(|camera| camera.scaled(factor)).collect();
        let frames = self.frames.par_iter().map(|row| row.iter().map(|frame| frame.scaled(factor)).collect()).collect();
        Clip {
            name: self.name.clone(),
            root: self.root.clone(),
            cameras,
            times: self.times.clone(),
            frame_numbers: self.frame_numbers.clone(),
            frames,
            foreground: self.foreground.clone(),
            imagined: self.imagined.clone(),
            assumptions: self.assumptions.clone(),
            flight: self.flight,
            around: self.around.clone(),
            story: self.story.clone(),
        }
    }

    /// Bounding rectangle of the pixels with alpha above one half, expanded by `margin` pixels within the image.
    ///
    /// `None` if the camera does not see the object. `camera` and `frame` are positions in [`Clip::frames`].
    ///
    /// # Panics
    /// If there is no such camera or frame.
    #[track_caller]
    pub fn pixel_rect(&self, camera: usize, frame: usize, margin: usize) -> Option<PixelRect> {
        let alpha = &self.frames[camera][frame].alpha;
        let (height, width) = alpha.dim();
        let mut rect: Option<PixelRect> = None;
        for ((y, x), _) in alpha.indexed_iter().filter(|(_, a)| **a > 0.5) {
            let r = rect.get_or_insert(PixelRect { left: x, top: y, right: x + 1, bottom: y + 1 });
            *r = PixelRect {
                left: r.left.min(x),
                top: r.top.min(y),
                right: r.right.max(x + 1),
                bottom: r.bottom.max(y + 1),
            };
        }
        rect.map(|r| PixelRect {
            left: r.left.saturating_sub(margin),
            top: r.top.saturating_sub(margin),
            right: r.right.saturating_add(margin).min(width),
            bottom: r.bottom.saturating_add(margin).min(height),
        })
    }

    /// Checks that every camera sees the object at some time and that some camera sees it at every time.
    fn check_visible(&self) -> Result<()> {
        let sees = |frame: &Frame| frame.alpha.iter().any(|&a| a > 0.5);
        let seen: Vec<Vec<bool>> = self.frames.par_iter().map(|row| row.iter().map(sees).collect()).collect();
        let nothing = |what: String, fix: &str| {
            Error::new(ErrorKind::Input, what)
                .at(self.root.display())
                .found("no pixel with alpha above one half")
                .wanted("an object that differs from the background")
                .fix(fix)
        };
        for ((camera, source), seen) in self.cameras.iter().zip(&self.foreground).zip(&seen) {
            if !seen.contains(&true) {
                let (id, first, last) = (camera.id, self.frame_numbers[0], self.frame_numbers[seen.len() - 1]);
                let what = format!("camera {id} never sees an object (frames {first}–{last}; alpha from {source})");
                return Err(nothing(what, "leave this camera out, or check its masks or background plate"));
            }
        }
        for (f, number) in self.frame_numbers.iter().enumerate() {
            if !seen.iter().any(|row| row[f]) {
                let ids: Vec<String> = self.cameras.iter().map(|camera| camera.id.to_string()).collect();
                let what = format!("no camera sees an object in frame {number} (cameras {})", ids.join(", "));
                return Err(nothing(what, "choose frames in which the object is visible, or give masks"));
            }
        }
        Ok(())
    }
}
