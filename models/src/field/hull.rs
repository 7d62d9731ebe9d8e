//! The visual hull: the largest body consistent with all silhouettes of a frame.

use faer::prelude::Solve;
use faer::{Mat, Side};
use gradreel::ops::NodeGrid;
use gradreel::{Error, ErrorKind, Result};
use rayon::prelude::*;

use crate::field::Inflated;
use crate::vector::unit;
use crate::video::{Camera, Clip, Frame};

/// Largest number of voxels of the box around an object.
const MOST_NODES: usize = 1 << 26;

/// A bounding ball of the object \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Its centre.
    pub centre: [f64; 3],
    /// Its radius.
    pub radius: f64,
    /// Whether the distance from the camera is assumed, because only a single camera saw the object.
    pub assumed_depth: bool,
}

/// The voxels of a visual hull.
#[derive(Debug, Clone)]
pub struct Hull {
    /// The grid of the voxels.
    pub node_grid: NodeGrid,
    /// Flat indices of the voxels inside, increasing.
    pub voxels: Vec<u32>,
}

/// Position of a silhouette: its mean pixel, and the largest distance from it.
struct Silhouette {
    mean: [f64; 2],
    reach: f64,
}

/// A bounding ball of the object in one frame, from its silhouettes: the point nearest to all central rays, and 1.1
/// times the largest extent of a silhouette at its distance.
///
/// With a single camera the distance comes from the flight; without a known flight, the centre is the point of the
/// central ray nearest to the world's origin.
///
/// # Errors
/// [`ErrorKind::Input`] when no camera sees the object, or the rays do not meet in front of the cameras.
pub fn bounding_sphere(clip: &Clip, frame: usize) -> Result<Sphere> {
    let views: Vec<(&Camera, Silhouette)> = clip
        .cameras
        .iter()
        .zip(&clip.frames)
        .filter_map(|(camera, frames)| Some((camera, silhouette(&frames[frame])?)))
        .collect();
    let no_object = |what: &str| {
        Error::new(ErrorKind::Input, format!("frame {frame}: {what}"))
            .at(clip.root.display())
            .fix("check the masks of this frame with `gradreel check`, and that c2w is OpenGL (looks along −z, y up)")
    };
    if views.is_empty() {
        return Err(no_object("no camera sees the object"));
    }
    let pull = if views.len() == 1 { 1e-9 } else { 0.0 };
    let central = views.iter().map(|(camera, silhouette)| (*camera, silhouette.mean));
    let flown = clip.flight.filter(|flight| views.len() == 1 && frame < flight.frames);
    let centre = match flown {
        Some(flight) => flight.at(clip.times[frame] - clip.times[0]),
        None => {
            meeting_point(central, [0.0; 3], pull).ok_or_else(|| no_object("the cameras' central rays are parallel"))?
        }
    };
    let mut radius = 0.0f64;
    for (camera, silhouette) in &views {
        let [.., depth] = camera.project(centre).ok_or_else(|| no_object("the silhouettes meet behind a camera"))?;
        radius = radius.max(silhouette.reach * depth / camera.fx.min(camera.fy));
    }
    Ok(Sphere { centre, radius: 1.1 * radius, assumed_depth: views.len() == 1 && flown.is_none() })
}

/// The point nearest to rays through given pixels, one per camera. The weight `pull` draws it to `towards`. `None` for
/// parallel rays without a pull.
pub(crate) fn meeting_point<'a>(
    pixels: impl Iterator<Item = (&'a Camera, [f64; 2])>,
    towards: [f64; 3],
    pull: f64,
) -> Option<[f64; 3]> {
    // normal equations: Σ (I − d dᵀ) (x − o) + pull (x − towards) = 0
    let mut matrix = Mat::from_fn(3, 3, |i, j| if i == j { pull } else { 0.0 });
    let mut right = Mat::from_fn(3, 1, |i, _| pull * towards[i]);
    for (camera, [u, v]) in pixels {
        let (origin, direction) = camera.ray(u, v);
        let d = unit(direction);
        for i in 0..3 {
            for j in 0..3 {
                let projector = f64::from(u8::from(i == j)) - d[i] * d[j];
                matrix[(i, j)] += projector;
                right[(i, 0)] += projector * origin[j];
            }
        }
    }
    let solution = matrix.llt(Side::Lower).ok()?.solve(&right);
    Some([0, 1, 2].map(|axis| solution[(axis, 0)]))
}

