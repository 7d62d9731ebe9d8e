//! A masked picture with its two depth layers, as a camera would take it.

use super::Solid;
use super::camera::Scene;
use super::light::{Light, cross, dot, unit};
use super::raster::{Grid, Layers};
use crate::views::objects::Dice;

/// Pixels along a side.
pub const SIZE: usize = 64;
/// Pixels of a picture.
pub(super) const PIXELS: usize = SIZE * SIZE;
/// Rays along the side of a pixel, and how many of all must meet the solid for the pixel to be of it.
const RAYS: usize = 2;
const MET: usize = 2;
/// Fewest pixels of a silhouette.
pub(super) const FEWEST: usize = 150;
/// Shares of training pictures with one colour, and with a silhouette that is too wide and too narrow in places.
const PLAIN: f64 = 0.15;
const WIDE: f64 = 0.15;
const NARROW: f64 = 0.1;

/// A picture of `SIZE²` pixels, planes row by row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Picture {
    /// Red, green and blue as a screen shows them, 0 to 1; 0 outside `given`.
    pub colours: [Vec<f32>; 3],
    /// The silhouette that is handed over.
    pub given: Vec<bool>,
    /// The solid's pixels.
    pub solid: Vec<bool>,
    /// Depth of the nearest and the farthest surface.
    pub depths: [Vec<f32>; 2],
    /// Side of a pixel at the distance 1.
    pub pixel: f32,
}

impl Picture {
    /// Draws a scene; `None` if too little of it is seen. `rough` pictures have errors of the silhouette, and some one colour.
    pub fn draw(scene: &Scene, solid: &Solid, rough: bool, dice: &mut Dice) -> Option<Self> {
        let size = RAYS * SIZE;
        let layers = Layers::draw(scene, solid.triangles(), SIZE, size);
        let grid = Grid::of(scene, SIZE, size);
        let light = Light::draw(scene.up, dice);
        let plain = (rough && dice.chance(PLAIN)).then(|| [0; 3].map(|_| dice.within(0.1, 0.9) as f32));
        let placed: Vec<[f32; 3]> = scene.corners.iter().map(|c| grid.placed(*c)).collect();
        let mut picture = Self {
            colours: [0; 3].map(|_| vec![0.0; PIXELS]),
            given: vec![false; PIXELS],
            solid: vec![false; PIXELS],
            depths: [0; 2].map(|_| vec![0.0; PIXELS]),
            pixel: scene.pixel,
        };
        let linear = to_linear();
        let mut count = 0;
        for pixel in 0..PIXELS {
            let (mut met, mut near, mut far, mut colour) = (0, 0.0, 0.0, [0.0f32; 3]);
            for part in 0..RAYS * RAYS {
                let (column, row) = (RAYS * (pixel % SIZE) + part % RAYS, RAYS * (pixel / SIZE) + part / RAYS);
                let at = row * size + column;
                if layers.triangle[at] == u32::MAX {
                    continue;
                }
                met += 1;
                near += 1.0 / layers.near[at];
                far += 1.0 / layers.far[at];
                let corners = solid.triangles()[layers.triangle[at] as usize].map(|c| c as usize);
                let [a, b, c] = corners.map(|corner| scene.corners[corner]);
                let normal = unit(cross([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k])));
                let view = unit(grid.ray(column, row).map(|x| -x));
                let facing = if dot(normal, view) < 0.0 { normal.map(|n| -n) } else { normal };
                let [diffuse, specular] = light.on(facing, view);
                let shares = shares(corners.map(|corner| placed[corner]), [column as f32 + 0.5, row as f32 + 0.5]);
                for k in 0..3 {
                    let own = || (0..3).map(|i| shares[i] * linear[solid.colours()[corners[i]][k] as usize]).sum();
                    let albedo: f32 = plain.map_or_else(own, |plain| plain[k]);
                    colour[k] += (0.02 + 0.98 * albedo) * diffuse + specular;
                }
            }
            if met >= MET {
                count += 1;
                picture.solid[pixel] = true;
                picture.depths[0][pixel] = near / met as f32;
                picture.depths[1][pixel] = far / met as f32;
                (0..3).for_each(|k| picture.colours[k][pixel] = colour[k] * light.tint[k] / met as f32);
            }
        }
        if count < FEWEST {
            return None;
        }
        picture.given = if rough { frayed(&picture.solid, dice) } else { picture.solid.clone() };
        picture.expose(dice);
        (picture.given.iter().filter(|given| **given).count() >= FEWEST).then_some(picture)
    }

    /// Brightness, contrast, background, sharpness and noise.
    fn expose(&mut self, dice: &mut Dice) {
        let solid = self.solid.iter().filter(|solid| **solid).count() as f32;
        let mean = self.colours.iter().flatten().sum::<f32>() / (3.0 * solid);
        let exposure = dice.within(0.12, 0.5) as f32 / (mean + 1e-4);
        let gamma = 1.0 / dice.within(1.5, 2.6) as f32;
        let background = dice.three(0.0, 1.0).map(|x| x as f32);
        let (sharpness, noise) = (dice.within(0.3, 0.8), dice.within(0.0, 0.025));
        for (colours, background) in self.colours.iter_mut().zip(background) {
            for (colour, solid) in colours.iter_mut().zip(&self.solid) {
                *colour = if *solid { (*colour * exposure).clamp(0.0, 1.0).powf(gamma) } else { background };
            }
            blur(colours, sharpness as f32);
            for ((colour, given), more) in colours.iter_mut().zip(&self.given).zip(dice.normals(PIXELS)) {
                *colour = if *given { (*colour + noise as f32 * more as f32).clamp(0.0, 1.0) } else { 0.0 };
            }
        }
    }

    /// The same as a mirror shows it: left is right, in colours, shading and depths alike.
    pub fn mirrored(mut self) -> Self {
        self.colours.iter_mut().chain(&mut self.depths).for_each(|plane| mirror(plane));
        mirror(&mut self.given);
        mirror(&mut self.solid);
        self
    }
}

