//! What the network sees of a masked picture.

use super::picture::{PIXELS, SIZE};

/// Planes of the features.
pub const CHANNELS: usize = 7;
/// Planes that are not colours.
pub(super) const MASK: usize = 3;
pub(super) const HALF: usize = 4;
pub(super) const PLACE: usize = 5;
/// Keeps the division by the deviation of the colours finite.
const FLAT: f32 = 0.02;

/// The planes of a masked picture, row by row; all of them 0 outside the silhouette:
///
/// | plane | holds |
/// |---|---|
/// | 0 to 2 | colours with mean 0 and deviation 1 over the silhouette and all three |
/// | 3 | the silhouette |
/// | 4 | half the thickness of the body that is as deep as wide, in diameters |
/// | 5, 6 | place to the right and downwards of the silhouette's centroid, in diameters |
///
/// The diameter `D = 2 √(A/π)` is that of the disc of the silhouette's area `A`. As deep as wide is the union of balls around the
/// silhouette's pixels that reach to its border: `h(x)² = max_p (r(p)² − |x − p|²)`, with the distance `r(p)` to the nearest pixel
/// outside.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Features {
    pub planes: Vec<f32>,
    /// Diameter in pixels; 0 for an empty silhouette.
    pub diameter: f32,
}

impl Features {
    /// The features of colours (0 to 1) within a silhouette.
    pub fn of(colours: [&[f32]; 3], silhouette: &[bool]) -> Self {
        let mut planes = vec![0.0; CHANNELS * PIXELS];
        let inside: Vec<usize> = (0..PIXELS).filter(|pixel| silhouette[*pixel]).collect();
        if inside.is_empty() {
            return Self { planes, diameter: 0.0 };
        }
        let count = inside.len() as f32;
        let sum = |value: &dyn Fn(usize) -> f64| inside.iter().map(|pixel| value(*pixel)).sum::<f64>();
        let mean = (0..3).map(|k| sum(&|pixel| f64::from(colours[k][pixel]))).sum::<f64>() / (3.0 * f64::from(count));
        let squares = |k: usize| sum(&|pixel| (f64::from(colours[k][pixel]) - mean).powi(2));
        let deviation = ((0..3).map(squares).sum::<f64>() / (3.0 * f64::from(count))).sqrt() as f32;
        let diameter = 2.0 * (count / std::f32::consts::PI).sqrt();
        let centre =
            [sum(&|pixel| (pixel % SIZE) as f64), sum(&|pixel| (pixel / SIZE) as f64)].map(|s| s as f32 / count);
        let half = medial(silhouette);
        for &pixel in &inside {
            for k in 0..3 {
                planes[k * PIXELS + pixel] = (colours[k][pixel] - mean as f32) / (deviation + FLAT);
            }
            planes[MASK * PIXELS + pixel] = 1.0;
            planes[HALF * PIXELS + pixel] = half[pixel].sqrt() / diameter;
            planes[PLACE * PIXELS + pixel] = ((pixel % SIZE) as f32 - centre[0]) / diameter;
            planes[(PLACE + 1) * PIXELS + pixel] = ((pixel / SIZE) as f32 - centre[1]) / diameter;
        }
        Self { planes, diameter }
    }

    /// The same without colours.
    pub fn without_colours(&mut self) {
        self.planes[..MASK * PIXELS].fill(0.0);
    }
}

