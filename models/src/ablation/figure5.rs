//! Figure 5 of the paper: views with and without the spatial-aware module, and how far the object is from its place in them.

use gradreel::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::field::{bounding_sphere, hull, place};
use crate::monocular;
use crate::published::pictures::Pictures;
use crate::published::{Path, Placing, PublishedConfig, Rig, ViewMaker, boxes};
use crate::report::animation::Picture;
use crate::runtime::interrupt;
use crate::runtime::run_folder::RunFolder;
use crate::video::{Camera, Clip, Frame};
use crate::views::ImageBox;

/// Voxels of the true body along the radius of its ball.
const VOXELS: f64 = 24.0;

/// Views of a row of the picture.
const SHOWN: usize = 8;

/// Ways to bring the object to its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ways {
    /// The model is shown the film's framing, and its module the box and the distance.
    WithModule,
    /// The model is shown the film's framing alone.
    WithoutModule,
    /// The model is shown the object in the middle, and its views are moved.
    Moved,
}

impl Ways {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::WithModule, Self::WithoutModule, Self::Moved];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::WithModule => "with_module",
            Self::WithoutModule => "without_module",
            Self::Moved => "moved",
        }
    }

    /// The label in tables.
    pub fn label(self) -> &'static str {
        match self {
            Self::WithModule => "with the spatial-aware module",
            Self::WithoutModule => "without it",
            Self::Moved => "of the centred object, moved",
        }
    }

    fn placing(self) -> Placing {
        if self == Self::Moved { Placing::Moved } else { Placing::Module }
    }
}

/// How well views have the object at its place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Placed {
    /// Mean distance between the centres of the object's box in a view and of the true one, as a share of the picture's side.
    pub centre: f64,
    /// Mean intersection over union of these boxes.
    pub overlap: f64,
    /// Views without any object, as a share.
    pub empty: f64,
    /// Number of views.
    pub views: usize,
}

/// Makes the views of some frames of a film in these ways, and measures them against what all cameras of the clip saw; returns the
/// numbers and a picture with the true places framed. `folder` keeps what is made.
///
/// # Errors
/// [`ErrorKind::Input`] for a clip that cannot be used or weights without a module; [`ErrorKind::Interrupted`].
pub fn measure(
    clip: &Clip,
    primary: usize,
    config: &PublishedConfig,
    gravity: [f64; 3],
    frames: &[usize],
    folder: &RunFolder,
    each: &mut dyn FnMut(&str) -> Result<()>,
) -> Result<(Vec<(Ways, Placed)>, Picture)> {
    let weights = config.open_weights()?;
    let (sizes, _) = ViewMaker::settings(&weights, config)?;
    if sizes.denoiser.spatial_aware.is_none() {
        return Err(Error::new(ErrorKind::Input, "the weights have no spatial-aware module to compare with")
            .at(weights.path().display())
            .fix(
                "give weights that were trained with `train novel-view --stage spatial-aware`, or the built-in ones",
            ));
    }
    let mut film = clip.single(primary);
    monocular::sight(&mut film, gravity)?;
    let boxes = boxes::of_masks(&film)?;
    let path = Path::of_boxes(&film, &boxes)?;
    let rig = Rig::around(&sizes.denoiser.ring, &film.cameras[0], &path);
    let pictures = Pictures { film: &film, boxes: &boxes, path: &path, rig: &rig };
    let truths = frames.iter().map(|frame| body(clip, *frame)).collect::<Result<Vec<_>>>()?;
    let mut found = Vec::new();
    let mut tiles = Vec::new();
    for way in Ways::ALL {
        let placing = way.placing();
        let maker = ViewMaker::new(&weights, config, way == Ways::WithModule)?;
        let cameras = pictures.cameras(&sizes, placing)?;
        let inside = RunFolder::open(&made_folder(folder, way)?)?;
        let mut sum = Placed { centre: 0.0, overlap: 0.0, empty: 0.0, views: 0 };
        for (frame, points) in frames.iter().zip(&truths) {
            each(&format!("frame {frame}, {}", way.label()))?;
            let shown = || pictures.shown(*frame, &sizes, placing);
            let made = maker.frame(&inside, *frame, &shown, &mut |_| interrupt::check())?;
            let views = pictures.views(*frame, &made, &sizes, placing)?;
            for (number, (camera, view)) in cameras.iter().zip(&views).enumerate() {
                let Some(wanted) = projected(camera, points) else { continue };
                add(&mut sum, view, &wanted);
                if *frame == frames[frames.len() - 1] && number.is_multiple_of(cameras.len().div_ceil(SHOWN)) {
                    tiles.push(framed(view, &wanted, sizes.image)?);
                }
            }
        }
        let count = sum.views.max(1) as f64;
        let mean = Placed { centre: sum.centre / count, overlap: sum.overlap / count, empty: sum.empty / count, ..sum };
        found.push((way, mean));
    }
    Ok((found, Picture::grid(cells_in_row(rig.views()), &tiles)))
}

