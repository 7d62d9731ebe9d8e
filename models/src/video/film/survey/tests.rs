//! Surveys of drawn films: a ball before a pattern, let go by a hand, with its shadow on the wall, and noise.

use super::register::{Homography, IDENTITY, Motion};
use super::{Sequence, Survey, survey};
use crate::video::story::Doing;

/// Gravity \[m/s²\].
const GRAVITY: f64 = 9.81;

/// A drawn film.
#[derive(Clone)]
struct Scene {
    size: [usize; 2],
    rate: f64,
    /// Seconds in all, and when the ball is let go.
    seconds: [f64; 2],
    /// Metres of a pixel, diameter of the ball \[m\].
    metres: f64,
    diameter: f64,
    /// Where it is let go, and height of the ground \[pixels\].
    from: [f64; 2],
    ground: f64,
    /// Its horizontal speed \[pixels/s\].
    aside: f64,
    /// Share of the speed after a hit.
    restitution: f64,
    /// Its colour, and that of the wall.
    ball: [f64; 3],
    wall: [f64; 3],
    /// Exposure as a share of the interval.
    exposure: f64,
    hand: bool,
    shadow: bool,
    /// Standard deviation of the noise \[levels\].
    noise: f64,
    /// Motion of the camera.
    camera: fn(f64) -> Homography,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            size: [240, 180],
            rate: 60.0,
            seconds: [1.7, 0.5],
            metres: 0.005,
            diameter: 0.07,
            from: [100.0, 30.0],
            ground: 165.0,
            aside: 12.0,
            restitution: 0.6,
            ball: [200.0, 60.0, 40.0],
            wall: [120.0, 125.0, 130.0],
            exposure: 0.3,
            hand: true,
            shadow: true,
            noise: 2.0,
            camera: |_| IDENTITY,
        }
    }
}

