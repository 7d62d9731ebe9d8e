//! A film of a ball that falls, and models of the published layout that are as small as their layers allow.

use std::path::PathBuf;

use gradreel::io::TensorFile;
use gradreel::{DType, Device};
use ndarray::{Array2, Array3};

use crate::vector::{dot, minus, norm, scaled, unit};
use crate::video::{Camera, Clip, Flight, Foreground, Frame, PitchSpread};
use crate::views::tests::{procedural, tiny};
use crate::views::{FileWeights, ModelSizes, SpatialAwareSizes};

/// Radius of the ball \[m\].
const RADIUS: f64 = 0.12;
const START: [f64; 3] = [-0.1, 0.75, 0.05];
pub const VELOCITY: [f64; 3] = [0.3, -0.5, 0.0];
const GRAVITY: [f64; 3] = [0.0, -9.8, 0.0];
const FRAMES_PER_SECOND: f64 = 24.0;
/// The first frame in which the ball lies on the ground.
const LANDED: usize = 8;

/// The film's camera.
pub fn camera() -> Camera {
    Camera::around(0, [72, 72], 0.6, [0.0, 0.4, 0.0], 2.5, [0.4, 0.15])
}

/// Middle and radius of the ball in a frame \[m\].
pub fn falling(frame: usize) -> ([f64; 3], f64) {
    let t = frame.min(LANDED) as f64 / FRAMES_PER_SECOND;
    let place = [0, 1, 2].map(|axis| START[axis] + VELOCITY[axis] * t + 0.5 * GRAVITY[axis] * t * t);
    ([place[0], place[1].max(RADIUS), place[2]], RADIUS)
}

/// What a camera sees of a ball.
pub fn ball(camera: &Camera, (place, radius): ([f64; 3], f64)) -> Frame {
    let hit = |x: usize, y: usize| {
        let (from, along) = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
        let along = unit(along);
        let to = minus(place, from);
        let apart = norm(minus(to, scaled(along, dot(to, along))));
        apart < radius
    };
    let (width, height) = (camera.width, camera.height);
    let alpha = Array2::from_shape_fn((height, width), |(y, x)| f32::from(u8::from(hit(x, y))));
    let colour = |(y, x, c): (usize, usize, usize)| if alpha[[y, x]] > 0.0 { [0.8, 0.3, 0.2][c] } else { 1.0 };
    Frame { rgb: Array3::from_shape_fn((height, width, 3), colour), weight: Array2::ones((height, width)), alpha }
}

/// A film of so many frames.
pub fn film(frames: usize) -> Clip {
    let camera = camera();
    let pictures = (0..frames).map(|frame| ball(&camera, falling(frame))).collect();
    Clip {
        name: "ball".into(),
        root: "ball".into(),
        times: (0..frames).map(|frame| frame as f64 / FRAMES_PER_SECOND).collect(),
        frame_numbers: (0..frames as i64).collect(),
        frames: vec![pictures],
        foreground: vec![Foreground::White],
        imagined: vec![false],
        assumptions: vec!["a ball".into()],
        flight: Some(Flight {
            centre: START,
            velocity: VELOCITY,
            velocity_covariance: [[0.0; 3]; 3],
            velocity_with_distance: [0.0; 3],
            gravity: GRAVITY,
            frames: frames.min(LANDED),
            distance: camera.project(START).unwrap()[2],
            diameter: 2.0 * RADIUS,
            deviation: 0.05,
            scales_world: false,
            pitch: PitchSpread::default(),
        }),
        around: None,
        story: None,
        cameras: vec![camera],
    }
}

/// Sizes of the published layout, the smallest; with a spatial-aware module if wanted.
pub fn sizes(module: bool) -> ModelSizes {
    let mut sizes = tiny::sizes();
    if module {
        sizes.denoiser.spatial_aware = Some(SpatialAwareSizes::suiting(&sizes.denoiser.volume));
    }
    sizes
}

/// Procedural weights of these sizes in a file of the test's own.
pub fn weights(name: &str, sizes: &ModelSizes) -> (PathBuf, FileWeights) {
    let mut file = TensorFile::default();
    for (path, shape) in sizes.weights().unwrap() {
        file.tensors.insert(path.clone(), procedural::weight("published", &path, &shape).cast(DType::F32).unwrap());
    }
    file.metadata.insert(ModelSizes::METADATA.into(), sizes.to_json());
    let folder = std::env::temp_dir().join(format!("gradreel-published-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("model.safetensors");
    file.write(&path).unwrap();
    let weights = FileWeights::open(&path, &Device::Cpu).unwrap();
    (folder, weights)
}