fn cells_in_row(views: usize) -> usize {
    views.div_ceil(views.div_ceil(SHOWN))
}

/// The folder of a way's views.
fn made_folder(folder: &RunFolder, way: Ways) -> Result<std::path::PathBuf> {
    let path = folder.path(way.name());
    std::fs::create_dir_all(&path).map_err(|e| Error::io(&path, "make a folder of the bench", &e))?;
    Ok(path)
}

/// Points of the true body in a frame: the hull of all cameras.
fn body(clip: &Clip, frame: usize) -> Result<Vec<[f64; 3]>> {
    let sphere = bounding_sphere(clip, frame)?;
    let hull = hull(clip, frame, &sphere, sphere.radius / VOXELS, 0.5, 0)?;
    Ok(hull.voxels.iter().map(|voxel| place(&hull.node_grid, *voxel as usize)).collect())
}

/// The box of points in a camera.
fn projected(camera: &Camera, points: &[[f64; 3]]) -> Option<ImageBox> {
    let sides = [camera.width as f64, camera.height as f64];
    let mut seen = points.iter().filter_map(|point| camera.project(*point));
    let [u, v, _] = seen.next()?;
    let (mut low, mut high) = ([u, v], [u, v]);
    for [u, v, _] in seen {
        (low, high) = ([low[0].min(u), low[1].min(v)], [high[0].max(u), high[1].max(v)]);
    }
    Some(ImageBox { low: [0, 1].map(|a| low[a] / sides[a]), high: [0, 1].map(|a| high[a] / sides[a]) })
}

fn add(sum: &mut Placed, view: &Frame, wanted: &ImageBox) {
    sum.views += 1;
    // an empty view has its object nowhere: in the middle, as a point
    let found = boxes::of_frame(view);
    sum.empty += f64::from(u8::from(found.is_none()));
    let found = found.unwrap_or(ImageBox { low: [0.5; 2], high: [0.5; 2] });
    let [a, b] = [found.centre(), wanted.centre()];
    sum.centre += (a[0] - b[0]).hypot(a[1] - b[1]);
    sum.overlap += found.overlap(wanted);
}

/// A view in `size²` pixels with the frame of where the object is.
fn framed(view: &Frame, wanted: &ImageBox, size: usize) -> Result<Picture> {
    let factor = (view.alpha.dim().1 / size).max(1);
    let small = if factor > 1 { view.scaled(factor) } else { view.clone() };
    let (height, width) = small.alpha.dim();
    let mut picture = Picture::from_unit(width, height, &small.rgb.iter().copied().collect::<Vec<f32>>())?;
    let end = |at: [f64; 2]| {
        [0, 1].map(|axis| {
            let side = [width, height][axis] as f64;
            (at[axis] * side).clamp(0.0, side - 1.0) as usize
        })
    };
    let ([left, top], [right, bottom]) = (end(wanted.low), end(wanted.high));
    let mut put = |x: usize, y: usize| picture.rgb[3 * (y * width + x)..][..3].copy_from_slice(&[217, 51, 64]);
    (left..=right).for_each(|x| [top, bottom].into_iter().for_each(|y| put(x, y)));
    (top..=bottom).for_each(|y| [left, right].into_iter().for_each(|x| put(x, y)));
    Ok(picture)
}
