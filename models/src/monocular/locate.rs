//! Ballistic fit of the object's centre, corrected for the bias of its silhouette.

use gradreel::Result;
use ndarray::Array2;

use super::free_fall::{FreeFall, Prior};
use super::sighting::Sighting;
use crate::field::Inflated;
use crate::vector::{minus, plus};
use crate::video::{Camera, Clip, Flight, Frame};

/// Resolution of the coarse silhouettes: pixels along the object's side.
const FINENESS: f64 = 60.0;

/// Number of alternations between predicted silhouettes and fit.
const ROUNDS: usize = 3;

/// The longest ballistic phase seen by the first camera of a clip, starting at its first frame. `None` if it did
/// not see the whole object fall for three frames.
///
/// The centroid of a silhouette is not the projection of the object's centre, and the area depends on the visible
/// side; both change with the viewing direction as the object moves. The fit corrects this bias with a body
/// inferred from the first frame.
///
/// # Errors
/// Those of [`FreeFall::fit`].
pub fn locate(clip: &Clip, prior: impl Into<Prior>) -> Result<Option<FreeFall>> {
    let prior = prior.into();
    fitted(clip, usize::MAX, |sightings, bias| FreeFall::longest(&clip.cameras[0], sightings, bias, prior))
}

/// The same for a fall that lasts for the first `frames` frames.
///
/// # Errors
/// Those of [`FreeFall::fit`].
pub fn locate_known(clip: &Clip, frames: usize, prior: Prior) -> Result<Option<FreeFall>> {
    let fit = |sightings: &[Sighting], bias: &[[f64; 3]]| {
        Ok(Some(FreeFall::fit(&clip.cameras[0], sightings, bias, prior)?).filter(FreeFall::is_sure))
    };
    Ok(fitted(clip, frames, fit)?.map(|fall| FreeFall { frames, ..fall }))
}

/// A fit to the sightings of the first `most` frames, corrected for their bias.
fn fitted(
    clip: &Clip,
    most: usize,
    fit: impl Fn(&[Sighting], &[[f64; 3]]) -> Result<Option<FreeFall>>,
) -> Result<Option<FreeFall>> {
    let (camera, frames) = (&clip.cameras[0], &clip.frames[0]);
    // frames of weight 0 are skipped
    let counting = frames.iter().enumerate().filter(|(_, frame)| frame.weight.iter().any(|weight| *weight > 0.0));
    let sighted = |(k, frame): (usize, &Frame)| Some((k, Sighting::of(camera, frame, clip.times[k] - clip.times[0])?));
    let (numbers, sightings): (Vec<usize>, Vec<Sighting>) =
        counting.take_while(|(k, _)| *k < most).map_while(sighted).unzip();
    if sightings.len() < Flight::LEAST_FRAMES {
        return Ok(None);
    }
    let Some(body) = Body::of(camera, &frames[0]) else { return Ok(None) };
    let mut fall = fit(&sightings, &[])?;
    for _ in 0..ROUNDS {
        let Some(path) = &fall else { break };
        let bias: Vec<[f64; 3]> = sightings.iter().map(|s| body.bias(camera, path, s.time)).collect();
        fall = fit(&sightings, &bias)?;
    }
    Ok(fall.map(|fall| FreeFall { frames: numbers[fall.frames - 1] + 1, ..fall }))
}

/// A body inferred from one frame.
pub(super) struct Body {
    /// Points in camera coordinates relative to their centre, as shares of the object's distance.
    pub points: Vec<[f64; 3]>,
    /// Side of a pixel in its coarse silhouettes \[pixels\].
    side: f64,
}

/// Camera-to-world matrix of a camera at the origin.
const EYE_AT_ORIGIN: [[f64; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// Bounding box of a silhouette: left, top, right and bottom \[pixels\].
fn extent(frame: &Frame) -> Option<[f64; 4]> {
    let inside = frame.alpha.indexed_iter().filter(|(_, alpha)| **alpha > 0.5);
    inside
        .map(|((row, column), _)| [column as f64, row as f64, column as f64 + 1.0, row as f64 + 1.0])
        .reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])])
}

impl Body {
    pub fn of(camera: &Camera, frame: &Frame) -> Option<Self> {
        let sight = Sighting::of(camera, frame, 0.0)?;
        let rect = extent(frame)?;
        // two points per coarse pixel, so that the silhouette has no holes
        let side = (sight.size.exp() / FINENESS).max(0.5);
        let at_origin = Camera { c2w: EYE_AT_ORIGIN, ..camera.clone() };
        let (_, centre) = at_origin.ray(sight.middle[0], sight.middle[1]);
        let inflated = Inflated::of(&at_origin, frame, centre)?;
        let mut points = Vec::new();
        let reach = (rect[2] - rect[0]).max(rect[3] - rect[1]);
        let cells = |length: f64, step: f64| (length / step) as i32 + 1;
        for row in 0..cells(rect[3] - rect[1], 0.5 * side) {
            for column in 0..cells(rect[2] - rect[0], 0.5 * side) {
                let (u, v) = (rect[0] + 0.5 * side * f64::from(column), rect[1] + 0.5 * side * f64::from(row));
                let layers = cells(0.5 * reach, side);
                for layer in -layers..=layers {
                    let depth = 1.0 + f64::from(layer) * side / camera.fx;
                    let point = at_origin.ray(u, v).1.map(|x| x * depth);
                    if inflated.contains(point, 1.0, 0.0) {
                        points.push(point);
                    }
                }
            }
        }
        let count = points.len() as f64;
        let centre: [f64; 3] = [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / count);
        points.iter_mut().for_each(|p| *p = minus(*p, centre));
        (!points.is_empty()).then_some(Self { points, side })
    }

    /// Half of its larger extent parallel to the image, as a share of the distance.
    pub fn half_extent(&self) -> f64 {
        let along = |axis: usize| self.points.iter().fold(0.0f64, |most, p| most.max(p[axis].abs()));
        along(0).max(along(1))
    }

    /// Silhouette of the body at a time on a path minus the projection of its centre: centroid \[pixels\] and log
    /// size.
    fn bias(&self, camera: &Camera, path: &FreeFall, time: f64) -> [f64; 3] {
        let centre = path.at(time);
        let moved: Vec<[f64; 3]> = self
            .points
            .iter()
            .map(|p| plus(*p, centre))
            .filter(|p| p[2] < 0.0)
            .map(|[x, y, z]| [camera.cx - camera.fx * x / z, camera.cy + camera.fy * y / z, -z])
            .collect();
        let low = [0, 1].map(|axis| moved.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min).floor());
        let high = [0, 1].map(|axis| moved.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max));
        let cells = |axis: usize| ((high[axis] - low[axis]) / self.side) as usize + 1;
        if moved.is_empty() || cells(0).saturating_mul(cells(1)) > 1 << 24 {
            return [0.0; 3];
        }
        let mut seen = Array2::<f32>::zeros((cells(1), cells(0)));
        for [u, v, _] in &moved {
            seen[[((v - low[1]) / self.side) as usize, ((u - low[0]) / self.side) as usize]] = 1.0;
        }
        let Some(silhouette) = Sighting::of_coverage(camera, &seen, low, self.side, time) else { return [0.0; 3] };
        let [x, y, z] = centre;
        [
            silhouette.middle[0] - (camera.cx - camera.fx * x / z),
            silhouette.middle[1] - (camera.cy + camera.fy * y / z),
            silhouette.size + (-z).ln(),
        ]
    }
}
