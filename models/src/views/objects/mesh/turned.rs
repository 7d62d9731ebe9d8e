//! A mesh rotated about the vertical, with its box centred again.

use std::sync::Arc;

use super::TexturedMesh;
use crate::vector::{bounds, dot};
use crate::views::objects::Met;

/// `object = (turned mesh − middle) / size`
pub(in crate::views::objects) struct Turned {
    mesh: Arc<TexturedMesh>,
    /// Sine and cosine of the angle.
    turn: [f64; 2],
    /// Centre and longest side of the rotated mesh's box.
    middle: [f64; 3],
    size: f64,
    half: [f64; 3],
}

impl Turned {
    /// Rotates by `turn` radians, from x towards y.
    pub fn new(mesh: Arc<TexturedMesh>, turn: f64) -> Self {
        let turn = [turn.sin(), turn.cos()];
        let [low, high] = bounds(mesh.vertices.iter().map(|vertex| turned(turn, vertex.place.map(f64::from))));
        let sides = [0, 1, 2].map(|axis| high[axis] - low[axis]);
        let size = sides.into_iter().fold(f64::MIN_POSITIVE, f64::max);
        let middle = [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]));
        Self { mesh, turn, middle, size, half: sides.map(|side| 0.5 * side / size) }
    }

    /// Half sides of its box, the longest of which is 1.
    pub fn half(&self) -> [f64; 3] {
        self.half
    }

    /// Intersection with a ray; the direction has length 1.
    pub fn met(&self, origin: [f64; 3], along: [f64; 3]) -> Option<Met> {
        let [sin, cos] = self.turn;
        let back = [-sin, cos];
        let origin = turned(back, std::array::from_fn(|axis| self.size * origin[axis] + self.middle[axis]));
        let along = turned(back, along);
        let first = self.mesh.first(origin, along)?;
        let normal = turned(self.turn, self.mesh.normal(first, along));
        debug_assert!((dot(normal, normal) - 1.0).abs() < 1e-6);
        Some(Met { normal, colour: self.mesh.colour(first) })
    }
}

fn turned([sin, cos]: [f64; 2], [x, y, z]: [f64; 3]) -> [f64; 3] {
    [cos * x - sin * y, sin * x + cos * y, z]
}
