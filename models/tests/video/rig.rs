//! Three cameras around an object, and the same film of it written in every layout.

use std::fs;
use std::path::Path;

use gradreel::Result;
use gradreel_models::video::{Clip, OpenOptions};
use serde_json::{Value, json};

use super::builder::{Builder, in_square, write_png};

pub const SIZE: (usize, usize) = (24, 16);
pub const FRAMES: i64 = 4;
pub const RATE: f64 = 24.0;
/// Focal lengths and principal point of all cameras.
pub const LENS: [f64; 4] = [30.0, 31.0, 12.5, 7.75];

/// World to camera as COLMAP writes it, in a y-up world in metres: a unit quaternion, and the centre.
pub struct Place {
    pub q: [f64; 4],
    pub centre: [f64; 3],
}

pub fn places() -> Vec<Place> {
    [
        ([0.3, 0.9, -0.2, 0.1], [0.1, 0.8, 2.0]),
        ([0.1, 0.7, 0.7, 0.05], [1.9, 0.5, -0.3]),
        ([-0.2, 0.5, -0.8, 0.3], [-1.2, 1.1, -1.4]),
    ]
    .into_iter()
    .map(|(q, centre): ([f64; 4], [f64; 3])| {
        let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        Place { q: q.map(|x| x / length), centre }
    })
    .collect()
}

fn quaternion_product([aw, ax, ay, az]: [f64; 4], [bw, bx, by, bz]: [f64; 4]) -> [f64; 4] {
    [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
}

/// `q v q*`
pub fn rotated(q: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let [_, x, y, z] = quaternion_product(quaternion_product(q, [0.0, v[0], v[1], v[2]]), [q[0], -q[1], -q[2], -q[3]]);
    [x, y, z]
}

pub fn conjugate([w, x, y, z]: [f64; 4]) -> [f64; 4] {
    [w, -x, -y, -z]
}

impl Place {
    /// Camera to world with OpenGL axes, row by row.
    pub fn c2w(&self) -> [[f64; 4]; 3] {
        let back = conjugate(self.q);
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]].map(|axis| rotated(back, axis));
        [0, 1, 2].map(|i| [x[i], y[i], z[i], self.centre[i]])
    }

    /// The same place in coordinates turned by `turn` and moved: `x ↦ turn x / unit + origin`.
    pub fn seen_from(&self, turn: [f64; 4], unit: f64, origin: [f64; 3]) -> Place {
        let centre = rotated(turn, self.centre);
        Place {
            q: quaternion_product(self.q, conjugate(turn)),
            centre: [0, 1, 2].map(|i| centre[i] / unit + origin[i]),
        }
    }

    /// Translation of world to camera.
    pub fn translation(&self) -> [f64; 3] {
        rotated(self.q, self.centre).map(|x| -x)
    }
}

/// The quarter turn about x that takes y to z.
pub fn y_to_z() -> [f64; 4] {
    [0.5f64.sqrt(), 0.5f64.sqrt(), 0.0, 0.0]
}

/// A square whose colour tells camera and frame, opaque or on transparent ground.
pub fn paint(path: &Path, camera: usize, frame: i64, transparent: bool) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let colour = [40 + 60 * camera as u8, 30 + 40 * frame as u8, 90, 255];
    let ground = if transparent { [0; 4] } else { [120, 110, 100, 255] };
    write_png(path, SIZE, transparent, &|x, y| if in_square(x, y) { colour } else { ground });
}

/// White where the square is.
pub fn paint_mask(path: &Path) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    write_png(path, SIZE, false, &|x, y| if in_square(x, y) { [255; 4] } else { [0, 0, 0, 255] });
}

/// An empty folder that goes away with the test.
pub fn folder() -> Builder {
    Builder::new(SIZE.0, SIZE.1)
}

pub fn save(root: &Path, name: &str, text: impl AsRef<[u8]>) {
    let path = root.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

pub fn open(root: &Path) -> Result<Clip> {
    Clip::open(root, &OpenOptions::default())
}

/// The film in PAC-NeRF's layout, with which the others are compared.
pub fn reference() -> Clip {
    let builder = folder();
    let [fx, fy, cx, cy] = LENS;
    let mut entries = Vec::new();
    for (camera, place) in places().iter().enumerate() {
        for frame in 0..FRAMES {
            paint(&builder.root.join(format!("data/r_{camera}_{frame}.png")), camera, frame, true);
            entries.push(json!({
                "file_path": format!("./data/r_{camera}_{frame}.png"), "time": frame as f64 / RATE,
                "c2w": place.c2w(), "intrinsic": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]],
            }));
        }
    }
    save(&builder.root, "all_data.json", Value::from(entries).to_string());
    open(&builder.root).unwrap()
}

