//! The world around a body of which one film was seen, by a camera whose pitch only the fall suggests.

use crate::vector::{cross, minus, plus, rotation, times};

/// A body and the camera that saw it, as they stand in a world whose vertical is `y`.
///
/// If the camera looks `δ` further down than it was taken to, both turn by `δ` about the horizontal through the body's middle `c`; and as
/// the share of gravity along the picture is another then, all lengths grow by `s = exp(γ δ)`, the height of the middle above the ground
/// with them. A point `x` of the body is at `X = C + s R(δ) (x − c)`, with `C` the middle at its new height. Where it is seen again is
/// `x = c + R(δ)ᵀ (X − C)/s`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pitch {
    middle: [f64; 3],
    /// The horizontal about which a camera turns down; to its left.
    axis: [f64; 3],
    /// Growth `γ` of all lengths with the pitch \[1/rad\].
    growth: f64,
    /// Height of the ground \[m\].
    ground: f64,
}

impl Pitch {
    /// That of a camera with this axis to the right, and a body with this middle.
    pub fn new(middle: [f64; 3], right: [f64; 3], growth: f64, ground: f64) -> Self {
        Self { middle, axis: right.map(|x| -x), growth, ground }
    }

    /// How many times as long all lengths are.
    pub fn scale(&self, pitch: f64) -> f64 {
        (self.growth * pitch).exp()
    }

    /// Where the middle is.
    fn centre(&self, scale: f64) -> [f64; 3] {
        let [x, y, z] = self.middle;
        [x, self.ground + scale * (y - self.ground), z]
    }

    /// Where a point of the body is in the world.
    pub fn placed(&self, point: [f64; 3], pitch: f64) -> [f64; 3] {
        let scale = self.scale(pitch);
        let arm = times(&self.turn(pitch), minus(point, self.middle));
        plus(self.centre(scale), arm.map(|x| scale * x))
    }

    /// How fast a point of the body moves with the pitch.
    pub fn rate(&self, point: [f64; 3], pitch: f64) -> [f64; 3] {
        let scale = self.scale(pitch);
        let arm = times(&self.turn(pitch), minus(point, self.middle)).map(|x| scale * x);
        let [_, rise, _] = minus(self.centre(scale), [0.0, self.ground, 0.0]);
        let grown = plus(arm, [0.0, rise, 0.0]).map(|x| self.growth * x);
        plus(cross(self.axis, arm), grown)
    }

    /// How a point of the world moves that moves so on the body.
    pub fn along(&self, rate: [f64; 3], pitch: f64) -> [f64; 3] {
        let scale = self.scale(pitch);
        times(&self.turn(pitch), rate).map(|x| scale * x)
    }

    /// The rotation by a pitch, rows first.
    pub fn turn(&self, pitch: f64) -> [[f64; 3]; 3] {
        rotation(self.axis.map(|x| x * pitch))
    }

    /// The map from the world to where the camera sees it, `x = M X + b`.
    pub fn seen(&self, pitch: f64) -> ([[f64; 3]; 3], [f64; 3]) {
        let scale = self.scale(pitch);
        let turn = self.turn(pitch);
        let back = std::array::from_fn(|i| std::array::from_fn(|j| turn[j][i] / scale));
        (back, minus(self.middle, times(&back, self.centre(scale))))
    }

    /// How fast what stands still in the world, seen at a point, moves in the picture's space with the pitch.
    pub fn seen_rate(&self, seen: [f64; 3], pitch: f64) -> [f64; 3] {
        let scale = self.scale(pitch);
        let (back, _) = self.seen(pitch);
        let arm = minus(seen, self.middle);
        let [_, rise, _] = minus(self.centre(scale), [0.0, self.ground, 0.0]);
        let own = cross(self.axis, arm).map(|x| -x);
        let shrunk = arm.map(|x| -self.growth * x);
        let sunk = times(&back, [0.0, -self.growth * rise, 0.0]);
        plus(plus(own, shrunk), sunk)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PITCH: Pitch = Pitch { middle: [0.3, 1.1, -2.0], axis: [-1.0, 0.0, 0.0], growth: 0.4, ground: 0.2 };

    /// A camera at the origin that looks along −z sees what is ahead of it below, in the world, once it looks down.
    #[test]
    fn a_camera_that_looks_down_has_what_is_ahead_of_it_further_down() {
        let pitch = Pitch { growth: 0.0, ..PITCH };
        let ahead = [0.3, 1.1, -3.0];
        let [x, y, z] = pitch.placed(ahead, 0.1);
        approx::assert_relative_eq!(x, 0.3, epsilon = 1e-12);
        approx::assert_relative_eq!(y, 1.1 - 0.1f64.sin(), epsilon = 1e-12);
        approx::assert_relative_eq!(z, -2.0 - 0.1f64.cos(), epsilon = 1e-12);
    }

    #[test]
    fn what_is_placed_is_seen_where_it_was() {
        for pitch in [-0.3, 0.0, 0.4] {
            let point = [0.5, 0.9, -2.2];
            let placed = PITCH.placed(point, pitch);
            let (by, from) = PITCH.seen(pitch);
            let seen = plus(times(&by, placed), from);
            (0..3).for_each(|k| approx::assert_relative_eq!(seen[k], point[k], epsilon = 1e-12));
        }
        // lengths grow, and so does the height above the ground
        let placed = PITCH.placed(PITCH.middle, 0.5);
        approx::assert_relative_eq!(placed[1], 0.2 + 0.9 * 0.2f64.exp(), epsilon = 1e-12);
    }

    #[test]
    fn rates_are_derivatives() {
        let (point, step) = ([0.5, 0.9, -2.2], 1e-6);
        for pitch in [-0.3, 0.4] {
            let world = [0.1, 0.4, -1.8];
            let seen = |pitch| {
                let (by, from) = PITCH.seen(pitch);
                plus(times(&by, world), from)
            };
            let difference =
                |of: &dyn Fn(f64) -> [f64; 3]| minus(of(pitch + step), of(pitch - step)).map(|x| x / (2.0 * step));
            let placed = difference(&|pitch| PITCH.placed(point, pitch));
            let moved = difference(&seen);
            let (rate, seen_rate) = (PITCH.rate(point, pitch), PITCH.seen_rate(seen(pitch), pitch));
            for k in 0..3 {
                approx::assert_relative_eq!(rate[k], placed[k], epsilon = 1e-8);
                approx::assert_relative_eq!(seen_rate[k], moved[k], epsilon = 1e-8);
            }
        }
    }
}
