//! A simple rendering: particles as shaded balls, a floor with a grid, obstacles in grey.

use super::file::Camera;
use super::setup::Setup;
use crate::physics::{Collider, Region};
use crate::report::animation::Picture;
use crate::vector::{bounds, cross, dot, minus, plus, unit};

const BACKGROUND: [f64; 3] = [244.0, 246.0, 249.0];
const FLOOR: [f64; 3] = [222.0, 226.0, 232.0];
const LINES: [f64; 3] = [200.0, 206.0, 215.0];
const OBSTACLE: [f64; 3] = [150.0, 156.0, 166.0];
/// Towards the light, in the camera's axes: right, up, towards the camera.
const LIGHT: [f64; 3] = [-0.42, 0.68, 0.60];
/// Maximum number of points that represent an obstacle along each direction of its surface.
const POINTS: f64 = 120.0;

/// Viewpoint and size of a picture.
#[derive(Debug, Clone)]
pub struct View {
    position: [f64; 3],
    /// Right, up, backwards.
    axes: [[f64; 3]; 3],
    /// Pixels per unit of tangent.
    focal: f64,
    size: [usize; 2],
    /// Height of the floor, and where its grid is centred.
    floor: Option<f64>,
    centre: [f64; 3],
    reach: f64,
}

impl View {
    /// The view requested by the file; omitted values are chosen such that the start and the floor below it are
    /// visible.
    pub fn of(setup: &Setup, camera: &Camera) -> Self {
        let [mut low, mut high] = bounds(setup.positions.iter().copied());
        // Only obstacles about as large as the bodies are framed.
        let size: f64 = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        for [from, to] in setup.world.colliders.iter().filter_map(box_of) {
            if (0..3).all(|axis| to[axis] - from[axis] < 4.0 * size) {
                low = std::array::from_fn(|axis| low[axis].min(from[axis]));
                high = std::array::from_fn(|axis| high[axis].max(to[axis]));
            }
        }
        let floor = setup.floor();
        let foot = floor.filter(|floor| low[1] - floor < 3.0 * (high[1] - low[1] + 0.1)).unwrap_or(low[1]);
        let low = [low[0], foot.min(low[1]), low[2]];
        let middle: [f64; 3] = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
        let reach = (0..3).map(|axis| (high[axis] - low[axis]).powi(2)).sum::<f64>().sqrt().max(1e-3);
        let target = camera.target_m.unwrap_or([middle[0], middle[1] - 0.05 * reach, middle[2]]);
        let half = camera.field_of_view_deg.unwrap_or(35.0).to_radians() / 2.0;
        let distance = 0.62 * reach / half.sin();
        let position = camera.eye_m.unwrap_or_else(|| {
            let direction = unit([0.55, 0.38, 0.9]);
            std::array::from_fn(|axis| target[axis] + distance * direction[axis])
        });
        let back = unit(minus(position, target));
        let aside = cross([0.0, 1.0, 0.0], back);
        // When looking straight up or down, any horizontal axis will do.
        let right = if dot(aside, aside) > 1e-12 { unit(aside) } else { [1.0, 0.0, 0.0] };
        let axes = [right, cross(back, right), back];
        let size = camera.pixels.unwrap_or([480, 360]);
        Self { position, axes, focal: size[1] as f64 / 2.0 / half.tan(), size, floor, centre: target, reach }
    }

    /// Renders particles in the colours of their objects, and obstacles at time `t` \[s\].
    pub fn picture(&self, setup: &Setup, positions: &[[f32; 3]], t: f64) -> Picture {
        let mut canvas = Canvas::new(self);
        for collider in setup.world.colliders.iter().filter(|collider| !collider.container) {
            let radius = 0.006 * self.reach;
            for x in surface(collider, radius) {
                canvas.ball(self, collider.place(x, t), radius, OBSTACLE);
            }
        }
        for (x, &object) in positions.iter().zip(&setup.object_of) {
            let radius = 0.62 * setup.volumes[object as usize].cbrt();
            canvas.ball(self, x.map(f64::from), radius, setup.colours[object as usize].map(f64::from));
        }
        canvas.picture()
    }

    /// Column, row and depth of a point in front of the camera.
    fn project(&self, x: [f64; 3]) -> Option<[f64; 3]> {
        let from_camera = minus(x, self.position);
        let [right, up, back] = self.axes.map(|axis| dot(axis, from_camera));
        let depth = -back;
        (depth > 1e-3 * self.reach).then(|| {
            let scale = self.focal / depth;
            [self.size[0] as f64 / 2.0 + right * scale, self.size[1] as f64 / 2.0 - up * scale, depth]
        })
    }

    /// Colour and depth of the floor or background in a pixel.
    fn behind(&self, column: usize, row: usize) -> ([f64; 3], f64) {
        let across = (column as f64 + 0.5 - self.size[0] as f64 / 2.0) / self.focal;
        let up = (self.size[1] as f64 / 2.0 - row as f64 - 0.5) / self.focal;
        let ray: [f64; 3] = std::array::from_fn(|i| across * self.axes[0][i] + up * self.axes[1][i] - self.axes[2][i]);
        let Some(floor) = self.floor else { return (BACKGROUND, f64::INFINITY) };
        let depth = (floor - self.position[1]) / ray[1];
        if !(depth > 0.0 && depth.is_finite()) {
            return (BACKGROUND, f64::INFINITY);
        }
        let at = [self.position[0] + depth * ray[0], self.position[2] + depth * ray[2]];
        let away = ((at[0] - self.centre[0]).hypot(at[1] - self.centre[2]) / (2.5 * self.reach)).min(1.0);
        // A line every power of ten metres: about ten across the scene.
        let step = 10_f64.powf((self.reach / 4.0).log10().floor());
        let width = 0.75 * depth / self.focal;
        let near_line = at.iter().any(|x| (x / step - (x / step).round()).abs() * step < width);
        let plain = if near_line { LINES } else { FLOOR };
        let fade = away * away;
        (std::array::from_fn(|i| plain[i] + fade * (BACKGROUND[i] - plain[i])), depth)
    }
}

