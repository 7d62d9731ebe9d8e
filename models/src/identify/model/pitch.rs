//! The world around a body of which one film was seen, by a camera whose pitch only the fall suggests.

use crate::vector::{cross, minus, plus, rotation, times, transposed};

/// A body and the camera that saw it, as they stand in a world whose vertical is `y`.
///
/// If the camera looks `δ` further down than it was taken to, both turn by `δ` about the horizontal through the body's middle `c`. The
/// share `cos β` of gravity across a line of sight `β` below the horizontal becomes `cos(β + δ)`, and with it all lengths, that of the
/// middle above the ground among them, `s = cos(β + δ)/cos β` times what they were. A point `x` of the body is at `X = C + s R(δ) (x − c)`,
/// with `C` the middle at its new height. Where it is seen again is `x = c + R(δ)ᵀ (X − C)/s`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::identify) struct Pitch {
    middle: [f64; 3],
    /// The horizontal about which a camera turns down; to its left.
    axis: [f64; 3],
    /// The rotation `R`, rows first.
    pub turn: [[f64; 3]; 3],
    /// How many times as long all lengths are, `s`.
    pub scale: f64,
    /// How fast the logarithm of all lengths grows with the pitch.
    growth: f64,
    /// Where the middle is, `C`, and its height above the ground.
    centre: [f64; 3],
    rise: f64,
}

impl Pitch {
    /// The pitch `δ` \[rad\] of a camera with this axis to the right, and a body with this middle over a ground of this height; lengths
    /// grow by `growth` with a small pitch \[1/rad\].
    pub fn new(middle: [f64; 3], right: [f64; 3], growth: f64, ground: f64, pitch: f64) -> Self {
        let axis = right.map(|x| -x);
        let below = (-growth).atan();
        // short of the vertical
        let [before, now] = [below, below + pitch].map(|sight| sight.clamp(-STEEPEST, STEEPEST));
        let scale = now.cos() / before.cos();
        let rise = scale * (middle[1] - ground);
        Self {
            middle,
            axis,
            turn: rotation(axis.map(|x| x * pitch)),
            scale,
            growth: if now.abs() < STEEPEST { -now.tan() } else { 0.0 },
            centre: [middle[0], ground + rise, middle[2]],
            rise,
        }
    }

    /// Where a point of the body is in the world.
    pub fn placed(&self, point: [f64; 3]) -> [f64; 3] {
        plus(self.centre, self.along(minus(point, self.middle)))
    }

    /// How fast a point of the body moves with the pitch.
    pub fn rate(&self, point: [f64; 3]) -> [f64; 3] {
        let arm = self.along(minus(point, self.middle));
        let grown = plus(arm, [0.0, self.rise, 0.0]).map(|x| self.growth * x);
        plus(cross(self.axis, arm), grown)
    }

    /// A displacement or a velocity in the world that is seen like this one.
    pub fn along(&self, seen: [f64; 3]) -> [f64; 3] {
        times(&self.turn, seen).map(|x| self.scale * x)
    }

    /// The map from the world to where the camera sees it, `x = M X + b`.
    pub fn seen(&self) -> ([[f64; 3]; 3], [f64; 3]) {
        let back = transposed(self.turn).map(|row| row.map(|x| x / self.scale));
        (back, minus(self.middle, times(&back, self.centre)))
    }

    /// How fast what stands still in the world, seen at a point, moves in the picture's space with the pitch.
    pub fn seen_rate(&self, seen: [f64; 3]) -> [f64; 3] {
        let (back, _) = self.seen();
        let arm = minus(seen, self.middle);
        let sunk = plus(arm, times(&back, [0.0, self.rise, 0.0])).map(|x| self.growth * x);
        minus(cross(arm, self.axis), sunk)
    }
}

/// No camera is taken to look down, or up, more than this \[rad\]: gravity would be seen end on.
const STEEPEST: f64 = 1.4;

#[cfg(test)]
mod tests {
    use super::*;

    const MIDDLE: [f64; 3] = [0.3, 1.1, -2.0];

    /// A camera whose line of sight is 0.4 below the horizontal, and this pitch.
    fn at(pitch: f64) -> Pitch {
        Pitch::new(MIDDLE, [1.0, 0.0, 0.0], -0.4f64.tan(), 0.2, pitch)
    }

    /// A camera at the origin that looks along −z sees what is ahead of it below, in the world, once it looks down.
    #[test]
    fn a_camera_that_looks_down_has_what_is_ahead_of_it_further_down() {
        let ahead = [0.3, 1.1, -3.0];
        let scale = 0.5f64.cos() / 0.4f64.cos();
        let [x, y, z] = at(0.1).placed(ahead);
        approx::assert_relative_eq!(x, 0.3, epsilon = 1e-12);
        approx::assert_relative_eq!(y, 0.2 + scale * (0.9 - 0.1f64.sin()), epsilon = 1e-12);
        approx::assert_relative_eq!(z, -2.0 - scale * 0.1f64.cos(), epsilon = 1e-12);
    }

    #[test]
    fn what_is_placed_is_seen_where_it_was() {
        for pitch in [-0.3, 0.0, 0.4] {
            let point = [0.5, 0.9, -2.2];
            let placed = at(pitch).placed(point);
            let (by, from) = at(pitch).seen();
            let seen = plus(times(&by, placed), from);
            (0..3).for_each(|k| approx::assert_relative_eq!(seen[k], point[k], epsilon = 1e-12));
        }
        // gravity is seen shorter, so that all is nearer and smaller, and its height above the ground less
        let placed = at(0.5).placed(MIDDLE);
        approx::assert_relative_eq!(placed[1], 0.2 + 0.9 * 0.9f64.cos() / 0.4f64.cos(), epsilon = 1e-12);
        // not beyond the vertical
        assert_eq!(at(1.5).scale, at(1.2).scale);
    }

    #[test]
    fn rates_are_derivatives() {
        let (point, step) = ([0.5, 0.9, -2.2], 1e-6);
        for pitch in [-0.3, 0.4] {
            let world = [0.1, 0.4, -1.8];
            let seen = |pitch| {
                let (by, from) = at(pitch).seen();
                plus(times(&by, world), from)
            };
            let difference =
                |of: &dyn Fn(f64) -> [f64; 3]| minus(of(pitch + step), of(pitch - step)).map(|x| x / (2.0 * step));
            let placed = difference(&|pitch| at(pitch).placed(point));
            let moved = difference(&seen);
            let (rate, seen_rate) = (at(pitch).rate(point), at(pitch).seen_rate(seen(pitch)));
            for k in 0..3 {
                approx::assert_relative_eq!(rate[k], placed[k], epsilon = 1e-8);
                approx::assert_relative_eq!(seen_rate[k], moved[k], epsilon = 1e-8);
            }
        }
    }
}