/// A number of deviation 1 and mean 0 that depends on place and picture only.
fn random(seed: u64) -> f64 {
    let mut h = seed.wrapping_add(0x1234_5678);
    let mut sum = 0.0;
    for _ in 0..4 {
        h = (h ^ (h >> 31)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        sum += (h >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
    }
    sum * 3f64.sqrt()
}

impl Scene {
    fn radius(&self) -> f64 {
        0.5 * self.diameter / self.metres
    }

    /// Times of the hits \[s\].
    fn hits(&self) -> Vec<f64> {
        let a = GRAVITY / self.metres;
        let fall = self.ground - self.radius() - self.from[1];
        let mut time = self.seconds[1] + (2.0 * fall / a).sqrt();
        let mut speed = (2.0 * a * fall).sqrt();
        let mut hits = vec![];
        while time < self.seconds[0] {
            hits.push(time);
            speed *= self.restitution;
            time += 2.0 * speed / a;
            if speed < 30.0 {
                break;
            }
        }
        hits
    }

    /// Centre of the ball at a time.
    fn place(&self, time: f64) -> [f64; 2] {
        let a = GRAVITY / self.metres;
        let since = time - self.seconds[1];
        if since <= 0.0 {
            return self.from;
        }
        let x = self.from[0] + self.aside * since;
        let floor = self.ground - self.radius();
        let hits = self.hits();
        let Some(n) = hits.iter().rposition(|hit| *hit <= time) else {
            return [x, (self.from[1] + 0.5 * a * since * since).min(floor)];
        };
        let speed = (2.0 * a * (floor - self.from[1])).sqrt() * self.restitution.powi(n as i32 + 1);
        let t = time - hits[n];
        [x, floor - (speed * t - 0.5 * a * t * t).max(0.0)]
    }

    fn wall(&self, x: f64, y: f64) -> [f64; 3] {
        let pattern = 12.0 * ((0.21 * x + 0.05 * y).sin() + (0.17 * y - 0.02 * x).cos() + (0.09 * x * 0.13 * y).sin());
        match y > self.ground {
            true => [90.0 + pattern, 70.0 + pattern, 50.0 + 0.5 * pattern],
            false => self.wall.map(|v| v + pattern),
        }
    }

    fn colour(&self, x: f64, y: f64, time: f64) -> [f64; 3] {
        let (half, radius) = (0.5 * self.exposure / self.rate, self.radius());
        // the mean over the exposure
        let instants = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|s| self.place(time + s * half));
        let cover = |shift: [f64; 2], soft: f64| -> f64 {
            let one = |[px, py]: &[f64; 2]| {
                let off = (x - px - shift[0]).hypot(y - py - shift[1]);
                ((radius - off) / soft + 0.5).clamp(0.0, 1.0)
            };
            instants.iter().map(one).sum::<f64>() / 5.0
        };
        let mut back = self.wall(x, y);
        if self.shadow && y < self.ground {
            let dark = 1.0 - 0.35 * cover([-20.0, 14.0], 6.0);
            back = back.map(|v| v * dark);
        }
        let alpha = cover([0.0; 2], 1.0);
        let mut seen = [0, 1, 2].map(|c| (1.0 - alpha) * back[c] + alpha * self.ball[c]);
        if self.hand {
            // an arm from above that withdraws after the release
            let lift = 60.0 * (time - self.seconds[1] - 0.1).max(0.0);
            let tremble = 0.8 * (9.0 * time).sin();
            let arm = (x - self.from[0] - tremble).abs() < 11.0 && y + lift < self.from[1] - 0.6 * radius;
            if arm {
                seen = [190.0, 140.0, 115.0];
            }
        }
        seen
    }

    fn film(&self) -> Sequence {
        let [width, height] = self.size;
        let mut sequence = Sequence { width, height, ..Sequence::default() };
        let half = 0.5 * width.max(height) as f64;
        for k in 0..(self.seconds[0] * self.rate) as usize {
            let time = k as f64 / self.rate;
            let map = (self.camera)(time);
            let pixel = |i: usize| {
                let at =
                    [(i % width) as f64 + 0.5 - 0.5 * width as f64, (i / width) as f64 + 0.5 - 0.5 * height as f64];
                let [x, y] = at.map(|v| v / half);
                let scale = 1.0 / (map[6] * x + map[7] * y + map[8]);
                let u = (map[0] * x + map[1] * y + map[2]) * scale * half + 0.5 * width as f64;
                let v = (map[3] * x + map[4] * y + map[5]) * scale * half + 0.5 * height as f64;
                let colour = self.colour(u, v, time);
                let noise = |c: usize| self.noise * random(((k * width * height + i) * 3 + c) as u64);
                std::array::from_fn(|c| (colour[c] + noise(c)).round().clamp(0.0, 255.0) as u8)
            };
            sequence.numbers.push(k);
            sequence.times.push(time);
            sequence.pictures.push((0..width * height).map(pixel).collect());
        }
        sequence
    }

    fn surveyed(&self) -> Option<Survey> {
        let mut film = self.film();
        let motion = Motion::of(&film);
        survey(&mut film, motion, 0)
    }

    /// Checks the phases and the diameter.
    #[track_caller]
    fn is_understood(&self, name: &str) -> Survey {
        let found = self.surveyed().unwrap_or_else(|| panic!("{name}: nothing falls"));
        let truth = self.hits();
        let run = found.run.unwrap_or_else(|| panic!("{name}: no contact in {:?}", found.phases));
        let nearest = truth.iter().map(|hit| (hit - run.hit.time).abs()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1.0 / self.rate, "{name}: hits at {truth:?}, found {}", run.hit.time);
        let first = found.phases.iter().find(|phase| phase.doing == Doing::Contact).unwrap();
        assert!((first.begin.0 - truth[0]).abs() < 2.0 / self.rate, "{name}: {first:?} for {}", truth[0]);
        let [low, high] = found.diameter.interval_90();
        assert!((low..high).contains(&self.diameter), "{name}: {low} to {high} m for {}", self.diameter);
        assert!(high < 2.0 * low, "{name}: {low} to {high}");
        // no picture of the chosen part shows it held
        assert!(
            found.times[run.first] > self.seconds[1] - 1.0 / self.rate,
            "{name}: from {} s",
            found.times[run.first]
        );
        found
    }
}

#[test]
fn a_ball_that_a_hand_lets_go() {
    let found = Scene::default().is_understood("a ball");
    let Some(after) = found.run.unwrap().hit.after else { panic!("it bounces") };
    let restitution = -after[1] / found.run.unwrap().hit.before[1];
    assert!((restitution - 0.6).abs() < 0.06, "{restitution}");
    assert_eq!(found.phases[0].doing, Doing::Held);
}

#[test]
fn small_faint_and_blurred_balls() {
    let small = Scene { diameter: 0.04, rate: 30.0, ..Scene::default() };
    small.is_understood("8 pixels");
    let faint = Scene { ball: [150.0, 152.0, 150.0], noise: 1.5, shadow: false, ..Scene::default() };
    faint.is_understood("grey before grey");
    let blurred = Scene { exposure: 1.0, rate: 30.0, ..Scene::default() };
    blurred.is_understood("blurred");
}

#[test]
fn what_does_not_bounce_lands() {
    let flat = Scene { restitution: 0.0, ..Scene::default() };
    let found = flat.is_understood("a bag of sand");
    assert_eq!(found.run.unwrap().hit.after, None);
    assert_eq!(found.phases.last().unwrap().doing, Doing::Rest);
}

#[test]
fn a_shaking_hand_films() {
    let camera = |t: f64| -> Homography {
        let (sine, cosine) = (0.01 * (5.0 * t).sin()).sin_cos();
        [cosine, -sine, 0.02 * (7.0 * t).sin(), sine, cosine, 0.015 * (4.0 * t).cos(), 0.0, 0.0, 1.0]
    };
    let found = Scene { camera, ..Scene::default() }.is_understood("a shaking camera");
    assert!(found.motion.is_some_and(|motion| motion.most > 0.01 && motion.lost.is_empty()));
}

#[test]
fn films_without_a_fall_or_a_contact() {
    // only the hand moves
    let held = Scene { seconds: [1.2, 9.0], ..Scene::default() };
    assert!(held.surveyed().is_none());
    // it leaves the picture
    let deep = Scene { ground: 400.0, ..Scene::default() };
    let found = deep.surveyed().unwrap();
    assert!(found.run.is_none(), "{:?}", found.phases);
    let [low, high] = found.diameter.interval_90();
    assert!((low..high).contains(&deep.diameter), "{low} to {high}");
}