/// Exchanges left and right of a plane.
pub(super) fn mirror<T>(plane: &mut [T]) {
    plane.chunks_mut(SIZE).for_each(<[T]>::reverse);
}

/// Shares of a triangle's corners at a place of the picture.
fn shares([a, b, c]: [[f32; 3]; 3], [x, y]: [f32; 2]) -> [f32; 3] {
    let (bx, by, cx, cy) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
    let (dx, dy) = (x - a[0], y - a[1]);
    let area = bx * cy - cx * by;
    let (v, w) = ((dx * cy - cx * dy) / area, (bx * dy - dx * by) / area);
    [1.0 - v - w, v, w]
}

/// Screen values to amounts of light.
fn to_linear() -> [f32; 256] {
    std::array::from_fn(|byte| (byte as f32 / 255.0).powf(2.2))
}

/// A blur with the kernel `[k, 1, k] / (1 + 2k)`, `k = exp(−1/(2σ²))`, along both axes; borders are repeated.
fn blur(plane: &mut [f32], deviation: f32) {
    let side = (-0.5 / (deviation * deviation)).exp();
    let middle = 1.0 / (1.0 + 2.0 * side);
    let side = side * middle;
    let at = |x: usize, d: usize| (x + d).saturating_sub(1).min(SIZE - 1);
    let mut half = vec![0.0; PIXELS];
    for row in 0..SIZE {
        let line = &plane[row * SIZE..][..SIZE];
        for x in 0..SIZE {
            half[row * SIZE + x] = middle * line[x] + side * (line[at(x, 0)] + line[at(x, 2)]);
        }
    }
    for row in 0..SIZE {
        for x in 0..SIZE {
            let of = |row: usize| half[row * SIZE + x];
            plane[row * SIZE + x] = middle * of(row) + side * (of(at(row, 0)) + of(at(row, 2)));
        }
    }
}

