//! Position and size of the object in the image.

use ndarray::Array2;

use crate::video::{Camera, Frame};

/// The silhouette of one frame, reduced to its centroid and size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Time \[s\].
    pub time: f64,
    /// Centroid of the silhouette \[pixels\].
    pub middle: [f64; 2],
    /// Logarithm of the side of a square of the silhouette's area \[pixels\], corrected to the image centre.
    pub size: f64,
}

impl Sighting {
    /// The sighting in `frame`; `None` without an object, or if the image border or excluded pixels cut it off.
    pub fn of(camera: &Camera, frame: &Frame, time: f64) -> Option<Self> {
        let (height, width) = frame.alpha.dim();
        let cut = frame.alpha.indexed_iter().any(|((row, column), &alpha)| {
            let at_edge = row == 0 || column == 0 || row + 1 == height || column + 1 == width;
            alpha > 0.5 && (at_edge || frame.weight[[row, column]] < 0.5)
        });
        (!cut).then(|| Self::of_coverage(camera, &frame.alpha, [0.0; 2], 1.0, time)).flatten()
    }

    /// The same for a coverage map whose first pixel has its corner at `corner` and whose pixels are `side` wide.
    pub(super) fn of_coverage(
        camera: &Camera,
        alpha: &Array2<f32>,
        corner: [f64; 2],
        side: f64,
        time: f64,
    ) -> Option<Self> {
        let (mut mass, mut moment) = (0.0, [0.0; 2]);
        for ((row, column), &alpha) in alpha.indexed_iter().filter(|(_, alpha)| **alpha > 0.0) {
            let alpha = f64::from(alpha);
            mass += alpha;
            moment[0] += alpha * (column as f64 + 0.5);
            moment[1] += alpha * (row as f64 + 0.5);
        }
        if mass < 4.0 {
            return None;
        }
        let middle: [f64; 2] = std::array::from_fn(|axis| corner[axis] + side * moment[axis] / mass);
        // off-axis, the image plane cuts the cone of rays obliquely
        let [x, y] = [(middle[0] - camera.cx) / camera.fx, (middle[1] - camera.cy) / camera.fy];
        let cosine = 1.0 / (1.0 + x * x + y * y).sqrt();
        Some(Self { time, middle, size: 0.5 * (mass * side * side * cosine).ln() })
    }
}
