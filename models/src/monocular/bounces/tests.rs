//! Bounces of made tracks: a ball in space, stepped in small steps, seen by a pitched and rolled camera.

use super::{Shown, another, of};
use crate::monocular::free_fall::Down;
use crate::vector::EYE;
use crate::video::{Bounces, Camera, FreeFlight, Known, Sight};

/// A ball before a camera.
#[derive(Clone)]
struct Scene {
    rate: f64,
    /// Place and velocity of its centre \[m, m/s\]: right, up, towards the camera.
    place: [f64; 3],
    velocity: [f64; 3],
    diameter: f64,
    restitution: f64,
    /// Share of the velocity along the ground that a hit leaves.
    keeps: f64,
    /// Pitch and roll of the camera \[rad\], its height above the ground \[m\].
    pitch: f64,
    roll: f64,
    height: f64,
    /// Standard deviation of a position \[pixels\].
    noise: f64,
    hits: usize,
    seed: u64,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            rate: 60.0,
            place: [-0.3, 0.8, -1.6],
            velocity: [0.4, 0.0, 0.1],
            diameter: 0.05,
            restitution: 0.8,
            keeps: 0.7,
            pitch: 0.25,
            roll: 0.03,
            height: 0.7,
            noise: 0.3,
            hits: 3,
            seed: 1,
        }
    }
}

const FOCAL: f64 = 700.0;

fn camera() -> Camera {
    let c2w = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    Camera { id: 0, width: 640, height: 480, fx: FOCAL, fy: FOCAL, cx: 320.0, cy: 240.0, c2w }
}