/// A silhouette as found in a film: mostly exact, sometimes a pixel wider or narrower along all or a part of its border.
fn frayed(solid: &[bool], dice: &mut Dice) -> Vec<bool> {
    let (chance, whole, part) = (dice.within(0.0, 1.0), dice.chance(0.5), dice.within(0.2, 0.8));
    let share = if whole { 1.0 } else { part };
    let mut given = solid.to_vec();
    if chance >= WIDE + NARROW {
        return given;
    }
    let wide = chance < WIDE;
    let numbers = dice.uniforms(PIXELS);
    for ((pixel, given), number) in given.iter_mut().enumerate().zip(numbers) {
        let (x, y) = (pixel % SIZE, pixel / SIZE);
        let near = [
            (x > 0, pixel.wrapping_sub(1)),
            (x + 1 < SIZE, pixel + 1),
            (y > 0, pixel.wrapping_sub(SIZE)),
            (y + 1 < SIZE, pixel + SIZE),
        ];
        let inner = (1..SIZE - 1).contains(&x) && (1..SIZE - 1).contains(&y);
        if inner && *given != wide && number < share && near.iter().any(|(is, at)| *is && solid[*at] == wide) {
            *given = wide;
        }
    }
    given
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::camera::{Attitude, Stretch};
    use crate::depth::testing::{ball, boxed};
    use gradreel::Key;

    fn draw(number: u64, rough: bool) -> Picture {
        let solid = boxed([0.5, 0.3, 0.2]);
        let mut dice = Dice::new(Key::new(number));
        let scene = Scene::draw(&solid, Attitude::Free, Stretch::Random, SIZE, &mut dice);
        Picture::draw(&scene, &solid, rough, &mut dice).unwrap()
    }

    #[test]
    fn planes_are_in_their_ranges() {
        for number in 0..40 {
            let picture = draw(number, true);
            for (pixel, given) in picture.given.iter().enumerate() {
                let colour = [0, 1, 2].map(|k| picture.colours[k][pixel]);
                assert!(colour.iter().all(|c| (0.0..=1.0).contains(c)));
                assert!(*given || colour == [0.0; 3]);
                if picture.solid[pixel] {
                    let [near, far] = [0, 1].map(|k| picture.depths[k][pixel]);
                    assert!(near > 0.0 && near <= far && far.is_finite());
                }
            }
            // within the range of exposures, away from what gamma and clamping do
            let mean: f32 = picture.colours.iter().flatten().sum::<f32>()
                / (3 * picture.given.iter().filter(|given| **given).count()) as f32;
            assert!((0.1..0.95).contains(&mean), "{mean}");
        }
    }

    #[test]
    fn silhouettes_are_exact_unless_rough() {
        assert!((0..20).all(|number| draw(number, false).given == draw(number, false).solid));
        let differences: Vec<i64> = (0..100)
            .map(|number| {
                let picture = draw(number, true);
                picture.given.iter().zip(&picture.solid).map(|(a, b)| i64::from(*a) - i64::from(*b)).sum()
            })
            .collect();
        let wide = differences.iter().filter(|difference| **difference > 0).count();
        let narrow = differences.iter().filter(|difference| **difference < 0).count();
        assert!((5..30).contains(&wide) && (2..25).contains(&narrow), "{wide} wider, {narrow} narrower");
    }

    /// Mirroring the picture is mirroring the world with its lamps: twice is nothing.
    #[test]
    fn a_mirror_shows_left_as_right() {
        let picture = draw(3, true);
        let mirrored = picture.clone().mirrored();
        for row in 0..SIZE {
            for x in 0..SIZE {
                let (here, there) = (row * SIZE + x, row * SIZE + SIZE - 1 - x);
                assert_eq!(picture.given[here], mirrored.given[there]);
                (0..3).for_each(|k| assert_eq!(picture.colours[k][here], mirrored.colours[k][there]));
                (0..2).for_each(|k| assert_eq!(picture.depths[k][here], mirrored.depths[k][there]));
            }
        }
        assert_eq!(mirrored.mirrored(), picture);
    }

    /// A blur keeps the sum of what lies away from the border.
    #[test]
    fn a_blur_spreads_and_keeps() {
        let mut plane = vec![0.0; PIXELS];
        plane[20 * SIZE + 30] = 1.0;
        blur(&mut plane, 0.8);
        assert!((plane.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert_eq!(plane[19 * SIZE + 30], plane[20 * SIZE + 29]);
        assert!(plane[20 * SIZE + 30] > plane[20 * SIZE + 29] && plane[20 * SIZE + 29] > plane[19 * SIZE + 29]);
    }

    /// A grey ball under light from everywhere and a lamp at the camera is brightest in its middle.
    #[test]
    fn shading_follows_the_surface() {
        let solid = ball(0.5, 48);
        let corners = solid.corners().iter().map(|[x, y, z]| [*x, *y, z + 3.0]).collect();
        let scene = Scene { corners, up: [0.0, -1.0, 0.0], centre: [0.0; 2], pixel: 0.4 / 64.0 };
        let (mut above, mut below) = (0.0, 0.0);
        for number in 0..60 {
            let picture = Picture::draw(&scene, &solid, false, &mut Dice::new(Key::new(number))).unwrap();
            above += picture.colours[1][20 * SIZE + 32];
            below += picture.colours[1][43 * SIZE + 32];
        }
        assert!(above > 1.1 * below, "light comes from above: {above} and {below}");
    }
}
