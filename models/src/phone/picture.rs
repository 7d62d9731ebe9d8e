//! One picture of a film: rays against the scene, row by row and over the exposure.

use gradreel::{Key, Result};
use rayon::prelude::*;

use super::hand::{Ball, Hand};
use super::motion::Motion;
use super::plan::Plan;
use super::scenery::Scenery;
use crate::scenes::{Paint, Surface};
use crate::vector::{bounds, minus, norm, plus, scaled};
use crate::video::Camera;
use crate::views::objects::Dice;

/// Rays per pixel along each side.
const RAYS: usize = 2;
/// Bands of rows, each of which is exposed at a time of its own.
const BANDS: usize = 12;
/// Instants of an exposure that is longer than a fifth of the interval, and of a shorter one.
const INSTANTS: [usize; 2] = [8, 2];
/// Waves of which the camera's shaking is made, with their range of frequencies \[1/s\].
const WAVES: (usize, [f64; 2]) = (3, [0.5, 4.0]);
/// How far from the floor a shadow ray starts, in particle spacings.
const LIFT: f64 = 0.5;

/// Everything that is seen.
pub(super) struct Studio<'a> {
    motion: &'a Motion,
    plan: &'a Plan,
    scenery: Scenery,
    hand: Option<Hand>,
    /// Frequency and phase of each wave of pitch, yaw and roll.
    waves: Vec<[[f64; 2]; 3]>,
    key: Key,
}

/// What moves, at one time.
struct Instant {
    surface: Surface,
    hand: Vec<Ball>,
    /// Columns and rows of what may differ from the empty scene: `[left, top, right, bottom]`.
    areas: Vec<[f64; 4]>,
}

impl<'a> Studio<'a> {
    /// The studio of a simulated scene.
    pub fn new(motion: &'a Motion, plan: &'a Plan, key: Key) -> Self {
        let camera = &motion.camera;
        let scenery = Scenery::draw(key.fold(200), camera, motion.floor, plan.has_shadows);
        let hand = plan.has_hand.then(|| {
            let centre = motion.centre(0.0);
            let held = motion.at(0.0);
            let reach = held[..motion.first()].iter().map(|x| norm(minus(x.map(f64::from), centre)));
            let away = minus(centre, camera.centre());
            let forward = scaled(away, 1.0 / norm(away));
            let side = camera.c2w.map(|row| row[0]);
            Hand::new(centre, reach.fold(0.0, f64::max), forward, side)
        });
        let mut dice = Dice::new(key.fold(201));
        let wave = |dice: &mut Dice| [dice.within(WAVES.1[0], WAVES.1[1]), dice.within(0.0, std::f64::consts::TAU)];
        let waves = (0..WAVES.0).map(|_| [0; 3].map(|_| wave(&mut dice))).collect();
        Self { motion, plan, scenery, hand, waves, key: key.fold(202) }
    }

    /// The red, green and blue bytes of a picture.
    pub fn picture(&self, number: usize) -> Result<Vec<u8>> {
        let begun = self.plan.times[number];
        let camera = self.shaken(begun);
        let (width, height) = (camera.width, camera.height);
        let exposed = INSTANTS[usize::from(self.plan.exposure * self.plan.rate < 0.2)];
        let bands = if self.plan.readout > 0.0 { BANDS } else { 1 };
        let mut bytes = vec![0; 3 * width * height];
        let per_band = height.div_ceil(bands);
        for (band, part) in bytes.chunks_mut(3 * width * per_band).enumerate() {
            let top = band * per_band;
            let middle = top as f64 + 0.5 * (part.len() / (3 * width)) as f64;
            let middle = begun + self.plan.readout * middle / height as f64;
            let time = |k: usize| middle + self.plan.exposure * ((k as f64 + 0.5) / exposed as f64 - 0.5);
            let instants = (0..exposed).map(|k| self.instant(&camera, time(k))).collect::<Result<Vec<_>>>()?;
            part.par_chunks_mut(3 * width).enumerate().for_each(|(row, pixels)| {
                let row = top + row;
                let noise = self.key.fold(number as u64).fold(row as u64);
                let mut grain = Paint::grain(noise, pixels.len());
                for (column, pixel) in pixels.chunks_exact_mut(3).enumerate() {
                    let colour = self.colour(&camera, &instants, [column, row]);
                    let at = [column as f64 - camera.cx, row as f64 - camera.cy].map(|x| x / height as f64);
                    let left = self.scenery.left(at, begun);
                    for (byte, value) in pixel.iter_mut().zip(colour) {
                        let noisy = 255.0 * left * value + grain.next().unwrap_or(0.0);
                        *byte = noisy.round().clamp(0.0, 255.0) as u8;
                    }
                }
            });
        }
        Ok(bytes)
    }

    /// Number of pixels that the first object covers at a time, seen by the camera at rest.
    pub fn covered(&self, seconds: f64) -> Result<f64> {
        let camera = &self.motion.camera;
        let alone = self.motion.at(seconds);
        let surface = self.surface(&alone[..self.motion.first()])?;
        let row = |row: usize| {
            let inside = |column: usize, part: usize| {
                let (origin, along) = ray(camera, [column, row], part);
                surface.hit(origin, along).is_some()
            };
            (0..camera.width).map(|column| (0..RAYS * RAYS).filter(|part| inside(column, *part)).count()).sum::<usize>()
        };
        let rays: usize = (0..camera.height).into_par_iter().map(row).sum();
        Ok(rays as f64 / (RAYS * RAYS) as f64)
    }

