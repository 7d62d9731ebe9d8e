//! Matting against a plate, on images mixed from known coverage, colour, shadow and noise.

use gradreel_models::video::Frame;

use super::builder::Builder;

const SIZE: usize = 96;

/// What stands on the floor.
#[derive(Clone, Copy)]
struct Scene {
    /// Linear colour of the object, left and right side (they blend smoothly).
    object: [[f64; 3]; 2],
    /// Linear colour of the floor.
    floor: [f64; 3],
    /// Light left in the darkest part of the shadow, per channel.
    shadow: [f64; 3],
    /// Amplitude of uniform noise (share of full scale, sRGB).
    noise: f64,
}

/// A disc of radius 20 with a hole of radius 8 (a torus from above), sampled 8 × 8 times a pixel.
fn coverage(x: usize, y: usize) -> f64 {
    let inside = |i: usize| {
        let (px, py) = (x as f64 + (i % 8) as f64 / 8.0 + 1.0 / 16.0, y as f64 + (i / 8) as f64 / 8.0 + 1.0 / 16.0);
        let r = (px - 48.0).hypot(py - 44.0);
        r < 20.0 && r > 8.0
    };
    (0..64).filter(|&i| inside(i)).count() as f64 / 64.0
}

/// A number between −1 and 1 that depends on pixel and seed only.
fn random(x: usize, y: usize, seed: usize) -> f64 {
    let mut h = (x as u64) << 40 ^ (y as u64) << 20 ^ seed as u64;
    for _ in 0..3 {
        h = (h ^ h >> 31).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    (h >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

fn srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

fn encode(linear: [f64; 3], noise: f64, x: usize, y: usize, seed: usize) -> [u8; 4] {
    let byte = |c: usize| ((srgb(linear[c]) + noise * random(x, y, seed + c)).clamp(0.0, 1.0) * 255.0).round() as u8;
    [byte(0), byte(1), byte(2), 255]
}

impl Scene {
    /// Planks: a texture of ±12 % with a grain along x.
    fn plate(&self, x: usize, y: usize) -> [f64; 3] {
        let grain = 1.0 + 0.08 * (y as f64 * 0.9 + (x as f64 * 0.07).sin()).sin() + 0.04 * random(x / 6, y, 99);
        self.floor.map(|c| c * grain)
    }

    /// The colour of the object at a column.
    fn surface(&self, x: usize) -> [f64; 3] {
        let t = ((x as f64 - 28.0) / 40.0).clamp(0.0, 1.0);
        [0, 1, 2].map(|c| (1.0 - t) * self.object[0][c] + t * self.object[1][c])
    }

    fn image(&self, x: usize, y: usize, a: f64) -> [f64; 3] {
        // The shadow lies below the object and reaches under it; reflected light tints the floor on the other side.
        let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
        let dark = (-((px - 54.0).powi(2) / 700.0 + (py - 62.0).powi(2) / 160.0)).exp();
        let tint = 0.05 * (-((px - 40.0).powi(2) + (py - 30.0).powi(2)) / 500.0).exp();
        let (plate, surface) = (self.plate(x, y), self.surface(x));
        let floor = [0, 1, 2].map(|c| plate[c] * (1.0 - (1.0 - self.shadow[c]) * dark) + tint * surface[c] * plate[c]);
        [0, 1, 2].map(|c| a * surface[c] + (1.0 - a) * floor[c])
    }

    fn matte(&self) -> Frame {
        let mut builder = Builder::new(SIZE, SIZE);
        builder.list(0, 0);
        builder.image('r', 0, 0, false, &|x, y| encode(self.image(x, y, coverage(x, y)), self.noise, x, y, 1));
        builder.image('r', 0, -1, false, &|x, y| encode(self.plate(x, y), self.noise, x, y, 7));
        builder.open().unwrap().frames.remove(0).remove(0)
    }
}

/// Intersection over union of soft coverages.
fn iou(frame: &Frame) -> f64 {
    let (mut both, mut either) = (0.0, 0.0);
    for ((y, x), &a) in frame.alpha.indexed_iter() {
        both += f64::from(a).min(coverage(x, y));
        either += f64::from(a).max(coverage(x, y));
    }
    both / either
}

const WOOD: [f64; 3] = [0.55, 0.42, 0.30];
const TEAL: [f64; 3] = [0.10, 0.35, 0.33];
const BLUE: [f64; 3] = [0.12, 0.15, 0.60];
const PINK: [f64; 3] = [0.80, 0.15, 0.55];
const GREY: [f64; 3] = [0.20, 0.20, 0.20];
const ORANGE: [f64; 3] = [0.55, 0.22, 0.08];
/// Half as bright as wood, and a tenth greener: less than the shadow is bluer.
const BARK: [f64; 3] = [0.22, 0.20, 0.125];
const BLUISH: [f64; 3] = [0.42, 0.5, 0.58];

#[test]
fn the_object_without_its_shadow() {
    let cases = [
        ("blue to pink on wood", Scene { object: [BLUE, PINK], floor: WOOD, shadow: [0.3; 3], noise: 0.01 }),
        (
            "blue to orange, through the floor's hue",
            Scene { object: [BLUE, ORANGE], floor: WOOD, shadow: [0.5; 3], noise: 0.0 },
        ),
        ("grey on teal", Scene { object: [GREY, GREY], floor: TEAL, shadow: [0.4; 3], noise: 0.01 }),
        ("grey on wood", Scene { object: [GREY, GREY], floor: WOOD, shadow: [0.5; 3], noise: 0.01 }),
        ("white on grey", Scene { object: [[0.85; 3]; 2], floor: GREY, shadow: [0.3; 3], noise: 0.015 }),
    ];
    for (name, scene) in cases {
        let frame = scene.matte();
        let quality = iou(&frame);
        assert!(quality >= 0.95, "{name}: IoU {quality:.3}");
        // Nothing of the shadow, well away from the silhouette: the hole included, for the floor shows through it.
        for ((y, x), &a) in frame.alpha.indexed_iter() {
            let r = (x as f64 + 0.5 - 48.0).hypot(y as f64 + 0.5 - 44.0);
            assert!((5.5..=22.5).contains(&r) || a == 0.0, "{name}: alpha {a} at ({x}, {y})");
        }
        println!("{name}: IoU {quality:.4}");
    }
}

/// A body that is darker than the floor and hardly of another hue: what other pictures show of the light's shadows tells it from them, which
/// are bluer, as the sky is.
#[test]
fn what_shadows_look_like_is_learned() {
    let scene = Scene { object: [BARK, BARK], floor: WOOD, shadow: BLUISH, noise: 0.002 };
    let mut builder = Builder::new(SIZE, SIZE);
    for camera in 0..2 {
        // another camera sees it in colours of its own
        let scene = Scene { object: if camera == 0 { scene.object } else { [BLUE, PINK] }, ..scene };
        builder.image('r', camera, -1, false, &|x, y| encode(scene.plate(x, y), scene.noise, x, y, 7));
        for frame in 0..3 {
            builder.list(camera, frame);
            // it leaves the first one's picture, and its shadow stays
            let covered = |x, y| if camera == 0 && frame > 0 { 0.0 } else { coverage(x, y) };
            let paint = |x, y| encode(scene.image(x, y, covered(x, y)), scene.noise, x, y, 1 + frame as usize);
            builder.image('r', camera, frame, false, &paint);
        }
    }
    let clip = builder.open().unwrap();
    let quality = iou(&clip.frames[0][0]);
    assert!(quality >= 0.95, "IoU {quality:.3}");
    assert!(clip.frames[0][1..].iter().all(|frame| frame.alpha.iter().all(|a| *a == 0.0)), "a shadow is no object");
}

/// Along the silhouette the floor's share is taken out of the colour before it is composited on white.
#[test]
fn no_fringe_of_the_background() {
    let scene = Scene { object: [BLUE, BLUE], floor: WOOD, shadow: [0.6; 3], noise: 0.0 };
    let frame = scene.matte();
    let (mut error, mut count) = (0.0f64, 0);
    for ((y, x), &a) in frame.alpha.indexed_iter() {
        let truth = coverage(x, y);
        if truth > 0.05 && truth < 0.95 {
            for (c, &blue) in BLUE.iter().enumerate() {
                let clean = f64::from(a) * srgb(blue) + 1.0 - f64::from(a);
                error += (f64::from(frame.rgb[[y, x, c]]) - clean).abs();
            }
            error += (f64::from(a) - truth).abs();
            count += 4;
        }
    }
    let mean = error / f64::from(count);
    assert!(count > 400 && mean < 0.02, "mean error {mean:.4} over {count} numbers");
}

/// A frame without object stays empty, shadow or not; what the noise does is no object.
#[test]
fn noise_alone_is_no_object() {
    let scene = Scene { object: [WOOD, WOOD], floor: WOOD, shadow: [0.3; 3], noise: 0.03 };
    let mut builder = Builder::new(SIZE, SIZE);
    builder.list(0, 0);
    builder.image('r', 0, 0, false, &|x, y| encode(scene.plate(x, y), scene.noise, x, y, 1));
    builder.image('r', 0, -1, false, &|x, y| encode(scene.plate(x, y), scene.noise, x, y, 7));
    assert!(builder.fails().contains("never sees an object"));
}
