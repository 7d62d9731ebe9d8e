//! Synthesized views of the first frame, aligned with the object seen by the camera.

use gradreel::ops::NodeGrid;
use gradreel::{Error, ErrorKind, Result};
use ndarray::Array2;
use rayon::prelude::*;

use crate::field::{Sphere, bounding_sphere, hull, place};
use crate::vector::{dot, minus, plus, product, times};
use crate::video::{Around, Camera, Clip};

/// Voxels of the body along the radius of its bounding sphere.
const VOXELS: f64 = 24.0;
/// Samples of a pixel's ray through that sphere.
const SAMPLES: usize = 96;
/// Reciprocal of the maximum share of views that may disagree on a voxel.
const MOST_DISSENT: usize = 4;
/// Number of corrections of scale and position.
const ROUNDS: usize = 6;
/// Minimum intersection over union of the aligned body's silhouette with the object's.
const ALIKE: f64 = 0.5;

/// Adds synthesized views of the first frame to a single-camera clip. `views` is a clip of one frame in its own
/// coordinates (y up, any unit and origin, as written by `gradreel synthesize`); its first camera is assumed to
/// have the azimuth of the real one.
///
/// The visual hull of the views is rotated to face the real camera, then moved and scaled until its silhouette
/// matches the filmed one in area and centroid; its depth is that of the ballistic fit. Returns the final
/// intersection over union of the two silhouettes.
///
/// # Errors
/// [`ErrorKind::Input`] if the clip has more than one camera, if the views contradict each other, or if they do not
/// resemble the object.
pub fn surround(clip: &mut Clip, views: &Clip) -> Result<f64> {
    let refused = |what: &str| Error::new(ErrorKind::Input, what.to_owned()).at(views.root.display());
    let [camera] = &clip.cameras[..] else {
        return Err(refused("only what a single camera filmed is surrounded by imagined views")
            .found(format!("{} cameras", clip.cameras.len()))
            .fix("choose one with --cameras, or leave --views and --imagine out"));
    };
    let centre = bounding_sphere(clip, 0)?.centre;
    let filmed = clip.frames[0][0].alpha.mapv(|alpha| alpha > 0.5);
    let (area, middle) = extent(&filmed).ok_or_else(|| refused("the first frame does not show the object"))?;
    let (body, dissent) = Body::of(views)?;
    let mut placed = Placed::facing(camera, centre, &views.cameras[0], body.middle());
    let lost =
        || refused("the imagined views show nothing where the object is").fix("try another --seed, or other views");
    for _ in 0..ROUNDS {
        let (seen, at) = extent(&body.silhouette(&placed.in_views(camera))).ok_or_else(lost)?;
        placed.scale *= (area / seen).sqrt();
        placed.shift(camera, [middle[0] - at[0], middle[1] - at[1]]);
    }
    let alike = overlap(&filmed, &body.silhouette(&placed.in_views(camera)));
    if alike < ALIKE {
        return Err(refused("the imagined views do not look like the object")
            .found(format!("silhouettes that agree by {alike:.2} (intersection over union)"))
            .wanted(format!("at least {ALIKE}"))
            .fix("try another --seed, other weights or other views, or do without"));
    }
    let first = views.frames.iter().map(|frames| frames[0].clone());
    let views = views.cameras.iter().map(|camera| placed.in_world(camera)).zip(first).collect();
    clip.around = Some(Around { views, dissent });
    Ok(alike)
}

/// A body in the views' coordinates.
struct Body {
    node_grid: NodeGrid,
    filled: Vec<bool>,
    sphere: Sphere,
}

impl Body {
    /// Visual hull of the views, and the number of views that may disagree on a voxel, chosen to maximise the
    /// agreement of its silhouettes with all views. Zero tolerance makes the hull too thin where a single view is
    /// wrong; too much tolerance makes it too large.
    fn of(views: &Clip) -> Result<(Self, usize)> {
        let count = views.cameras.len();
        let views = Clip { imagined: vec![true; count], ..views.clone() };
        let sphere = bounding_sphere(&views, 0)?;
        let masks: Vec<Array2<bool>> = views.frames.iter().map(|frames| frames[0].alpha.mapv(|a| a > 0.5)).collect();
        let tried = (0..=count / MOST_DISSENT).map(|dissent| {
            let hull = hull(&views, 0, &sphere, sphere.radius / VOXELS, 0.5, dissent)?;
            let mut filled = vec![false; hull.node_grid.len()];
            hull.voxels.iter().for_each(|&voxel| filled[voxel as usize] = true);
            let body = Self { node_grid: hull.node_grid, filled, sphere };
            let each = views.cameras.par_iter().zip(&masks);
            let alike: Vec<f64> = each.map(|(camera, mask)| overlap(mask, &body.silhouette(camera))).collect();
            Ok((alike.iter().sum::<f64>(), body, dissent))
        });
        // an empty hull at zero tolerance may become non-empty at a larger one
        let best = tried.reduce(|best, next| match (best, next) {
            (Ok(best), Ok(next)) => Ok(if next.0 > best.0 { next } else { best }),
            (Ok(found), Err(_)) | (Err(_), Ok(found)) => Ok(found),
            (Err(first), Err(_)) => Err(first),
        });
        best.expect("no dissent is tried").map(|(_, body, dissent)| (body, dissent))
    }