/// Squares of the half thickness in pixels², by exact distance transforms along rows and columns (Saito and Toriwaki 1994).
fn medial(silhouette: &[bool]) -> Vec<f32> {
    // a margin of one pixel stands for what is outside of the picture
    const WIDE: usize = SIZE + 2;
    const FAR: f32 = 1e9;
    let inside =
        |x: usize, y: usize| (1..=SIZE).contains(&x) && (1..=SIZE).contains(&y) && silhouette[(y - 1) * SIZE + x - 1];
    let mut along = vec![0.0f32; WIDE * WIDE];
    for y in 0..WIDE {
        let line = &mut along[y * WIDE..][..WIDE];
        let mut run = 0.0;
        for x in 0..WIDE {
            run = if inside(x, y) { run + 1.0 } else { 0.0 };
            line[x] = run;
        }
        run = 0.0;
        for x in (0..WIDE).rev() {
            run = if inside(x, y) { run + 1.0 } else { 0.0 };
            line[x] = line[x].min(run);
        }
        line.iter_mut().for_each(|d| *d *= *d);
    }
    let rows: Vec<usize> = (0..WIDE).filter(|y| (0..WIDE).any(|x| inside(x, *y))).collect();
    let (first, last) = (rows.first().map_or(0, |y| y - 1), rows.last().map_or(0, |y| y + 1));
    let square = |a: usize, b: usize| (a.abs_diff(b) * a.abs_diff(b)) as f32;
    // squared distance to the outside
    let mut distance = vec![FAR; WIDE * WIDE];
    for y in first..=last {
        let line = &mut distance[y * WIDE..][..WIDE];
        for v in first..=last {
            let more = square(v, y);
            for (best, d) in line.iter_mut().zip(&along[v * WIDE..][..WIDE]) {
                *best = best.min(d + more);
            }
        }
    }
    // the largest ball over each place: columns within a row, then rows
    let mut ball = vec![-FAR; WIDE * WIDE];
    for y in first..=last {
        let (line, radii) = (&mut ball[y * WIDE..][..WIDE], &distance[y * WIDE..][..WIDE]);
        for u in 0..WIDE {
            if radii[u] > 0.0 {
                let reach = radii[u].sqrt() as usize + 1;
                for x in u.saturating_sub(reach)..(u + reach + 1).min(WIDE) {
                    line[x] = line[x].max(radii[u] - square(u, x));
                }
            }
        }
    }
    let mut half = vec![0.0f32; PIXELS];
    for y in 1..=SIZE {
        let line = &mut half[(y - 1) * SIZE..][..SIZE];
        for v in first..=last {
            let less = square(v, y);
            for (best, b) in line.iter_mut().zip(&ball[v * WIDE + 1..][..SIZE]) {
                *best = best.max(b - less);
            }
        }
    }
    half
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::picture::mirror;
    use gradreel::Key;

    fn silhouette(inside: impl Fn(f32, f32) -> bool) -> Vec<bool> {
        (0..PIXELS).map(|pixel| inside((pixel % SIZE) as f32, (pixel / SIZE) as f32)).collect()
    }

    fn noise(key: u64) -> [Vec<f32>; 3] {
        std::array::from_fn(|k| Key::new(key).fold(k as u64).uniform(PIXELS).map(|u| u as f32).collect())
    }

    fn of(colours: &[Vec<f32>; 3], silhouette: &[bool]) -> Features {
        Features::of(std::array::from_fn(|k| &*colours[k]), silhouette)
    }

    /// A disc becomes a ball, a long bar a cylinder: `h² = r² − y²`, up to a pixel.
    #[test]
    fn as_deep_as_wide_is_a_ball_on_a_disc_and_a_cylinder_on_a_bar() {
        let disc = silhouette(|x, y| (x - 31.0).powi(2) + (y - 30.0).powi(2) < 20.0 * 20.0);
        let features = of(&noise(1), &disc);
        assert!((features.diameter - 40.0).abs() < 0.3);
        let half = |x: usize, y: usize| features.planes[HALF * PIXELS + y * SIZE + x] * features.diameter;
        assert!((half(31, 30) - 20.0).abs() < 0.5);
        assert!((half(43, 30) - 16.0).abs() < 1.0 && (half(31, 18) - 16.0).abs() < 1.0);
        assert_eq!(half(5, 5), 0.0);
        let bar = silhouette(|x, y| (4.0..60.0).contains(&x) && (y - 30.0).abs() < 10.5);
        let features = of(&noise(2), &bar);
        let half = |x: usize, y: usize| features.planes[HALF * PIXELS + y * SIZE + x] * features.diameter;
        for x in 20..45 {
            // pixels reach half a pixel beyond their centres
            assert!((half(x, 30) - 11.0).abs() < 1e-3, "{}", half(x, 30));
            assert!((half(x, 36) - (121.0f32 - 36.0).sqrt()).abs() < 1e-3);
        }
    }

    /// The definition, without transforms.
    #[test]
    fn transforms_find_the_largest_ball() {
        let noisy: Vec<bool> = Key::new(5).uniform(PIXELS).map(|u| u < 0.93).collect();
        let blob = silhouette(|x, y| (x - 20.0).abs() + 1.5 * (y - 40.0).abs() < 23.0);
        let mask: Vec<bool> = noisy.iter().zip(&blob).map(|(a, b)| *a && *b).collect();
        let inside = |x: isize, y: isize| {
            (0..64).contains(&x) && (0..64).contains(&y) && mask[y.cast_unsigned() * SIZE + x.cast_unsigned()]
        };
        let places = || (-1..65isize).flat_map(|y| (-1..65isize).map(move |x| (x, y)));
        let between = |a: (isize, isize), b: (isize, isize)| (a.0 - b.0).pow(2) + (a.1 - b.1).pow(2);
        let radius = |p| places().filter(|q| !inside(q.0, q.1)).map(|q| between(p, q)).min().unwrap();
        let balls: Vec<_> = places().filter(|p| inside(p.0, p.1)).map(|p| (p, radius(p))).collect();
        let found = medial(&mask);
        for (x, y) in [(20, 40), (10, 41), (25, 33), (33, 44), (14, 35), (0, 0)] {
            let wanted = balls.iter().map(|(p, r)| r - between(*p, (x, y))).max().unwrap().max(0);
            assert_eq!(found[y.cast_unsigned() * SIZE + x.cast_unsigned()], wanted as f32, "at {x} {y}");
        }
    }

    #[test]
    fn colours_have_mean_zero_and_deviation_one() {
        let mask = silhouette(|x, y| (x - 30.0).abs() < 13.0 && (y - 22.0).abs() < 9.0);
        let features = of(&noise(3), &mask);
        let inside: Vec<f32> = (0..3 * PIXELS).filter(|i| mask[i % PIXELS]).map(|i| features.planes[i]).collect();
        let mean = inside.iter().sum::<f32>() / inside.len() as f32;
        let variance = inside.iter().map(|x| x * x).sum::<f32>() / inside.len() as f32;
        assert!(mean.abs() < 1e-4 && (0.85..1.0).contains(&variance), "{mean} {variance}");
        for i in 0..CHANNELS * PIXELS {
            assert!(mask[i % PIXELS] || features.planes[i] == 0.0);
            assert!(features.planes[i].abs() < 4.0);
        }
        let mut bare = features.clone();
        bare.without_colours();
        assert!(bare.planes[..3 * PIXELS].iter().all(|x| *x == 0.0));
        assert_eq!(bare.planes[3 * PIXELS..], features.planes[3 * PIXELS..]);
    }

    /// Of a mirrored picture the features are mirrored, and the place to the right changes its sign.
    #[test]
    fn features_of_a_mirrored_picture_are_mirrored() {
        let (mut colours, mut mask) =
            (noise(4), silhouette(|x, y| x + 0.3 * y > 20.0 && (x - 30.0).hypot(y - 33.0) < 21.0));
        let straight = of(&colours, &mask);
        colours.iter_mut().for_each(|plane| mirror(plane));
        mirror(&mut mask);
        let mirrored = of(&colours, &mask);
        assert_eq!(straight.diameter, mirrored.diameter);
        for channel in 0..CHANNELS {
            let mut plane = straight.planes[channel * PIXELS..][..PIXELS].to_vec();
            mirror(&mut plane);
            let sign = if channel == PLACE { -1.0 } else { 1.0 };
            for (a, b) in plane.iter().zip(&mirrored.planes[channel * PIXELS..][..PIXELS]) {
                assert!((sign * a - b).abs() < 1e-5, "channel {channel}: {a} {b}");
            }
        }
    }

    #[test]
    fn an_empty_silhouette_has_empty_features() {
        let features = of(&noise(1), &[false; PIXELS]);
        assert_eq!(features.diameter, 0.0);
        assert!(features.planes.iter().all(|x| *x == 0.0));
    }
    /// Silhouettes of real shapes, with half thickness and place of an independent implementation.
    #[test]
    fn silhouettes_have_the_features_of_another_implementation() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors/depth/silhouettes.safetensors");
        let file = gradreel::io::TensorFile::read(path).unwrap();
        let silhouettes = file.get("silhouette").unwrap().slice::<u32>();
        let wanted = file.get("half_and_place").unwrap().slice::<f32>();
        for (silhouette, wanted) in silhouettes.chunks(PIXELS).zip(wanted.chunks(3 * PIXELS)) {
            let mask: Vec<bool> = silhouette.iter().map(|inside| *inside > 0).collect();
            let found = of(&noise(1), &mask);
            for (a, b) in found.planes[HALF * PIXELS..].iter().zip(wanted) {
                assert!((a - b).abs() < 1e-5, "{a} not {b}");
            }
        }
    }
}
