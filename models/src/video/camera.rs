//! A pinhole camera: from pixels to rays and from points to pixels.

use crate::vector::cross;

/// A pinhole camera without distortion.
///
/// `c2w` maps camera coordinates to the world, `p_world = R p + t` with `R` its first three columns and `t` the fourth
/// \[m\]. OpenGL axes: x right, y up, looking along −z. Pixel coordinates `(u, v)` start in the upper left corner of the
/// image, and the centre of the first pixel is `(0.5, 0.5)`. Focal lengths and principal point are in pixels.
///
/// ```
/// use gradreel_models::video::Camera;
///
/// let camera = Camera {
///     id: 0, width: 64, height: 48, fx: 80.0, fy: 80.0, cx: 32.0, cy: 24.0,
///     c2w: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 3.0]],
/// };
/// // One metre to the right of the axis at three metres' distance.
/// let [u, v, depth] = camera.project([1.0, 1.0, 0.0]).unwrap();
/// assert!((u - (32.0 + 80.0 / 3.0)).abs() < 1e-12 && v == 24.0 && depth == 3.0);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Number of the camera in the file names.
    pub id: i64,
    /// Image width \[pixels\].
    pub width: usize,
    /// Image height \[pixels\].
    pub height: usize,
    /// Horizontal focal length \[pixels\].
    pub fx: f64,
    /// Vertical focal length \[pixels\].
    pub fy: f64,
    /// Column of the principal point \[pixels\].
    pub cx: f64,
    /// Row of the principal point \[pixels\].
    pub cy: f64,
    /// Camera to world, rows of the 3×4 matrix.
    pub c2w: [[f64; 4]; 3],
}

impl Camera {
    /// A camera of these pixels and this vertical angle of view \[rad\] that looks at a point from so far away \[m\]: `[around,
    /// up]` are its azimuth from +z towards +x and its elevation \[rad\].
    pub(crate) fn around(
        id: i64,
        [width, height]: [usize; 2],
        view: f64,
        target: [f64; 3],
        distance: f64,
        [around, up]: [f64; 2],
    ) -> Self {
        let back = [around.sin() * up.cos(), up.sin(), around.cos() * up.cos()];
        let right = [around.cos(), 0.0, -around.sin()];
        let above = cross(back, right);
        let focal = height as f64 / 2.0 / (view / 2.0).tan();
        Self {
            id,
            width,
            height,
            fx: focal,
            fy: focal,
            cx: width as f64 / 2.0,
            cy: height as f64 / 2.0,
            c2w: [0, 1, 2].map(|i| [right[i], above[i], back[i], target[i] + distance * back[i]]),
        }
    }

    /// Position of the camera in the world \[m\].
    pub fn centre(&self) -> [f64; 3] {
        self.c2w.map(|row| row[3])
    }

    /// Origin and direction of the ray through `(u, v)`.
    ///
    /// The direction is `R ((u − cx)/fx, −(v − cy)/fy, −1)`: *not normalised*, so that `origin + t direction` lies at
    /// depth `t` in front of the camera.
    pub fn ray(&self, u: f64, v: f64) -> ([f64; 3], [f64; 3]) {
        let d = [(u - self.cx) / self.fx, -(v - self.cy) / self.fy, -1.0];
        (self.centre(), self.c2w.map(|row| row[0] * d[0] + row[1] * d[1] + row[2] * d[2]))
    }

    /// `[u, v, depth]` of a point of the world, or `None` behind the camera; depth \[m\] is measured along the axis.
    ///
    /// The point may lie outside the image.
    pub fn project(&self, p: [f64; 3]) -> Option<[f64; 3]> {
        let centre = self.centre();
        let offset = [p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]];
        let [x, y, z] = [0, 1, 2].map(|column| (0..3).map(|row| self.c2w[row][column] * offset[row]).sum::<f64>());
        let depth = -z;
        (depth > 0.0).then(|| [self.cx + self.fx * x / depth, self.cy - self.fy * y / depth, depth])
    }

    /// The camera of the image shrunk by an integer factor; sizes are divided and rounded down.
    ///
    /// # Panics
    /// If the factor is zero or leaves no pixel.
    #[track_caller]
    pub fn scaled(&self, factor: usize) -> Camera {
        assert!(
            factor > 0 && self.width >= factor && self.height >= factor,
            "Camera::scaled: factor {factor} does not fit an image of {} × {} pixels",
            self.width,
            self.height
        );
        let by = 1.0 / factor as f64;
        Camera {
            width: self.width / factor,
            height: self.height / factor,
            fx: self.fx * by,
            fy: self.fy * by,
            cx: self.cx * by,
            cy: self.cy * by,
            ..self.clone()
        }
    }
}