/// `transforms.json` of a z-up world, with times from `time` of the frame.
pub fn transforms(time: impl Fn(i64) -> Value) -> Value {
    let [fx, fy, cx, cy] = LENS;
    let mut frames = Vec::new();
    for frame in 0..FRAMES {
        for (camera, place) in places().iter().enumerate() {
            let mut matrix = place.seen_from(y_to_z(), 1.0, [0.0; 3]).c2w().map(Vec::from).to_vec();
            matrix.push(vec![0.0, 0.0, 0.0, 1.0]);
            let mut entry = json!({"file_path": format!("./images/c{camera}_{frame:03}"), "transform_matrix": matrix});
            if !time(frame).is_null() {
                entry["time"] = time(frame);
            }
            frames.push(entry);
        }
    }
    json!({"fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": SIZE.0, "h": SIZE.1, "camera_model": "OPENCV", "k1": 0.0, "frames": frames})
}

/// The images of [`transforms`].
pub fn transforms_images(root: &Path, transparent: bool) {
    for camera in 0..3 {
        for frame in 0..FRAMES {
            paint(&root.join(format!("images/c{camera}_{frame:03}.png")), camera, frame, transparent);
        }
    }
}

/// A COLMAP model of these places, whose images are named `cam{camera}.png`.
pub fn colmap(root: &Path, model: &str, places: &[Place]) {
    let [fx, fy, cx, cy] = LENS;
    let mut images = String::from("# Image list with two lines of data per image:\n#   IMAGE_ID, QW, …\n");
    for (camera, place) in places.iter().enumerate() {
        let ([w, x, y, z], [tx, ty, tz]) = (place.q, place.translation());
        images += &format!("{} {w} {x} {y} {z} {tx} {ty} {tz} 1 cam{camera}.png\n", camera + 1);
        images += ["\n", "1.5 2.5 -1 3.0 4.0 7\n", "10 20 -1\n"][camera % 3];
    }
    save(root, &format!("{model}/images.txt"), images);
    let (w, h) = SIZE;
    save(root, &format!("{model}/cameras.txt"), format!("# Camera list\n1 PINHOLE {w} {h} {fx} {fy} {cx} {cy}\n"));
}

/// Frames numbered from `first` in steps, in a folder per camera below `base`.
pub fn camera_folders(root: &Path, base: &str, first: i64, step: i64, transparent: bool) {
    for camera in 0..3 {
        for frame in 0..FRAMES {
            let path = root.join(base).join(format!("cam{camera}/f_{:04}.png", first + step * frame));
            paint(&path, camera, frame, transparent);
        }
    }
}

/// Calibration and a sequence of a real capture, whose images and masks are written.
pub fn real_capture(root: &Path) -> (Value, Value) {
    let [fx, fy, cx, cy] = LENS;
    let mut calibration = json!({"camera_matrix": [[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]], "distortion_coefficient": [[0.0, 0.0]]});
    let mut sequence = json!({"hit_frame": 2});
    // y up to z down: a quarter turn about x the other way
    let down = [0.5f64.sqrt(), -(0.5f64.sqrt()), 0.0, 0.0];
    for (camera, place) in places().iter().enumerate() {
        let name = format!("C{camera}");
        let place = place.seen_from(down, 1.0, [0.0; 3]);
        let [w, x, y, z] = place.q;
        let sin = (x * x + y * y + z * z).sqrt();
        let turn = 2.0 * sin.atan2(w) / sin;
        let [tx, ty, tz] = place.translation();
        calibration[&name] = json!({"rvecs": [[turn * x], [turn * y], [turn * z]], "tvecs": [[tx], [ty], [tz]]});
        let mut files = Vec::new();
        for frame in 0..FRAMES {
            let file = format!("{:05}", 400 + 7 * camera as i64 + frame);
            paint(&root.join(format!("dynamic/videos_images/{name}/{file}.jpg")), camera, frame, false);
            paint_mask(&root.join(format!("dynamic/videos_masks/{name}/{file}.png")));
            files.push(format!("{file}.jpg"));
        }
        sequence[&name] = json!(files);
    }
    (calibration, sequence)
}

/// Whether both clips have the same cameras, times (from the first frame on) and images.
#[track_caller]
pub fn same(clip: &Clip, wanted: &Clip) {
    assert_eq!((clip.cameras.len(), clip.frame_count()), (wanted.cameras.len(), wanted.frame_count()));
    for (a, b) in clip.cameras.iter().zip(&wanted.cameras) {
        assert_eq!((a.id, a.width, a.height), (b.id, b.width, b.height));
        let lens = [a.fx - b.fx, a.fy - b.fy, a.cx - b.cx, a.cy - b.cy];
        let pose = a.c2w.iter().flatten().zip(b.c2w.iter().flatten()).map(|(a, b)| a - b);
        let apart = lens.into_iter().chain(pose).map(f64::abs).fold(0.0, f64::max);
        assert!(apart < 1e-9, "camera {}: {a:?} instead of {b:?}", a.id);
    }
    for (a, b) in clip.times.iter().zip(&wanted.times) {
        assert!((a - clip.times[0] - (b - wanted.times[0])).abs() < 1e-9, "{:?} {:?}", clip.times, wanted.times);
    }
    for (a, b) in clip.frames.iter().flatten().zip(wanted.frames.iter().flatten()) {
        assert!(a == b, "an image differs");
    }
}
