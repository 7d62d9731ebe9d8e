//! A ball that falls onto a floor and stays there, as a pinhole camera sees it.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::video::{Camera, Clip, Foreground, Frame};
use ndarray::{Array2, Array3};
use tempfile::TempDir;

pub const GRAVITY: [f64; 3] = [0.0, -9.8, 0.0];
pub const RADIUS: f64 = 0.1;
pub const START: [f64; 3] = [0.1, 0.42, -0.05];
pub const VELOCITY: [f64; 3] = [-0.4, -0.5, 0.2];
pub const RATE: f64 = 24.0;
pub const FRAMES: usize = 10;
const SIDE: usize = 160;

/// 40° of view, 0.6 m above the floor and 1.4 m before the ball, looking down by 12°.
pub fn camera() -> Camera {
    let (sine, cosine) = 12f64.to_radians().sin_cos();
    let focal = 0.5 * SIDE as f64 / 20f64.to_radians().tan();
    let c2w = [[1.0, 0.0, 0.0, 0.0], [0.0, cosine, sine, 0.6], [0.0, -sine, cosine, 1.4]];
    Camera { id: 0, width: SIDE, height: SIDE, fx: focal, fy: focal, cx: 80.0, cy: 80.0, c2w }
}

/// When it touches the floor \[s\].
fn landing() -> f64 {
    let (height, down, gravity) = (START[1] - RADIUS, -VELOCITY[1], -GRAVITY[1]);
    ((down * down + 2.0 * gravity * height).sqrt() - down) / gravity
}

/// The middle of the ball in a frame; on the floor it stays.
pub fn middle(frame: usize) -> [f64; 3] {
    let t = (frame as f64 / RATE).min(landing());
    [0, 1, 2].map(|axis| START[axis] + VELOCITY[axis] * t + 0.5 * GRAVITY[axis] * t * t)
}

/// The first frame in which the ball lies on the floor.
pub fn landed() -> usize {
    (landing() * RATE).ceil() as usize
}

/// The share of each pixel that the ball covers, by 4 × 4 rays.
pub fn coverage(camera: &Camera, middle: [f64; 3]) -> Array2<f32> {
    let hits = |u: f64, v: f64| {
        let (from, along) = camera.ray(u, v);
        let to = [0, 1, 2].map(|axis| middle[axis] - from[axis]);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        dot(to, to) - dot(to, along).powi(2) / dot(along, along) < RADIUS * RADIUS
    };
    Array2::from_shape_fn((camera.height, camera.width), |(row, column)| {
        let rays = (0..16)
            .map(|k| (column as f64 + 0.125 + 0.25 * f64::from(k % 4), row as f64 + 0.125 + 0.25 * f64::from(k / 4)));
        rays.filter(|(u, v)| hits(*u, *v)).count() as f32 / 16.0
    })
}

/// The clip of that camera, calibrated.
pub fn clip() -> Clip {
    let camera = camera();
    let frame = |k: usize| {
        let alpha = coverage(&camera, middle(k));
        Frame { rgb: Array3::ones((SIDE, SIDE, 3)), weight: Array2::ones((SIDE, SIDE)), alpha }
    };
    Clip {
        name: "ball".into(),
        root: PathBuf::from("ball"),
        frames: vec![(0..FRAMES).map(frame).collect()],
        times: (0..FRAMES).map(|k| k as f64 / RATE).collect(),
        frame_numbers: (0..FRAMES as i64).collect(),
        foreground: vec![Foreground::ImageAlpha],
        imagined: vec![false],
        assumptions: vec![],
        flight: None,
        around: None,
        story: None,
        cameras: vec![camera],
    }
}