impl Scene {
    /// A number of deviation 1.
    fn random(&self, number: usize) -> f64 {
        let mut h = self.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(number as u64);
        let mut sum = 0.0;
        for _ in 0..6 {
            h = (h ^ (h >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9).wrapping_add(0x1234_5678);
            h ^= h >> 29;
            sum += (h >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
        }
        sum * 2f64.sqrt()
    }

    /// Where a place of the world is in the picture, and its depth.
    fn seen(&self, [x, y, z]: [f64; 3]) -> ([f64; 2], f64) {
        let y = y - self.height;
        let (s, c) = self.pitch.sin_cos();
        let (up, back) = (c * y - s * z, s * y + c * z);
        let (sr, cr) = self.roll.sin_cos();
        let (right, up) = (cr * x - sr * up, sr * x + cr * up);
        ([320.0 + FOCAL * right / -back, 240.0 - FOCAL * up / -back], -back)
    }

    fn flights(&self) -> Vec<FreeFlight> {
        let (mut place, mut velocity) = (self.place, self.velocity);
        let step = 1e-5;
        let steps = (1.0 / self.rate / step).round() as usize;
        let mut flights = vec![vec![]];
        for k in 0.. {
            if k % steps == 0 {
                let ([u, v], depth) = self.seen(place);
                let noise = [0, 1, 2].map(|c| self.random(3 * (k / steps) + c));
                flights.last_mut().unwrap().push(Sight {
                    number: k / steps,
                    seconds: 2.0 + k as f64 * step,
                    middle: [u + self.noise * noise[0], v + self.noise * noise[1]],
                    across: FOCAL * self.diameter / depth + 0.5 * noise[2],
                });
            }
            (0..3).for_each(|c| place[c] += step * velocity[c]);
            velocity[1] -= 9.81 * step;
            if place[1] < 0.5 * self.diameter && velocity[1] < 0.0 {
                if flights.len() > self.hits {
                    break;
                }
                velocity = [self.keeps * velocity[0], -self.restitution * velocity[1], self.keeps * velocity[2]];
                flights.push(vec![]);
            }
        }
        let count = flights.len();
        let flight = |(k, sights)| FreeFlight { sights, scatter: self.noise.max(0.1), bounces: k + 1 < count };
        flights.into_iter().enumerate().map(flight).collect()
    }

    fn found(&self) -> Bounces {
        let flights = self.flights();
        let seconds: Vec<f64> = flights.iter().flat_map(|f| f.sights.iter().map(|sight| sight.seconds)).collect();
        let shown = Shown { seconds: &seconds, depth: self.seen(self.place).1, turn: EYE };
        let down = Down::Tilted { angle: 0.35, deviation: 0.3 };
        of(&camera(), &flights, 1.0 / self.rate, down, &shown).expect("it bounces")
    }
}

#[test]
fn restitution_and_what_a_hit_leaves_along_the_ground() {
    let found = Scene { noise: 0.05, ..Scene::default() }.found();
    assert_eq!((found.flights, found.hits.len()), (4, 3));
    for hit in &found.hits {
        assert!((hit.restitution.value - 0.8).abs() < 0.02, "{hit:?}");
        assert!((hit.tangential.unwrap().value - 0.7).abs() < 0.06, "{hit:?}");
    }
    let fallen: f64 = 0.8 - 0.025;
    let speed = (2.0 * 9.81 * fallen).sqrt();
    assert!((found.hits[0].speed / speed - 1.0).abs() < 0.05, "{} for {speed}", found.hits[0].speed);
    // the way in the clip: in the picture it is where it was seen
    assert_eq!(found.path.len(), Scene::default().flights().iter().map(|f| f.sights.len()).sum::<usize>());
    let fallen = found.path.iter().map(|x| x[1]).fold(0.0, f64::min);
    assert!((-0.85..-0.65).contains(&fallen), "{fallen}");
}

#[test]
fn intervals_hold_the_truth() {
    let mut held = [0; 2];
    let count = 40;
    for seed in 0..count {
        let scene = Scene { seed, ..Scene::default() };
        let varied = |k: usize, low: f64, high: f64| {
            let share = 0.5 + 0.25 * scene.random(900 + k);
            low + (high - low) * share.clamp(0.0, 1.0)
        };
        let scene = Scene {
            restitution: varied(0, 0.4, 0.9),
            keeps: varied(1, 0.5, 1.0),
            pitch: varied(2, 0.0, 0.6),
            roll: varied(3, -0.06, 0.06),
            rate: varied(4, 25.0, 120.0),
            velocity: [varied(5, 0.3, 0.8), 0.0, varied(6, -0.4, 0.4)],
            noise: varied(7, 0.2, 0.8),
            hits: 1 + (seed % 4) as usize,
            ..scene.clone()
        };
        let found = scene.found();
        let [low, high] = found.restitution.interval_90();
        held[0] += usize::from((low..=high).contains(&scene.restitution));
        assert!(high - low < 0.3, "{low} to {high} for {}", scene.restitution);
        let along = found.tangential.map(|known| known.interval_90());
        held[1] += usize::from(along.is_none_or(|[low, high]| (low..=high).contains(&scene.keeps)));
    }
    // of an interval of 90 %, fewer than 80 % of 40 with a probability of 4 %
    assert!(held.iter().all(|held| *held >= 32), "{held:?} of {count}");
}

/// What a hand still holds as it moves is no flight: the others tell.
#[test]
fn a_first_flight_that_is_none_is_left_out() {
    let scene = Scene::default();
    let mut flights = scene.flights();
    let last = flights[0].sights.len() as f64;
    for (k, sight) in flights[0].sights.iter_mut().enumerate() {
        // let down at a speed that falls off
        sight.middle[1] -= 90.0 * (1.0 - k as f64 / last).powi(3);
    }
    let seconds: Vec<f64> = flights[1].sights.iter().map(|sight| sight.seconds).collect();
    let shown = Shown { seconds: &seconds, depth: 1.5, turn: EYE };
    let down = Down::Tilted { angle: 0.35, deviation: 0.3 };
    let found = of(&camera(), &flights, 1.0 / scene.rate, down, &shown).unwrap();
    let [low, high] = found.restitution.interval_90();
    assert!(found.flights >= 3 && (low..=high).contains(&0.8), "{low} to {high} by {} flights", found.flights);
}

#[test]
fn what_never_bounces_tells_nothing() {
    let scene = Scene { hits: 0, ..Scene::default() };
    let shown = Shown { seconds: &[2.0], depth: 1.0, turn: EYE };
    let down = Down::Known([0.0, -1.0, 0.0]);
    assert_eq!(of(&camera(), &scene.flights(), 0.01, down, &shown), None);
    assert_eq!(of(&camera(), &[], 0.01, down, &shown), None);
}

#[test]
fn one_more_is_as_the_others_scatter() {
    let known = |value: f64| Known { value, deviation: 0.01 };
    let alike = another(&[known(0.8), known(0.8)]).unwrap();
    assert!((alike.value - 0.8).abs() < 1e-12 && alike.deviation < 0.01);
    let apart = another(&[known(0.7), known(0.8), known(0.9)]).unwrap();
    assert!((apart.value - 0.8).abs() < 1e-12 && (0.09..0.15).contains(&apart.deviation), "{apart:?}");
    assert_eq!(another(&[]), None);
    assert_eq!(another(&[known(0.5)]), Some(known(0.5)));
}