    /// Centroid of its voxels.
    fn middle(&self) -> [f64; 3] {
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for (flat, _) in self.filled.iter().enumerate().filter(|(_, filled)| **filled) {
            sum = plus(sum, place(&self.node_grid, flat));
            count += 1.0;
        }
        sum.map(|s| s / count)
    }

    fn is_filled(&self, x: [f64; 3]) -> bool {
        let NodeGrid { origin, spacing, dims } = self.node_grid;
        let node: [f64; 3] = std::array::from_fn(|axis| ((x[axis] - origin[axis]) / spacing).round());
        let inside = (0..3).all(|axis| node[axis] >= 0.0 && node[axis] < dims[axis] as f64);
        let [i, j, k] = node.map(|n| n as usize);
        inside && self.filled[(i * dims[1] + j) * dims[2] + k]
    }

    /// Its silhouette in a camera.
    fn silhouette(&self, camera: &Camera) -> Array2<bool> {
        let Sphere { centre, radius, .. } = self.sphere;
        Array2::from_shape_fn((camera.height, camera.width), |(row, column)| {
            let (from, along) = camera.ray(column as f64 + 0.5, row as f64 + 0.5);
            let along = along.map(|x| x / dot(along, along).sqrt());
            let to_centre = minus(centre, from);
            let nearest = dot(to_centre, along);
            let apart = dot(to_centre, to_centre) - nearest * nearest;
            apart < radius * radius && {
                let half = (radius * radius - apart).sqrt();
                (0..SAMPLES).any(|k| {
                    let t = nearest + half * (2.0 * (k as f64 + 0.5) / SAMPLES as f64 - 1.0);
                    self.is_filled([0, 1, 2].map(|axis| from[axis] + t * along[axis]))
                })
            }
        })
    }
}

/// Similarity from the views' coordinates to the world: `x ↦ origin + scale · turn (x − middle)`.
struct Placed {
    turn: [[f64; 3]; 3],
    scale: f64,
    origin: [f64; 3],
    middle: [f64; 3],
}

impl Placed {
    /// Aligns the azimuth of the first view with the camera's and scales by the ratio of the distances.
    fn facing(camera: &Camera, centre: [f64; 3], first: &Camera, middle: [f64; 3]) -> Self {
        let azimuth = |from: [f64; 3], at: [f64; 3]| {
            let away = minus(from, at);
            away[0].atan2(away[2])
        };
        let angle = azimuth(camera.centre(), centre) - azimuth(first.centre(), middle);
        let (sine, cosine) = angle.sin_cos();
        let turn = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]];
        let length = |x: [f64; 3]| dot(x, x).sqrt();
        let [near, far] = [(first, middle), (camera, centre)].map(|(camera, at)| length(minus(camera.centre(), at)));
        Self { turn, scale: far / near, origin: centre, middle }
    }

    /// Shifts the body by a number of pixels to the right and down at constant depth.
    fn shift(&mut self, camera: &Camera, [right, down]: [f64; 2]) {
        let Some([u, v, depth]) = camera.project(self.origin) else { return };
        let (from, along) = camera.ray(u + right, v + down);
        self.origin = plus(from, along.map(|x| depth * x));
    }

    /// A camera of the views in world coordinates.
    fn in_world(&self, camera: &Camera) -> Camera {
        let from = times(&self.turn, minus(camera.centre(), self.middle)).map(|x| self.scale * x);
        moved(camera, self.turn, plus(self.origin, from))
    }

    /// A camera of the world in the views' coordinates.
    fn in_views(&self, camera: &Camera) -> Camera {
        let back = [0, 1, 2].map(|i| [0, 1, 2].map(|j| self.turn[j][i]));
        let from = times(&back, minus(camera.centre(), self.origin)).map(|x| x / self.scale);
        moved(camera, back, plus(self.middle, from))
    }
}

/// The camera with rotated axes at another position.
fn moved(camera: &Camera, turn: [[f64; 3]; 3], to: [f64; 3]) -> Camera {
    let axes = product(turn, camera.c2w.map(|row| [row[0], row[1], row[2]]));
    Camera { c2w: std::array::from_fn(|i| [axes[i][0], axes[i][1], axes[i][2], to[i]]), ..camera.clone() }
}

/// Intersection over union.
fn overlap(a: &Array2<bool>, b: &Array2<bool>) -> f64 {
    let count = |of: fn(bool, bool) -> bool| a.iter().zip(b).filter(|(a, b)| of(**a, **b)).count() as f64;
    count(|a, b| a && b) / count(|a, b| a || b).max(1.0)
}

/// Number of pixels of a silhouette, and its centroid.
fn extent(mask: &Array2<bool>) -> Option<(f64, [f64; 2])> {
    let (mut count, mut sum) = (0.0, [0.0; 2]);
    for ((row, column), _) in mask.indexed_iter().filter(|(_, inside)| **inside) {
        count += 1.0;
        sum = [sum[0] + column as f64 + 0.5, sum[1] + row as f64 + 0.5];
    }
    (count > 0.0).then(|| (count, sum.map(|s| s / count)))
}