/// Pictures of the ball, red and shaded, before what `behind` says of each pixel.
pub fn pictures(behind: impl Fn(usize, usize) -> [u8; 4]) -> Vec<Vec<u8>> {
    let camera = camera();
    let picture = |k: usize| {
        let alpha = coverage(&camera, middle(k));
        let pixel = |((row, column), a): ((usize, usize), &f32)| {
            let back = behind(column, row);
            let red = [200.0, 40.0 + 0.2 * column as f32, 30.0];
            if back[3] == 0 {
                return if *a >= 0.5 { [red[0] as u8, red[1] as u8, red[2] as u8, 255] } else { [0; 4] };
            }
            let mixed = [0, 1, 2].map(|c| (a * red[c] + (1.0 - a) * f32::from(back[c])).round() as u8);
            [mixed[0], mixed[1], mixed[2], 255]
        };
        alpha.indexed_iter().flat_map(pixel).collect()
    };
    (0..FRAMES).map(picture).collect()
}

/// A floor with a pattern.
pub fn floor(column: usize, row: usize) -> [u8; 4] {
    let tile = if (column / 16 + row / 16).is_multiple_of(2) { 40 } else { 0 };
    [60 + tile, 90 + tile, (80 + row / 4) as u8, 255]
}

/// Writes pictures as a GIF.
pub fn write_gif(path: &Path, pictures: &[Vec<u8>]) {
    // 24 a second in hundredths: 4, 4, 4, 4, 4, 5 …
    write_gif_with(path, pictures, |k| if k % 6 == 5 { 5 } else { 4 });
}

/// The same with other delays \[0.01 s\].
pub fn write_gif_with(path: &Path, pictures: &[Vec<u8>], delay: impl Fn(usize) -> u16) {
    let file = std::fs::File::create(path).unwrap();
    let side = SIDE as u16;
    let mut encoder = gif::Encoder::new(file, side, side, &[]).unwrap();
    for (k, picture) in pictures.iter().enumerate() {
        let mut frame = gif::Frame::from_rgba_speed(side, side, &mut picture.clone(), 1);
        frame.delay = delay(k);
        frame.dispose = gif::DisposalMethod::Background;
        encoder.write_frame(&frame).unwrap();
    }
}

/// Writes pictures as numbered PNG files.
pub fn write_folder(folder: &Path, pictures: &[Vec<u8>]) {
    std::fs::create_dir_all(folder).unwrap();
    for (k, picture) in pictures.iter().enumerate() {
        let file = std::fs::File::create(folder.join(format!("frame{k}.png"))).unwrap();
        let mut encoder = png::Encoder::new(file, SIDE as u32, SIDE as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.write_header().unwrap().write_image_data(picture).unwrap();
    }
}

/// Encodes pictures as `ball.mp4` of 24 frames a second in a folder, with more options of the encoder; `None` on a machine without
/// one, which CI is not.
pub fn write_video(folder: &Folder, pictures: &[Vec<u8>], more: &[&str]) -> Option<PathBuf> {
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        assert!(std::env::var_os("CI").is_none(), "CI has ffmpeg");
        return None;
    }
    write_folder(&folder.path("frames"), pictures);
    let film = folder.path("ball.mp4");
    let made = Command::new("ffmpeg")
        .args(["-v", "error", "-framerate", "24", "-i"])
        .arg(folder.path("frames/frame%d.png"))
        .args(more)
        .args(["-pix_fmt", "yuv420p", "-crf", "12"])
        .arg(&film)
        .status()
        .unwrap();
    assert!(made.success());
    Some(film)
}

/// Writes a PNG file of 8 bits of any kind, with Exif data.
pub fn write_png(
    path: &Path,
    [width, height]: [usize; 2],
    colour: png::ColorType,
    exif: Option<Vec<u8>>,
    bytes: &[u8],
) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut info = png::Info::with_size(width as u32, height as u32);
    info.color_type = colour;
    info.bit_depth = png::BitDepth::Eight;
    info.exif_metadata = exif.map(Into::into);
    let encoder = png::Encoder::with_info(std::fs::File::create(path).unwrap(), info).unwrap();
    encoder.write_header().unwrap().write_image_data(bytes).unwrap();
}

/// A folder of the test's own that goes away with it.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}
