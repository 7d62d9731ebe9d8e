//! How well a body of two depth layers agrees with the true one, beside simpler bodies.

use super::features::{HALF, PLACE};
use super::picture::PIXELS;
use super::sample::Sample;

/// A tilt from which its sign counts \[°\].
pub(crate) const TILTED_DEG: f64 = 20.0;

/// Layers over the pixels where the truth of a sample is known.
pub(crate) struct Layered {
    pub front: Vec<f64>,
    pub back: Vec<f64>,
}

/// The pixels of a sample where its truth is known.
pub(crate) struct Seen {
    pixels: Vec<usize>,
    /// Places to the right and downwards \[D\].
    places: [Vec<f64>; 2],
    /// Half thickness of the body that is as deep as wide \[D\].
    half: Vec<f64>,
    pub truth: Layered,
    /// The diameter in units of the middle's distance.
    angle: f64,
}

/// A plane through the middle of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plane {
    /// Depth per place to the right and downwards.
    pub slope: [f64; 2],
    /// Depth at the place 0.
    offset: f64,
}

impl Plane {
    /// Angle between its normal and the view \[°\].
    pub fn tilt_deg(&self) -> f64 {
        self.slope[0].hypot(self.slope[1]).atan().to_degrees()
    }

    /// Angle between two normals \[°\].
    pub fn angle_deg(&self, other: &Self) -> f64 {
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1] + 1.0;
        let [a, b] = [self.slope, other.slope];
        (dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()).clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Whether it tilts to the same side as another.
    pub fn same_side(&self, other: &Self) -> bool {
        self.slope[0] * other.slope[0] + self.slope[1] * other.slope[1] > 0.0
    }
}

impl Seen {
    /// What is known of a sample.
    pub fn of(sample: &Sample) -> Self {
        let pixels: Vec<usize> = (0..PIXELS).filter(|pixel| sample.weights[*pixel] > 0.0).collect();
        let plane = |values: &[f32]| pixels.iter().map(|pixel| f64::from(values[*pixel])).collect::<Vec<f64>>();
        let feature = |k: usize| plane(&sample.features[k * PIXELS..][..PIXELS]);
        Self {
            places: [feature(PLACE), feature(PLACE + 1)],
            half: feature(HALF),
            truth: Layered { front: plane(&sample.depths[0]), back: plane(&sample.depths[1]) },
            angle: f64::from(sample.angle),
            pixels,
        }
    }

    /// Values of a map where the truth is known.
    pub fn picked(&self, map: &[f32]) -> Vec<f64> {
        self.pixels.iter().map(|pixel| f64::from(map[*pixel])).collect()
    }

    /// The body that is as deep as wide times a factor, around a plane if one is given.
    pub fn as_deep_as_wide(&self, factor: f64, plane: Option<&Plane>) -> Layered {
        let middle = |i: usize| {
            plane.map_or(0.0, |p| p.offset + p.slope[0] * self.places[0][i] + p.slope[1] * self.places[1][i])
        };
        let at = |i: usize, sign: f64| middle(i) + sign * factor * self.half[i];
        let all = |sign: f64| (0..self.pixels.len()).map(|i| at(i, sign)).collect();
        Layered { front: all(-1.0), back: all(1.0) }
    }

    /// IoU with the truth along the rays of the camera: a ray's share of a body between the depths `a` and `b` is `b³ − a³`.
    pub fn overlap(&self, body: &Layered) -> f64 {
        let far = |depth: f64| (1.0 + self.angle * depth).max(0.0).powi(3);
        let volume = |front: f64, back: f64| (far(back) - far(front)).max(0.0);
        let (mut common, mut whole) = (0.0, 0.0);
        for i in 0..self.pixels.len() {
            let (front, back) = (self.truth.front[i], self.truth.back[i]);
            common += volume(front.max(body.front[i]), back.min(body.back[i]));
            whole += volume(front, back) + volume(body.front[i], body.back[i]);
        }
        common / (whole - common).max(1e-12)
    }

    /// The plane through a body's middle surface by least squares, weighted by thickness.
    pub fn plane(&self, body: &Layered) -> Plane {
        let weight = |i: usize| (body.back[i] - body.front[i]).max(0.0) + 1e-3;
        let total: f64 = (0..self.pixels.len()).map(weight).sum();
        let mean =
            |value: &dyn Fn(usize) -> f64| (0..self.pixels.len()).map(|i| weight(i) * value(i)).sum::<f64>() / total;
        let middle = |i: usize| 0.5 * (body.front[i] + body.back[i]);
        let (x, y, z) = (mean(&|i| self.places[0][i]), mean(&|i| self.places[1][i]), mean(&middle));
        let [dx, dy] = [(0, x), (1, y)].map(|(axis, mean)| move |i: usize| self.places[axis][i] - mean);
        let (xx, xy, yy) = (mean(&|i| dx(i) * dx(i)) + 1e-5, mean(&|i| dx(i) * dy(i)), mean(&|i| dy(i) * dy(i)) + 1e-5);
        let (xz, yz) = (mean(&|i| dx(i) * (middle(i) - z)), mean(&|i| dy(i) * (middle(i) - z)));
        let whole = xx * yy - xy * xy;
        let slope = [(yy * xz - xy * yz) / whole, (xx * yz - xy * xz) / whole];
        Plane { slope, offset: z - slope[0] * x - slope[1] * y }
    }
}

