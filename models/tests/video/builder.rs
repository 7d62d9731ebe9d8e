//! Tiny clips in a temporary folder, removed at the end of the test.

use std::fs;
use std::path::{Path, PathBuf};

use gradreel::{Error, ErrorKind, Result};
use gradreel_models::video::{Clip, OpenOptions};
use serde_json::{Value, json};
use tempfile::TempDir;

/// An image as a function of column and row.
pub type Paint<'a> = &'a dyn Fn(usize, usize) -> [u8; 4];

pub struct Builder {
    pub root: PathBuf,
    pub entries: Vec<Value>,
    pub size: (usize, usize),
    _folder: TempDir,
}

impl Builder {
    pub fn new(width: usize, height: usize) -> Builder {
        let folder = TempDir::new().unwrap();
        let root = folder.path().to_owned();
        fs::create_dir(root.join("data")).unwrap();
        Builder { root, entries: Vec::new(), size: (width, height), _folder: folder }
    }

    /// Cameras × frames of a red square on transparent ground.
    pub fn square(cameras: &[i64], frames: i64) -> Builder {
        let mut builder = Builder::new(24, 16);
        for &camera in cameras {
            for frame in 0..frames {
                builder.list(camera, frame);
                builder.image('r', camera, frame, true, &red_square);
            }
        }
        builder
    }

    pub fn list(&mut self, camera: i64, frame: i64) {
        let (w, h) = (self.size.0 as f64, self.size.1 as f64);
        self.entries.push(json!({
            "file_path": format!("./data/r_{camera}_{frame}.png"),
            "time": frame.max(0) as f64 / 24.0,
            "c2w": [[1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 1, 2.0]],
            "intrinsic": [[30.0, 0, w / 2.0], [0, 31.0, h / 2.0], [0, 0, 1]],
        }));
    }

    pub fn path(&self, prefix: char, camera: i64, frame: i64) -> PathBuf {
        self.root.join(format!("data/{prefix}_{camera}_{frame}.png"))
    }

    pub fn image(&self, prefix: char, camera: i64, frame: i64, alpha: bool, paint: Paint<'_>) {
        write_png(&self.path(prefix, camera, frame), self.size, alpha, paint);
    }

    pub fn save(&self) {
        fs::write(self.root.join("all_data.json"), Value::from(self.entries.clone()).to_string()).unwrap();
    }

    pub fn open(&self) -> Result<Clip> {
        self.open_with(&OpenOptions::default())
    }

    pub fn open_with(&self, options: &OpenOptions) -> Result<Clip> {
        self.save();
        Clip::open(&self.root, options)
    }

    /// The error of opening, which must be one of input and name a way out.
    #[track_caller]
    pub fn fails(&self) -> String {
        message(self.open().expect_err("this clip is broken and must be refused"))
    }
}

#[track_caller]
pub fn message(error: Error) -> String {
    let text = error.to_string();
    assert_eq!(error.kind(), ErrorKind::Input, "{text}");
    for part in ["at: ", "found: ", "fix: "] {
        assert!(text.contains(part), "no {part:?} in: {text}");
    }
    text
}

#[track_caller]
pub fn has(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "no {part:?} in: {text}");
    }
}

pub fn in_square(x: usize, y: usize) -> bool {
    (8..14).contains(&x) && (5..11).contains(&y)
}

pub fn red_square(x: usize, y: usize) -> [u8; 4] {
    if in_square(x, y) { [200, 30, 20, 255] } else { [0, 0, 0, 0] }
}

pub fn write_png(path: &Path, (width, height): (usize, usize), alpha: bool, paint: Paint<'_>) {
    let file = fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, width as u32, height as u32);
    encoder.set_color(if alpha { png::ColorType::Rgba } else { png::ColorType::Rgb });
    let channels = if alpha { 4 } else { 3 };
    let pixels = (0..width * height).flat_map(|i| paint(i % width, i / width).into_iter().take(channels));
    encoder.write_header().unwrap().write_image_data(&pixels.collect::<Vec<u8>>()).unwrap();
}