struct Canvas {
    size: [usize; 2],
    colour: Vec<[f64; 3]>,
    depth: Vec<f64>,
}

impl Canvas {
    fn new(view: &View) -> Self {
        let [width, height] = view.size;
        let (colour, depth) = (0..width * height).map(|k| view.behind(k % width, k / width)).unzip();
        Self { size: view.size, colour, depth }
    }

    /// Draws a ball with depth test.
    fn ball(&mut self, view: &View, x: [f64; 3], radius: f64, colour: [f64; 3]) {
        let Some([column, row, depth]) = view.project(x) else { return };
        let r = (radius * view.focal / depth).max(0.7);
        let range = |middle: f64, size: usize| {
            // A float to integer cast saturates.
            ((middle - r).floor().max(0.0) as usize)..((middle + r).ceil().max(0.0) as usize + 1).min(size)
        };
        for j in range(row, self.size[1]) {
            for i in range(column, self.size[0]) {
                let (u, v) = ((i as f64 + 0.5 - column) / r, (row - j as f64 - 0.5) / r);
                let inside = 1.0 - u * u - v * v;
                if inside < 0.0 {
                    continue;
                }
                let out = inside.sqrt();
                let (at, here) = (j * self.size[0] + i, depth - radius * out);
                if here < self.depth[at] {
                    let light = (LIGHT[0] * u + LIGHT[1] * v + LIGHT[2] * out).max(0.0);
                    self.depth[at] = here;
                    self.colour[at] = colour.map(|c| c * (0.45 + 0.6 * light));
                }
            }
        }
    }

    fn picture(&self) -> Picture {
        let rgb = self.colour.iter().flatten().map(|c| c.clamp(0.0, 255.0).round() as u8).collect();
        Picture { width: self.size[0], height: self.size[1], rgb }
    }
}

/// Lower and upper corner of a bounded obstacle, ignoring its rotation.
fn box_of(collider: &Collider) -> Option<[[f64; 3]; 2]> {
    let around = |centre: [f64; 3], half: [f64; 3]| {
        let corner = |side: f64| std::array::from_fn(|axis| centre[axis] + side * half[axis]);
        Some([corner(-1.0), corner(1.0)])
    };
    match collider.region {
        Region::Plane { .. } => None,
        Region::Sphere { centre, radius } => around(centre, [radius; 3]),
        Region::Cuboid { centre, half } => around(centre, half),
        Region::Cylinder { start, end, radius } => {
            let centre = std::array::from_fn(|axis| 0.5 * (start[axis] + end[axis]));
            around(centre, std::array::from_fn(|axis| 0.5 * (end[axis] - start[axis]).abs() + radius))
        }
    }
}

/// Points on the surface of an obstacle, about `spacing` apart; none for a plane.
fn surface(collider: &Collider, spacing: f64) -> Vec<[f64; 3]> {
    let count = |length: f64| (length / spacing).ceil().clamp(1.0, POINTS) as usize;
    let mut points = Vec::new();
    match collider.region {
        Region::Plane { .. } => {}
        Region::Sphere { centre, radius } => {
            // A spiral from pole to pole: equal areas, golden angle.
            let n = count(3.5 * radius).pow(2);
            for k in 0..n {
                let y = 1.0 - 2.0 * (k as f64 + 0.5) / n as f64;
                let (sin, cos) = (2.399_963_229_728_653 * k as f64).sin_cos();
                let ring = (1.0 - y * y).sqrt();
                points.push(plus(centre, [radius * ring * cos, radius * y, radius * ring * sin]));
            }
        }
        Region::Cuboid { centre, half } => {
            for axis in 0..3 {
                let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
                let (na, nb) = (count(2.0 * half[a]), count(2.0 * half[b]));
                for k in 0..2 * (na + 1) * (nb + 1) {
                    let mut x = [0.0; 3];
                    x[axis] = if k % 2 == 0 { half[axis] } else { -half[axis] };
                    x[a] = half[a] * (2.0 * (k / 2 % (na + 1)) as f64 / na as f64 - 1.0);
                    x[b] = half[b] * (2.0 * (k / 2 / (na + 1)) as f64 / nb as f64 - 1.0);
                    points.push(plus(centre, x));
                }
            }
        }
        Region::Cylinder { start, end, radius } => {
            let axis = minus(end, start);
            let length = dot(axis, axis).sqrt();
            let n = axis.map(|a| a / length);
            let aside = if n[0].abs() < 0.8 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
            let u = unit(cross(n, aside));
            let w = cross(n, u);
            let (along, rings) = (count(length), count(radius));
            let mut ring = |centre: [f64; 3], radius: f64| {
                let around = count(std::f64::consts::TAU * radius);
                for k in 0..around {
                    let (sin, cos) = (std::f64::consts::TAU * k as f64 / around as f64).sin_cos();
                    points.push(std::array::from_fn(|i| centre[i] + radius * (cos * u[i] + sin * w[i])));
                }
            };
            for k in 0..=along {
                ring(std::array::from_fn(|i| start[i] + axis[i] * k as f64 / along as f64), radius);
            }
            for k in 0..rings {
                let radius = radius * k as f64 / rings as f64;
                ring(start, radius);
                ring(end, radius);
            }
        }
    }
    points
}
