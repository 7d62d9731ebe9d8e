//! Two depth layers of a mesh: a z-buffer that keeps the nearest and the farthest surface of each ray.

use super::camera::Scene;

/// What the rays of a square grid meet: `size²` rays, row by row.
pub(super) struct Layers {
    pub size: usize,
    /// Reciprocal depth of the nearest surface; 0 where there is none.
    pub near: Vec<f32>,
    /// Reciprocal depth of the farthest surface.
    pub far: Vec<f32>,
    /// Triangle of the nearest surface.
    pub triangle: Vec<u32>,
}

/// Tolerance at the edges of triangles, so that rays through shared edges meet one of both.
const EDGE: f32 = -1e-5;
/// Twice the smallest area of a triangle in rays².
const LEAST: f32 = 1e-9;

impl Layers {
    /// Draws a scene with `size²` rays through the window of a picture of `pixels²`.
    pub fn draw(scene: &Scene, triangles: &[[u32; 3]], pixels: usize, size: usize) -> Self {
        let grid = Grid::of(scene, pixels, size);
        let placed: Vec<[f32; 3]> = scene.corners.iter().map(|c| grid.placed(*c)).collect();
        let mut layers = Self {
            size,
            near: vec![0.0; size * size],
            far: vec![f32::INFINITY; size * size],
            triangle: vec![u32::MAX; size * size],
        };
        for (number, triangle) in triangles.iter().enumerate() {
            layers.triangle(triangle.map(|corner| placed[corner as usize]), number as u32);
        }
        layers
    }

    /// Draws a triangle of corners in the grid, with their reciprocal depths, which are linear over the picture.
    fn triangle(&mut self, [a, b, c]: [[f32; 3]; 3], number: u32) {
        let (bx, by, cx, cy) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
        let area = bx * cy - cx * by;
        if area.abs() < LEAST {
            return;
        }
        let size = self.size as f32;
        // rays are in the middles of cells
        let first = |x: f32| (x - 0.5).ceil().clamp(0.0, size) as usize;
        let columns = first(a[0].min(b[0]).min(c[0]))..first(a[0].max(b[0]).max(c[0]) + 1e-3);
        let rows = first(a[1].min(b[1]).min(c[1]))..first(a[1].max(b[1]).max(c[1]) + 1e-3);
        // shares of the second and the third corner: per column and per row
        let (v_x, w_x) = (cy / area, -by / area);
        let (dz_b, dz_c) = (b[2] - a[2], c[2] - a[2]);
        let z_x = v_x * dz_b + w_x * dz_c;
        for row in rows {
            let (x, y) = (columns.start as f32 + 0.5 - a[0], row as f32 + 0.5 - a[1]);
            let mut v = (x * cy - cx * y) / area;
            let mut w = (bx * y - x * by) / area;
            let mut z = a[2] + v * dz_b + w * dz_c;
            let line = row * self.size;
            for at in line + columns.start..line + columns.end {
                if v >= EDGE && w >= EDGE && v + w <= 1.0 - EDGE {
                    if z > self.near[at] {
                        self.near[at] = z;
                        self.triangle[at] = number;
                    }
                    if z < self.far[at] {
                        self.far[at] = z;
                    }
                }
                (v, w, z) = (v + v_x, w + w_x, z + z_x);
            }
        }
    }
}

/// The grid of rays through a window.
#[derive(Clone, Copy)]
pub(super) struct Grid {
    centre: [f32; 2],
    /// Distance between rays at the distance 1.
    step: f32,
    half: f32,
}

impl Grid {
    pub fn of(scene: &Scene, pixels: usize, size: usize) -> Self {
        Self { centre: scene.centre, step: scene.pixel * (pixels as f32 / size as f32), half: 0.5 * size as f32 }
    }

    /// Column, row and reciprocal depth of a point.
    pub fn placed(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let inverse = 1.0 / z;
        [
            (x * inverse - self.centre[0]) / self.step + self.half,
            (y * inverse - self.centre[1]) / self.step + self.half,
            inverse,
        ]
    }

    /// The point of the ray in a cell at the depth 1.
    pub fn ray(&self, column: usize, row: usize) -> [f32; 3] {
        let at = |k: usize, cell: usize| self.centre[k] + (cell as f32 + 0.5 - self.half) * self.step;
        [at(0, column), at(1, row), 1.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::testing::{ball, boxed};

    fn scene(solid: &crate::depth::Solid, distance: f32) -> Scene {
        let corners = solid.corners().iter().map(|[x, y, z]| [*x, *y, z + distance]).collect();
        Scene { corners, up: [0.0, -1.0, 0.0], centre: [0.05, -0.02], pixel: 0.01 }
    }

    /// Rays meet a sphere where `|t r − c| = R`; chords of the mesh cost a part of the sagitta.
    #[test]
    fn a_sphere_is_met_where_the_formula_says() {
        let (radius, distance) = (0.5f32, 2.0f32);
        let solid = ball(radius, 96);
        let scene = scene(&solid, distance);
        let layers = Layers::draw(&scene, solid.triangles(), 64, 128);
        let grid = Grid::of(&scene, 64, 128);
        let mut met = 0;
        for row in 0..128 {
            for column in 0..128 {
                let [x, y, _] = grid.ray(column, row);
                let (a, b, c) = (x * x + y * y + 1.0, -distance, distance * distance - radius * radius);
                let root = b * b - a * c;
                let at = row * 128 + column;
                // nearly tangent rays may miss the mesh
                if root > 0.01 {
                    let [near, far] = [(-b - root.sqrt()) / a, (-b + root.sqrt()) / a];
                    assert!((1.0 / layers.near[at] - near).abs() < 5e-3, "{} not {near}", 1.0 / layers.near[at]);
                    assert!((1.0 / layers.far[at] - far).abs() < 5e-3, "{} not {far}", 1.0 / layers.far[at]);
                    met += 1;
                } else if root < 0.0 {
                    assert_eq!(layers.near[at], 0.0);
                }
            }
        }
        assert!(met > 2000, "{met} rays");
    }

    /// Faces of a box across the view are at exactly their depths.
    #[test]
    fn a_box_is_exact() {
        let solid = boxed([0.3, 0.2, 0.25]);
        let scene = scene(&solid, 3.0);
        let layers = Layers::draw(&scene, solid.triangles(), 64, 64);
        let grid = Grid::of(&scene, 64, 64);
        let mut met = 0;
        for row in 0..64 {
            for column in 0..64 {
                let [x, y, _] = grid.ray(column, row);
                let inside = |z: f32, edge: f32| (z * x).abs() < 0.3 - edge && (z * y).abs() < 0.2 - edge;
                let at = row * 64 + column;
                if inside(2.75, 1e-3) && inside(3.25, 1e-3) {
                    assert!((1.0 / layers.near[at] - 2.75).abs() < 1e-5 && (1.0 / layers.far[at] - 3.25).abs() < 1e-5);
                    met += 1;
                } else if !inside(2.75, -1e-3) {
                    assert_eq!(layers.triangle[at], u32::MAX);
                }
            }
        }
        assert!(met > 100, "{met} rays");
    }
}