/// The mean pixel of the object, if the whole object is in the image.
pub(crate) fn middle(frame: &Frame) -> Option<[f64; 2]> {
    let (height, width) = frame.alpha.dim();
    let cut = frame.alpha.indexed_iter().any(|((row, column), &alpha)| {
        alpha > 0.5 && (row == 0 || column == 0 || row + 1 == height || column + 1 == width)
    });
    (!cut).then(|| silhouette(frame)).flatten().map(|silhouette| silhouette.mean)
}

fn silhouette(frame: &Frame) -> Option<Silhouette> {
    let (mut mass, mut mean) = (0.0, [0.0; 2]);
    for ((row, column), &alpha) in frame.alpha.indexed_iter().filter(|(_, alpha)| **alpha > 0.5) {
        mass += f64::from(alpha);
        mean[0] += f64::from(alpha) * (column as f64 + 0.5);
        mean[1] += f64::from(alpha) * (row as f64 + 0.5);
    }
    if mass == 0.0 {
        return None;
    }
    let mean = mean.map(|m| m / mass);
    let reach =
        frame.alpha.indexed_iter().filter(|(_, alpha)| **alpha > 0.5).fold(0.0f64, |reach, ((row, column), _)| {
            reach.max((column as f64 + 0.5 - mean[0]).hypot(row as f64 + 0.5 - mean[1]))
        });
    Some(Silhouette { mean, reach })
}

/// Carves the visual hull of one frame out of a ball, on voxels of this spacing \[m\] at odd multiples of half the
/// spacing.
///
/// A voxel stays if every real camera that has it in its image sees a coverage of at least `threshold` there, and all
/// but `dissent` of the imagined cameras do. With a single camera it must also lie in the inflated body
/// ([`half_thickness`](crate::field::half_thickness)).
///
/// # Errors
/// [`ErrorKind::Input`] when no voxel stays: masks and cameras contradict each other.
pub fn hull(clip: &Clip, frame: usize, sphere: &Sphere, spacing: f64, threshold: f32, dissent: usize) -> Result<Hull> {
    let first = sphere.centre.map(|c| ((c - sphere.radius) / spacing).floor());
    let last = sphere.centre.map(|c| ((c + sphere.radius) / spacing).ceil());
    let dims: [usize; 3] = std::array::from_fn(|a| (last[a] - first[a]) as usize + 1);
    if dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d)).is_none_or(|nodes| nodes > MOST_NODES) {
        return Err(Error::new(ErrorKind::Input, "the voxels are too fine for the object")
            .at(clip.root.display())
            .found(format!("{spacing} m, for an object within {:.3} m", sphere.radius))
            .wanted(format!("at most {MOST_NODES} voxels around it"))
            .fix("raise geometry.dx (--dx), twice the spacing of the voxels"));
    }
    let inflated = match (&clip.cameras[..], &clip.frames[..]) {
        ([camera], [frames]) => Inflated::of(camera, &frames[frame], sphere.centre),
        _ => None,
    };
    let node_grid = NodeGrid { origin: first.map(|i| (i + 0.5) * spacing), spacing, dims };
    let inside = |flat: usize| {
        let point = place(&node_grid, flat);
        let from_centre: f64 = (0..3).map(|a| (point[a] - sphere.centre[a]).powi(2)).sum();
        let within = inflated.as_ref().is_none_or(|body| body.contains(point, 1.0, spacing));
        from_centre <= sphere.radius * sphere.radius && within && {
            let views = clip.cameras.iter().zip(&clip.frames).zip(&clip.imagined);
            let mut views = views.filter_map(|((camera, frames), imagined)| {
                let [u, v, _] = camera.project(point)?;
                Some((coverage(&frames[frame], u, v)?, *imagined))
            });
            let (mut seen, mut against) = (false, 0);
            views.all(|(alpha, imagined)| {
                seen = true;
                let inside = alpha >= threshold;
                against += usize::from(imagined && !inside);
                inside || imagined
            }) && seen
                && against <= dissent
        }
    };
    let voxels: Vec<u32> = (0..node_grid.len()).into_par_iter().filter(|&i| inside(i)).map(|i| i as u32).collect();
    if voxels.is_empty() {
        return Err(Error::new(ErrorKind::Input, format!("frame {frame}: the silhouettes have no body in common"))
            .at(clip.root.display())
            .found(format!("nothing within {:.3} m of {:.3?}", sphere.radius, sphere.centre))
            .fix(
                "check that c2w is camera-to-world (OpenGL: looks along −z, y up) and belongs to these images, and that \
                 geometry.dx (--dx) is smaller than the object",
            ));
    }
    Ok(Hull { node_grid, voxels })
}

