//! The ring of target cameras, the voxel grid they look at, and each camera's frustum of samples.
//!
//! Lengths are in units of the model: the object lies in a cube of side 1 around the origin, and the cameras at
//! distance 1.5. World axes are right-handed with z up; camera axes are x right, y down, z forward. Voxel volumes
//! are indexed `[z, y, x]`, with samples on the cube's faces.

use serde::{Deserialize, Serialize};

use crate::video::Camera;

/// Cameras at equal azimuths around the object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ring {
    /// Number of cameras.
    pub views: usize,
    /// Elevation of all cameras in radians.
    pub elevation: f64,
    /// Distance to the origin.
    pub distance: f64,
    /// Focal length in image widths.
    pub focal: f64,
    /// Half the side of the cube of voxels.
    pub half: f64,
}

impl Ring {
    /// The published ring: elevation 30°, distance 1.5, a lens of 35 mm on a sensor of 32 mm.
    pub fn published(views: usize) -> Self {
        Self { views, elevation: 30f64.to_radians(), distance: 1.5, focal: 280.0 / 256.0, half: 0.5 }
    }

    /// Azimuth of a view in radians, in [−π, π).
    pub fn azimuth(&self, view: usize) -> f64 {
        let turn = std::f64::consts::TAU;
        (turn * view as f64 / self.views as f64 + turn / 2.0).rem_euclid(turn) - turn / 2.0
    }

    /// World to camera: `[R | t]`.
    pub fn pose(&self, view: usize) -> [[f64; 4]; 3] {
        pose(self.azimuth(view), self.elevation, self.distance)
    }

    /// World to the camera of the input image, at azimuth 0.
    pub fn input_pose(&self, elevation: f64) -> [[f64; 4]; 3] {
        pose(0.0, elevation, self.distance)
    }

    /// The camera of a view with `size²` pixels in the convention of [`Camera`]: y up, looking along −z, in a world
    /// with axes (x, z, −y) of the model's.
    pub fn camera(&self, view: usize, size: usize) -> Camera {
        let pose = self.pose(view);
        // the columns of R are the rows of its inverse; the second and third axis are negated
        let axis = |i: usize| [pose[0][i], -pose[1][i], -pose[2][i]];
        let centre = |i: usize| -(0..3).map(|row| pose[row][i] * pose[row][3]).sum::<f64>();
        let row = |i: usize, sign: f64| {
            let [x, y, z] = axis(i);
            [x, y, z, centre(i)].map(|v| sign * v)
        };
        let (focal, middle) = (self.focal * size as f64, size as f64 / 2.0);
        Camera {
            id: view as i64,
            width: size,
            height: size,
            fx: focal,
            fy: focal,
            cx: middle,
            cy: middle,
            c2w: [row(0, 1.0), row(2, 1.0), row(1, -1.0)],
        }
    }

    /// Viewpoint embedding of a view for an input elevation in radians: elevation difference, sine and cosine of
    /// the azimuth difference, and 0 for the distance difference.
    pub fn viewpoint(&self, view: usize, elevation: f64) -> [f64; 4] {
        let azimuth = self.azimuth(view) - self.azimuth(0);
        [elevation - self.elevation, azimuth.sin(), azimuth.cos(), 0.0]
    }

    /// Centres of `size³` voxels as (x, y, z), in the order of tensor axes z, y, x.
    pub fn voxels(&self, size: usize) -> impl Iterator<Item = [f64; 3]> {
        let place = move |i: usize| self.half * (2.0 * i as f64 / (size - 1) as f64 - 1.0);
        (0..size * size * size).map(move |i| [place(i % size), place(i / size % size), place(i / (size * size))])
    }

    /// Projects a world point onto a feature map of a view: position in cells (the principal point is at half the
    /// width), and depth.
    pub fn project(&self, pose: &[[f64; 4]; 3], point: [f64; 3], width: usize) -> [f64; 3] {
        let [x, y, z] = [0, 1, 2].map(|row| {
            let [a, b, c, t] = pose[row];
            a * point[0] + b * point[1] + c * point[2] + t
        });
        let (size, depth) = (width as f64, z.max(1e-4));
        [size * (self.focal * x / depth + 0.5), size * (self.focal * y / depth + 0.5), z]
    }

    /// Minimum and maximum depth of a frustum: those of a ball of radius √3/2 around the origin.
    pub fn depths(&self) -> [f64; 2] {
        let radius = 3f64.sqrt() * self.half;
        [self.distance - radius, self.distance + radius]
    }

    /// World points of a view's frustum: `depth` samples from near to far, ends included, along the ray of each
    /// cell of a `width²` map, in the order depth, row, column.
    pub fn frustum(&self, view: usize, depth: usize, width: usize) -> impl Iterator<Item = [f64; 3]> {
        let pose = self.pose(view);
        let [near, far] = self.depths();
        let (focal, size) = (self.focal, width as f64);
        (0..depth * width * width).map(move |i| {
            let (column, row, sample) = (i % width, i / width % width, i / (width * width));
            let z = near + (far - near) * sample as f64 / (depth - 1) as f64;
            let ray = |cell: usize| (cell as f64 / size - 0.5) / focal * z;
            let camera = [ray(column) - pose[0][3], ray(row) - pose[1][3], z - pose[2][3]];
            [0, 1, 2].map(|axis| (0..3).map(|row| pose[row][axis] * camera[row]).sum())
        })
    }
}

fn pose(azimuth: f64, elevation: f64, distance: f64) -> [[f64; 4]; 3] {
    let ((sin_a, cos_a), (sin_e, cos_e)) = (azimuth.sin_cos(), elevation.sin_cos());
    [
        [-sin_a, cos_a, 0.0, 0.0],
        [sin_e * cos_a, sin_e * sin_a, -cos_e, 0.0],
        [-cos_e * cos_a, -cos_e * sin_a, -sin_e, distance],
    ]
}
