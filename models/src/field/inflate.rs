//! The thickness of an object seen from one side only.

use ndarray::{Array2, Axis, Zip};

use crate::vector::{dot, minus};
use crate::video::{Camera, Frame};

/// Stands for infinity among squared distances; differences of true infinities would be NaN.
const FAR: f64 = 1e18;

/// The inflated body of one frame: the largest union of balls whose centres lie in the plane through the object's
/// centre that faces the camera.
pub(crate) struct Inflated<'a> {
    camera: &'a Camera,
    half_thickness: Array2<f64>,
    centre: [f64; 3],
    /// Unit vector from the camera to the centre.
    away: [f64; 3],
    /// Size of a pixel at the centre \[m\].
    pixel: f64,
}

impl<'a> Inflated<'a> {
    /// The body of a frame around this centre; `None` if the centre lies behind the camera.
    pub fn of(camera: &'a Camera, frame: &Frame, centre: [f64; 3]) -> Option<Self> {
        let [.., depth] = camera.project(centre)?;
        let sight = minus(centre, camera.centre());
        let away = sight.map(|x| x / dot(sight, sight).sqrt());
        let pixel = depth / (camera.fx * camera.fy).sqrt();
        Some(Self { camera, half_thickness: half_thickness(frame), centre, away, pixel })
    }

    /// Whether the body contains a point, with its depth scaled by `share` and its thickness at least `least` \[m\].
    pub fn contains(&self, point: [f64; 3], share: f64, least: f64) -> bool {
        let deep = dot(minus(point, self.centre), self.away);
        let foot = [0, 1, 2].map(|axis| point[axis] - deep * self.away[axis]);
        let Some([u, v, _]) = self.camera.project(foot) else { return false };
        if u < 0.0 || v < 0.0 {
            return false;
        }
        let half = self.half_thickness.get([v as usize, u as usize]).copied().unwrap_or(0.0);
        half > 0.0 && deep.abs() <= (share * half * self.pixel).max(0.5 * least)
    }
}

/// Half thickness of the object at each pixel \[pixels at its distance\]: that of the largest union of balls with
/// centres in one plane and this silhouette, `h²(x) = max d²(p) − |x − p|²` over the pixels `p` of the silhouette, with
/// `d` the distance from its contour. 0 outside.
///
/// A disc becomes a ball, a stripe a cylinder. This assumes that each part of the object is as deep as it is wide.
pub fn half_thickness(frame: &Frame) -> Array2<f64> {
    let inside = frame.alpha.mapv(|alpha| alpha > 0.5);
    // pad by one pixel: outside of the image is not object
    let (height, width) = inside.dim();
    let outside = Array2::from_shape_fn((height + 2, width + 2), |(y, x)| {
        let is_inside = (1..=height).contains(&y) && (1..=width).contains(&x) && inside[[y - 1, x - 1]];
        if is_inside { FAR } else { 0.0 }
    });
    // the contour runs halfway between two pixels
    let depth = nearest(outside).mapv(|squared| (squared.sqrt() - 0.5).max(0.0));
    let balls = nearest(depth.mapv(|d| if d > 0.0 { -d * d } else { FAR }));
    let balls = balls.slice(ndarray::s![1..=height, 1..=width]).to_owned();
    Zip::from(&balls).and(&inside).map_collect(|&ball, &inside| if inside { (-ball).max(0.0).sqrt() } else { 0.0 })
}

/// `min over p of f(p) + |x − p|²` at every pixel, by one pass along the rows and one along the columns (Felzenszwalb
/// and Huttenlocher, 2012).
fn nearest(mut f: Array2<f64>) -> Array2<f64> {
    for axis in [Axis(1), Axis(0)] {
        for mut lane in f.lanes_mut(axis) {
            let values = lane.to_vec();
            lane.iter_mut().zip(lower_envelope(&values)).for_each(|(to, value)| *to = value);
        }
    }
    f
}

/// `min over q of f(q) + (x − q)²` at every `x`: the lower envelope of parabolas.
fn lower_envelope(f: &[f64]) -> Vec<f64> {
    // parabolas of the envelope from left to right, each with the start of its interval
    let mut lowest: Vec<(usize, f64)> = Vec::new();
    for (q, &value) in f.iter().enumerate() {
        let meets = |p: usize| {
            let (here, there) = (q as f64, p as f64);
            ((value + here * here) - (f[p] + there * there)) / (2.0 * (here - there))
        };
        while lowest.last().is_some_and(|&(p, from)| meets(p) <= from) {
            lowest.pop();
        }
        let from = lowest.last().map_or(f64::NEG_INFINITY, |&(p, _)| meets(p));
        lowest.push((q, from));
    }
    let mut index = 0;
    let at = |x: usize| {
        while lowest.get(index + 1).is_some_and(|&(_, from)| from < x as f64) {
            index += 1;
        }
        let q = lowest[index].0;
        f[q] + (x as f64 - q as f64).powi(2)
    };
    (0..f.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_envelope_is_the_minimum_over_all() {
        let f = [5.0, FAR, 0.5, -3.0, FAR, FAR, 7.0, -1.0];
        let all = |x: usize| f.iter().enumerate().map(|(q, v)| v + (x as f64 - q as f64).powi(2)).fold(FAR, f64::min);
        let expected: Vec<f64> = (0..f.len()).map(all).collect();
        assert_eq!(lower_envelope(&f), expected);
    }

    #[test]
    fn a_stripe_is_a_cylinder_and_nothing_is_outside() {
        let alpha = Array2::from_shape_fn((30, 200), |(y, _)| f32::from((10..=20).contains(&y)));
        let frame = Frame { rgb: ndarray::Array3::ones((30, 200, 3)), weight: Array2::ones((30, 200)), alpha };
        let half = half_thickness(&frame);
        assert!((half[[15, 100]] - 5.5).abs() < 1e-9, "{}", half[[15, 100]]);
        assert!((half[[18, 100]] - (5.5f64.powi(2) - 9.0).sqrt()).abs() < 1e-9, "{}", half[[18, 100]]);
        assert_eq!(half[[5, 100]], 0.0);
    }
}