/// Root mean square of the differences of two lists, up to a common shift.
pub(crate) fn rms_error(a: &[f64], b: &[f64]) -> f64 {
    let mean = a.iter().zip(b).map(|(a, b)| a - b).sum::<f64>() / a.len() as f64;
    (a.iter().zip(b).map(|(a, b)| (a - b - mean).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

/// Mean of a list; 0 of an empty one.
pub(crate) fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Rank correlation (Spearman 1904); equal values share their mean rank.
pub(crate) fn spearman(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (ranks(a), ranks(b));
    let middle = (a.len() as f64 - 1.0) / 2.0;
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - middle) * (b - middle)).sum::<f64>();
    product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt().max(1e-12)
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|i, j| values[*i].total_cmp(&values[*j]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    for group in order.chunk_by(|i, j| values[*i] == values[*j]) {
        group.iter().for_each(|i| ranks[*i] = first as f64 + 0.5 * (group.len() - 1) as f64);
        first += group.len();
    }
    ranks
}

#[cfg(test)]
mod tests {
    use gradreel::Key;

    use super::*;
    use crate::depth::camera::Attitude;
    use crate::depth::sample::Kind;
    use crate::depth::testing::{ball, boxed};

    fn seen(number: u64) -> Seen {
        let sample = Sample::draw(&boxed([0.5, 0.3, 0.1]), Key::new(number), Kind::Exact(Attitude::Free)).unwrap();
        Seen::of(&sample)
    }

    fn moved(body: &Layered, by: impl Fn(usize) -> f64) -> Layered {
        let all = |values: &[f64]| values.iter().enumerate().map(|(i, x)| x + by(i)).collect();
        Layered { front: all(&body.front), back: all(&body.back) }
    }

    #[test]
    fn a_body_overlaps_with_itself_and_not_with_one_far_off() {
        for number in 0..5 {
            let seen = seen(number);
            assert!((seen.overlap(&seen.truth) - 1.0).abs() < 1e-9);
            assert_eq!(seen.overlap(&moved(&seen.truth, |_| 3.0)), 0.0);
            let half = Layered {
                front: seen.truth.front.clone(),
                back: seen.truth.front.iter().zip(&seen.truth.back).map(|(f, b)| 0.5 * (f + b)).collect(),
            };
            // the nearer half is the smaller one in perspective
            assert!((0.35..0.5).contains(&seen.overlap(&half)), "{}", seen.overlap(&half));
        }
    }

    /// A sheared body: its plane's slope and angles in closed form.
    #[test]
    fn a_plane_finds_the_shear() {
        let sample = Sample::draw(&ball(0.5, 48), Key::new(1), Kind::Exact(Attitude::Free)).unwrap();
        let seen = Seen::of(&sample);
        let body = moved(&seen.as_deep_as_wide(1.0, None), |i| 0.4 * seen.places[0][i] - 0.3 * seen.places[1][i]);
        let plane = seen.plane(&body);
        assert!((plane.slope[0] - 0.4).abs() < 1e-3 && (plane.slope[1] + 0.3).abs() < 1e-3, "{plane:?}");
        assert!((plane.tilt_deg() - 0.5f64.atan().to_degrees()).abs() < 0.1);
        let flat = Plane { slope: [0.0; 2], offset: 0.0 };
        assert!((plane.angle_deg(&flat) - plane.tilt_deg()).abs() < 1e-9);
        let back = Plane { slope: plane.slope.map(|s| -s), offset: 0.0 };
        assert!((plane.angle_deg(&back) - 2.0 * plane.tilt_deg()).abs() < 1e-9);
        assert!(plane.same_side(&plane) && !plane.same_side(&back));
        // the body that is as deep as wide around this plane is the sheared one
        assert!(seen.overlap(&seen.as_deep_as_wide(1.0, Some(&plane))) > 0.0);
        let again = seen.as_deep_as_wide(1.0, Some(&plane));
        assert!(rms_error(&again.front, &body.front) < 1e-3);
    }

    #[test]
    fn ranks_correlate() {
        let a = [1.0, 5.0, 3.0, 4.0];
        assert!((spearman(&a, &[10.0, 500.0, 30.0, 40.0]) - 1.0).abs() < 1e-12);
        assert!((spearman(&a, &[4.0, 1.0, 3.0, 2.0]) + 1.0).abs() < 1e-12);
        assert_eq!(ranks(&[2.0, 1.0, 2.0, 0.0]), [2.5, 1.0, 2.5, 0.0]);
        assert_eq!(spearman(&[1.0; 4], &a), 0.0);
        assert_eq!(rms_error(&[1.0, 2.0], &[0.0, 1.0]), 0.0);
        assert_eq!(mean([]), 0.0);
    }
}
