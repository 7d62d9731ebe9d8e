//! Height of the ground under a falling object.

use super::free_fall::FreeFall;
use super::locate::Body;
use crate::vector::{dot, minus, plus};
use crate::video::{Camera, Frame};

/// Number of frames after first contact that are evaluated: the object has neither moved nor deformed much yet.
const LANDED: usize = 2;

/// Depth offset of the lowest visible point towards the camera, as a share of half the object's extent. A body
/// inferred from a silhouette is as deep as it is wide in every *part*; most real objects are deeper overall.
const NEARER: f64 = 0.3;

/// Height of the ground relative to the initial position of the object's centre (a negative number), as a share of
/// the initial distance; `None` if the fall lasts to the end of the film.
///
/// In the first frames after contact the undeformed body is placed on the extrapolated trajectory and raised until
/// the lower edge of its silhouette matches the image. The lowest point over these frames lies on the ground.
pub(super) fn below(camera: &Camera, frames: &[Frame], times: &[f64], fall: &FreeFall) -> Option<f64> {
    let body = Body::of(camera, &frames[0])?;
    let up = fall.down.map(|x| -x);
    let lowest = body.points.iter().map(|p| dot(*p, up)).fold(f64::INFINITY, f64::min);
    let counts = |k: &usize| frames[*k].weight.iter().any(|weight| *weight > 0.0);
    let landed = (fall.frames..frames.len()).filter(counts).take(LANDED);
    let heights = landed.filter_map(|k| {
        let edge = lower_edge(&frames[k])?;
        let at = fall.at(times[k] - times[0]);
        // the edge is monotonic in the lift: bisection
        let (mut low, mut high) = (-1.0, 1.0);
        for _ in 0..40 {
            let lift = 0.5 * (low + high);
            let centre = plus(at, up.map(|x| lift * x));
            let row = |p: &[f64; 3]| {
                let [_, y, z] = plus(*p, centre);
                if z < 0.0 { camera.cy + camera.fy * y / z } else { f64::INFINITY }
            };
            let seen = body.points.iter().map(row).fold(f64::NEG_INFINITY, f64::max);
            if seen > edge { low = lift } else { high = lift }
        }
        let [x, _, _] = plus(at, up.map(|x| low * x));
        let nearer = NEARER * body.half_extent() * steepness([x, -(edge - camera.cy) / camera.fy, -1.0], up).max(0.0);
        Some(dot(minus(at, fall.start), up) + low + lowest + nearer)
    });
    heights.reduce(f64::min)
}

/// Descent of a line of sight per unit of horizontal length.
fn steepness(sight: [f64; 3], up: [f64; 3]) -> f64 {
    let rise = dot(sight, up);
    -rise / (dot(sight, sight) - rise * rise).max(f64::MIN_POSITIVE).sqrt()
}

/// Lower edge of the object \[pixels\]; `None` if it coincides with the image's.
fn lower_edge(frame: &Frame) -> Option<f64> {
    let inside = frame.alpha.indexed_iter().filter(|(_, alpha)| **alpha > 0.5);
    let last = inside.map(|((row, _), _)| row).max()?;
    (last + 1 < frame.alpha.nrows()).then_some(last as f64 + 1.0)
}
