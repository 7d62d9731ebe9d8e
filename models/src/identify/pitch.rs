//! The world around a body of which one film was seen, by a camera whose pitch only the fall suggests.

use crate::vector::{cross, minus, plus, rotation, times};

/// A body and the camera that saw it, as they stand in a world whose vertical is `y`.
///
/// If the camera looks `δ` further down than it was taken to, both turn by `δ` about the horizontal through the body's middle `c`. The share
/// `cos β` of gravity across a line of sight `β` below the horizontal becomes `cos(β + δ)`, and with it all lengths, that of the middle
/// above the ground among them, `s = cos(β + δ)/cos β` times what they were. A point `x` of the body is at `X = C + s R(δ) (x − c)`, with `C` the middle at its new height. Where it is seen again is
/// `x = c + R(δ)ᵀ (X − C)/s`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pitch {
    middle: [f64; 3],
    /// The horizontal about which a camera turns down; to its left.
    axis: [f64; 3],
    /// How far below the horizontal the line of sight `β` was taken to be \[rad\].
    below: f64,
    /// Height of the ground \[m\].
    ground: f64,
}

impl Pitch {
    /// That of a camera with this axis to the right, and a body with this middle; lengths grow by `growth` with a small pitch
    /// \[1/rad\].
    pub fn new(middle: [f64; 3], right: [f64; 3], growth: f64, ground: f64) -> Self {
        Self { middle, axis: right.map(|x| -x), below: (-growth).atan(), ground }
    }

    /// The line of sight with a pitch, short of the vertical.
    fn sight(&self, pitch: f64) -> f64 {
        (self.below + pitch).clamp(-STEEPEST, STEEPEST)
    }

    /// How fast the logarithm of all lengths grows with the pitch.
    fn growth(&self, pitch: f64) -> f64 {
        let sight = self.sight(pitch);
        if sight.abs() < STEEPEST { -sight.tan() } else { 0.0 }
    }

    /// How many times as long all lengths are.
    pub fn scale(&self, pitch: f64) -> f64 {
        self.sight(pitch).cos() / self.sight(0.0).cos()
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
        let grown = plus(arm, [0.0, rise, 0.0]).map(|x| self.growth(pitch) * x);
        plus(cross(self.axis, arm), grown)
    }

    /// A displacement or a velocity in the world that is seen like this one.
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
        let shrunk = arm.map(|x| -self.growth(pitch) * x);
        let sunk = times(&back, [0.0, -self.growth(pitch) * rise, 0.0]);
        plus(plus(own, shrunk), sunk)
    }
}

/// No camera is taken to look down, or up, more than this \[rad\]: gravity would be seen end on.
const STEEPEST: f64 = 1.4;

#[cfg(test)]
mod tests {
    use super::*;

    const PITCH: Pitch = Pitch { middle: [0.3, 1.1, -2.0], axis: [-1.0, 0.0, 0.0], below: 0.4, ground: 0.2 };

    /// A camera at the origin that looks along −z sees what is ahead of it below, in the world, once it looks down.
    #[test]
    fn a_camera_that_looks_down_has_what_is_ahead_of_it_further_down() {
        let pitch = PITCH;
        let ahead = [0.3, 1.1, -3.0];
        let scale = 0.5f64.cos() / 0.4f64.cos();
        let [x, y, z] = pitch.placed(ahead, 0.1);
        approx::assert_relative_eq!(x, 0.3, epsilon = 1e-12);
        approx::assert_relative_eq!(y, 0.2 + scale * (0.9 - 0.1f64.sin()), epsilon = 1e-12);
        approx::assert_relative_eq!(z, -2.0 - scale * 0.1f64.cos(), epsilon = 1e-12);
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
        // gravity is seen shorter, so that all is nearer and smaller, and its height above the ground less
        let placed = PITCH.placed(PITCH.middle, 0.5);
        approx::assert_relative_eq!(placed[1], 0.2 + 0.9 * 0.9f64.cos() / 0.4f64.cos(), epsilon = 1e-12);
        // not beyond the vertical
        assert_eq!(PITCH.scale(1.5), PITCH.scale(1.2));
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