    fn surface(&self, positions: &[[f32; 3]]) -> Result<Surface> {
        let count = positions.len();
        Surface::of(positions, &self.motion.colours[..count], &self.motion.spacings[..count])
    }

    /// The mean over the exposure and the pixel.
    fn colour(&self, camera: &Camera, instants: &[Instant], at: [usize; 2]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let [u, v] = at.map(|x| x as f64 + 0.5);
        for part in 0..RAYS * RAYS {
            let (origin, along) = ray(camera, at, part);
            let foot = self.scenery.foot(origin, along);
            let empty = foot.map_or_else(|| self.scenery.wall(along), |foot| self.scenery.paint.lit_floor(foot, false));
            for instant in instants {
                let touched = |area: &&[f64; 4]| u >= area[0] && v >= area[1] && u <= area[2] && v <= area[3];
                let seen = match instant.areas.iter().find(touched) {
                    Some(_) => self.seen(instant, origin, along, foot).unwrap_or(empty),
                    None => empty,
                };
                (0..3).for_each(|c| sum[c] += seen[c]);
            }
        }
        sum.map(|x| x / (RAYS * RAYS * instants.len()) as f64)
    }

    /// What a ray sees in place of the empty scene.
    fn seen(&self, instant: &Instant, origin: [f64; 3], along: [f64; 3], foot: Option<[f64; 3]>) -> Option<[f64; 3]> {
        let lit = |colour: [f64; 3], normal: [f64; 3]| colour.map(|c| c * self.scenery.paint.light(normal, false));
        let hand = |is_before: bool| {
            let own = instant.hand.iter().filter(|ball| ball.is_before == is_before);
            let near = own.filter_map(|ball| ball.hit(origin, along)).min_by(|a, b| a.0.total_cmp(&b.0));
            near.map(|(_, normal)| lit(self.hand.as_ref().expect("its balls").colour, normal))
        };
        hand(true)
            .or_else(|| instant.surface.hit(origin, along).map(|hit| lit(hit.colour, hit.normal)))
            .or_else(|| hand(false))
            .or_else(|| {
                let lamp = self.scenery.paint.lamp;
                let from = plus(foot?, scaled(lamp, LIFT * self.motion.spacings[0]));
                let is_dark = instant.surface.hit(from, lamp).is_some()
                    || instant.hand.iter().any(|ball| ball.hit(from, lamp).is_some());
                is_dark.then(|| self.scenery.paint.lit_floor(foot.expect("a foot"), true))
            })
    }

    fn instant(&self, camera: &Camera, seconds: f64) -> Result<Instant> {
        let positions = self.motion.at(seconds);
        let hand = self.hand.as_ref().map_or_else(Vec::new, |hand| hand.at(seconds));
        let of_object = |range: &std::ops::Range<usize>| {
            let reach = 2.0 * self.motion.spacings[range.start];
            let [low, high] = bounds(positions[range.clone()].iter().map(|x| x.map(f64::from)));
            [low.map(|x| x - reach), high.map(|x| x + reach)]
        };
        let boxes = self.motion.objects.iter().map(of_object).chain(hand.iter().map(Ball::bounds));
        let areas = boxes.flat_map(|corners| self.areas(camera, corners)).collect();
        Ok(Instant { surface: self.surface(&positions)?, hand, areas })
    }

    /// Where a box and its shadow are in the picture.
    fn areas(&self, camera: &Camera, [low, high]: [[f64; 3]; 2]) -> [[f64; 4]; 2] {
        let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { low[axis] } else { high[axis] });
        let lamp = self.scenery.paint.lamp;
        let dropped = |x: [f64; 3]| plus(x, scaled(lamp, -(x[1] - self.motion.floor).max(0.0) / lamp[1]));
        let around = |points: [[f64; 3]; 8]| {
            let mut area = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
            for [u, v, _] in points.into_iter().filter_map(|x| camera.project(x)) {
                area = [area[0].min(u - 1.0), area[1].min(v - 1.0), area[2].max(u + 1.0), area[3].max(v + 1.0)];
            }
            area
        };
        let corners = std::array::from_fn(corner);
        [around(corners), around(corners.map(dropped))]
    }

    /// The camera at a time: it shakes.
    fn shaken(&self, seconds: f64) -> Camera {
        let camera = &self.motion.camera;
        if self.plan.shake == 0.0 {
            return camera.clone();
        }
        // a turn by one height of the picture is this angle
        let unit = self.plan.shake * camera.height as f64 / camera.fy * (2.0 / self.waves.len() as f64).sqrt();
        let angle = |axis: usize| {
            let wave = |waves: &[[f64; 2]; 3]| {
                let [frequency, phase] = waves[axis];
                (std::f64::consts::TAU * frequency * seconds + phase).sin()
            };
            unit * self.waves.iter().map(wave).sum::<f64>()
        };
        // a roll moves the corners half as far
        let turn = crate::vector::rotation([angle(0), angle(1), 0.5 * angle(2)]);
        let mut shaken = camera.clone();
        for (row, old) in shaken.c2w.iter_mut().zip(&camera.c2w) {
            for column in 0..3 {
                row[column] = (0..3).map(|k| old[k] * turn[k][column]).sum();
            }
        }
        shaken
    }
}

/// One of the rays of a pixel.
fn ray(camera: &Camera, [column, row]: [usize; 2], part: usize) -> ([f64; 3], [f64; 3]) {
    let inside = |k: usize| (k as f64 + 0.5) / RAYS as f64;
    camera.ray(column as f64 + inside(part % RAYS), row as f64 + inside(part / RAYS))
}
