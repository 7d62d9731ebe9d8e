//! Illumination of an object.

use gradreel::Key;

use super::dice::Dice;
use crate::vector::dot;

/// A distant lamp above the object, and ambient light.
pub(super) struct Lamp {
    /// Of length 1.
    towards: [f64; 3],
    /// Share of ambient light.
    everywhere: f64,
}

impl Lamp {
    /// Draws a lamp.
    pub fn draw(key: Key) -> Self {
        let mut dice = Dice::new(key);
        let towards = dice.direction();
        let towards = [towards[0], towards[1], towards[2].abs() + 0.4];
        let norm = dot(towards, towards).sqrt();
        Self { towards: towards.map(|x| x / norm), everywhere: dice.within(0.5, 0.8) }
    }

    /// Brightness of a surface with this normal, 0 to 1.
    pub fn brightness(&self, normal: [f64; 3]) -> f64 {
        self.everywhere + (1.0 - self.everywhere) * dot(normal, self.towards).max(0.0)
    }
}