/// The grid coordinates of a voxel, from its flat index.
pub(super) fn node(node_grid: &NodeGrid, flat: usize) -> [usize; 3] {
    let [_, ny, nz] = node_grid.dims;
    [flat / (ny * nz), flat / nz % ny, flat % nz]
}

/// The position of a voxel \[m\], from its flat index.
pub(crate) fn place(node_grid: &NodeGrid, flat: usize) -> [f64; 3] {
    let node = node(node_grid, flat);
    std::array::from_fn(|axis| node_grid.origin[axis] + node[axis] as f64 * node_grid.spacing)
}

/// Restores what the first camera saw where imagined views carved away everything along its rays, with the thickness of
/// the inflated body. Filmed silhouettes take precedence over imagined ones.
///
/// The hull's grid must enclose the object.
pub(crate) fn fill_gaps(hull: Hull, clip: &Clip, frame: usize, centre: [f64; 3], threshold: f32) -> Hull {
    let (camera, seen) = (&clip.cameras[0], &clip.frames[0][frame]);
    let Some(inflated) = Inflated::of(camera, seen, centre) else { return hull };
    let node_grid = hull.node_grid;
    // pixels covered by voxels of the hull
    let mut covered = seen.alpha.mapv(|_| false);
    let (height, width) = covered.dim();
    for [u, v, depth] in hull.voxels.iter().filter_map(|&voxel| camera.project(place(&node_grid, voxel as usize))) {
        let reach = 0.5 * node_grid.spacing * camera.fx / depth;
        let range = |x: f64, end: usize| (x - reach).max(0.0) as usize..((x + reach).max(0.0) as usize + 1).min(end);
        let (rows, columns) = (range(v, height), range(u, width));
        if !rows.is_empty() && !columns.is_empty() {
            covered.slice_mut(ndarray::s![rows, columns]).fill(true);
        }
    }
    let missing = |flat: usize| {
        let point = place(&node_grid, flat);
        camera.project(point).is_some_and(|[u, v, _]| {
            coverage(seen, u, v).is_some_and(|alpha| alpha >= threshold)
                && !covered[[v as usize, u as usize]]
                && inflated.contains(point, 1.0, node_grid.spacing)
        })
    };
    // disjoint from the hull, whose voxels cover their own pixels
    let mut voxels: Vec<u32> =
        (0..node_grid.len()).into_par_iter().filter(|&flat| missing(flat)).map(|flat| flat as u32).collect();
    voxels.extend(&hull.voxels);
    voxels.sort_unstable();
    Hull { node_grid, voxels }
}

/// Bilinear coverage at an image point; `None` outside, or where the frame's weight excludes the pixel.
fn coverage(frame: &Frame, u: f64, v: f64) -> Option<f32> {
    let (height, width) = frame.alpha.dim();
    if !(u >= 0.0 && v >= 0.0 && u < width as f64 && v < height as f64) {
        return None;
    }
    let (x, y) = ((u - 0.5).clamp(0.0, width as f64 - 1.0), (v - 0.5).clamp(0.0, height as f64 - 1.0));
    let (column, row) = (x as usize, y as usize);
    let (right, below) = ((column + 1).min(width - 1), (row + 1).min(height - 1));
    if frame.weight[[row, column]] < 0.5 {
        return None;
    }
    let (fx, fy) = ((x - column as f64) as f32, (y - row as f64) as f32);
    let top = frame.alpha[[row, column]] * (1.0 - fx) + frame.alpha[[row, right]] * fx;
    let bottom = frame.alpha[[below, column]] * (1.0 - fx) + frame.alpha[[below, right]] * fx;
    Some(top * (1.0 - fy) + bottom * fy)
}
