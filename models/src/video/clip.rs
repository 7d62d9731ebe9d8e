//! A clip in memory: opening, time and frame access.

use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::camera::Camera;
use super::foreground::{Foreground, Source, same_size};
use super::image::Image;
use super::layout::{Kind, Layout};
use super::plausible;
use super::select::{Selection, select};

/// Most memory of a clip \[bytes\], and what a pixel needs: the image as read, colour, coverage and weight.
const MOST_BYTES: u64 = 8 << 30;
const BYTES_PER_PIXEL: u64 = 4 + 4 * (3 + 1 + 1);

/// One image of one camera, the object alone on white.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Colour `[H, W, 3]`, sRGB 0…1, composited on white with `alpha`.
    pub rgb: Array3<f32>,
    /// Coverage by the object `[H, W]`, 0…1.
    pub alpha: Array2<f32>,
    /// Weight of each pixel `[H, W]`: 0 where the pixel is excluded, 1 elsewhere.
    pub weight: Array2<f32>,
}

/// The images of several synchronous, motionless cameras.
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
    /// The cameras, in the order asked for (by default ascending by number).
    pub cameras: Vec<Camera>,
    /// Time of each frame \[s\].
    pub times: Vec<f64>,
    /// Number of each frame in the file names.
    pub frame_numbers: Vec<i64>,
    /// `frames[camera][frame]`.
    pub frames: Vec<Vec<Frame>>,
    /// How each camera got its alpha.
    pub foreground: Vec<Foreground>,
    /// Whether each camera is one that nobody filmed with: its images were imagined from those of others.
    pub imagined: Vec<bool>,
    /// What had to be assumed about axes, unit and times. Lines that begin with `warning: ` say what is hardly so.
    pub assumptions: Vec<String>,
    /// Where the object is and how it flies, where a single camera saw it fall (see [`crate::monocular`]).
    pub flight: Option<Flight>,
    /// Views of the first frame that nobody filmed, of what a single camera saw.
    pub around: Option<Around>,
}

/// What the first frame would have looked like from other places.
#[derive(Debug, Clone)]
pub struct Around {
    /// The imagined views, in the world of the clip.
    pub views: Vec<(Camera, Frame)>,
    /// How many of them may be wrong about a point of the object.
    pub dissent: usize,
}

/// The free flight that the object begins with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flight {
    /// The middle of the object in the first frame \[m\].
    pub centre: [f64; 3],
    /// Its velocity there \[m/s\].
    pub velocity: [f64; 3],
    /// Covariance of the velocity \[m²/s²\]: along the line of sight it is known least.
    pub velocity_covariance: [[f64; 3]; 3],
    /// Covariance of the velocity with the distance as a share of it \[m/s\]: if the object is further away, it is faster.
    pub velocity_with_distance: [f64; 3],
    /// Gravity \[m/s²\].
    pub gravity: [f64; 3],
    /// The frames that show it, from the first on.
    pub frames: usize,
    /// How far away the middle of the object is in the first frame, along the camera's axis \[m\].
    pub distance: f64,
    /// How large the object is there, across the line of sight, along the longer side of what is seen of it \[m\].
    pub diameter: f64,
    /// Standard deviation of the object's distance as a share of it: that of every length.
    pub deviation: f64,
    /// Whether the world's metres, those of the ground among them, follow from this fall; otherwise the camera is calibrated, and only the
    /// object may be nearer or further.
    pub scales_world: bool,
}

/// How a line among [`Clip::assumptions`] begins that warns of what is hardly so.
pub(crate) const WARNING: &str = "warning: ";

/// What to open of a clip; the default is everything.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct OpenOptions {
    /// Numbers of the cameras to use; `None` for all.
    pub cameras: Option<Vec<i64>>,
    /// Number of the first frame to use; `None` for the first there is.
    pub first_frame: Option<i64>,
    /// Largest number of frames to use; `None` for all.
    pub max_frames: Option<usize>,
}

impl Flight {
    /// The frames that show a free fall, at least.
    pub const LEAST_FRAMES: usize = 3;

    /// Standard deviations of the velocity \[m/s\].
    pub fn velocity_deviation(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.velocity_covariance[axis][axis].max(0.0).sqrt())
    }

    /// Where the middle of the object is after a time \[s\].
    pub fn at(&self, t: f64) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.centre[axis] + self.velocity[axis] * t + 0.5 * self.gravity[axis] * t * t)
    }
}

/// A rectangle of pixels, half open: columns `left..right`, rows `top..bottom`.
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

/// Refuses images that together need too much memory, by their headers.
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
    /// What one camera saw of it.
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

    /// What is said of the clip, line by line: `warning: …` for what is hardly so, `assumed: …` for all else.
    pub fn said(&self) -> impl Iterator<Item = String> + '_ {
        self.assumptions.iter().map(|line| match line.starts_with(WARNING) {
            true => line.clone(),
            false => format!("assumed: {line}"),
        })
    }

    /// The first frame with the views around it, the real ones first; `None` if there are none.
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
            ..self.clone()
        })
    }

    /// Reads a clip: the list, every selected image (in parallel), and the object's alpha in each.
    ///
    /// `path` is the clip's folder, in any of the layouts of [`Format`](super::Format); for a real capture of Spring-Gaus,
    /// the file of the sequence.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] with the file concerned and a way out, if the folder or list is missing or malformed, a
    /// matrix is unusable, an image is missing, corrupt, too large or of another size than its camera's others, all images
    /// together need too much memory, frames are missing or unevenly spaced in time, times, lenses or places are not those of a
    /// film, a camera has nothing that tells the object from the background, no camera sees an object in some frame, or some
    /// camera never sees one.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Clip> {
        Self::of_layout(&Layout::read(path)?, options)
    }

    /// The same of a folder whose lists were read.
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
        };
        let imagined: Vec<i64> = layout.imagined.iter().filter(|id| ids.contains(id)).copied().collect();
        clip.imagine(&imagined)?;
        clip.check_visible()?;
        Ok(clip)
    }

    /// Calls the cameras of these numbers imagined and all others real.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a number that no camera of the clip has, and when no real camera is left; nothing is changed
    /// then.
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
        }
    }

    /// Bounding rectangle of the pixels with alpha above one half, grown by `margin` pixels within the image.
    ///
    /// `None` where the camera does not see the object. `camera` and `frame` are positions in [`Clip::frames`].
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

    /// An object must be seen by every camera at some time and by some camera at every time.
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
