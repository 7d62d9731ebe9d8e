//! Where a random camera stands: attitude, distance, and the window that is its picture.

use super::Solid;
use crate::vector::product;
use crate::views::objects::Dice;

/// Which attitudes are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attitude {
    /// Upright, seen from a pitch of −10° to 60°.
    Upright,
    /// Uniform over all.
    Free,
}

/// Range of the pitch of upright solids \[°\], and the deviation of the camera's roll \[rad\].
const PITCH_DEG: [f64; 2] = [-10.0, 60.0];
const ROLL: f64 = 0.07;
/// Range of the distance in reaches of the solid, uniform in its logarithm.
const DISTANCE: [f64; 2] = [2.0, 6.0];
/// Range of the share of the picture's side that the solid's longer side fills.
const FILL: [f64; 2] = [0.6, 0.85];
/// Share of the free border by which the solid lies off the middle.
const OFF: f64 = 0.4;

/// A solid in a camera's frame (x right, y down, z away), and the window of the picture.
pub(super) struct Scene {
    pub corners: Vec<[f32; 3]>,
    /// The direction that was up, in the camera's frame.
    pub up: [f32; 3],
    /// Centre of the window at the distance 1, and the side of a pixel there.
    pub centre: [f32; 2],
    pub pixel: f32,
}

/// Random changes of the solid itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stretch {
    None,
    /// Half of the solids, by some 20 % along each axis.
    Random,
}

impl Scene {
    /// Turns the solid, puts it before the camera and frames it in a picture of `size` pixels.
    pub fn draw(solid: &Solid, attitude: Attitude, stretch: Stretch, size: usize, dice: &mut Dice) -> Self {
        let turn = match attitude {
            Attitude::Upright => {
                let roll = if stretch == Stretch::Random { ROLL * dice.normal() } else { 0.0 };
                upright(
                    dice.within(0.0, std::f64::consts::TAU),
                    dice.within(PITCH_DEG[0], PITCH_DEG[1]).to_radians(),
                    roll,
                )
            }
            Attitude::Free => dice.turn(),
        };
        let stretched = stretch == Stretch::Random && dice.chance(0.5);
        let factors = [0; 3].map(|_| if stretched { (0.2 * dice.normal()).exp() } else { 1.0 });
        let reach = match stretched {
            true => solid
                .corners()
                .iter()
                .map(|c| (0..3).map(|k| (f64::from(c[k]) * factors[k]).powi(2)).sum())
                .fold(0.0, f64::max)
                .sqrt(),
            false => f64::from(solid.reach()),
        };
        let distance = reach * dice.within(DISTANCE[0].ln(), DISTANCE[1].ln()).exp();
        let m: [[f32; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| (turn[i][j] * factors[j]) as f32));
        let corners: Vec<[f32; 3]> = solid
            .corners()
            .iter()
            .map(|c| {
                let row = |i: usize| m[i][0] * c[0] + m[i][1] * c[1] + m[i][2] * c[2];
                [row(0), row(1), row(2) + distance as f32]
            })
            .collect();
        let [mut low, mut high] = [[f32::INFINITY; 2], [f32::NEG_INFINITY; 2]];
        for &[x, y, z] in &corners {
            for (axis, place) in [x / z, y / z].into_iter().enumerate() {
                low[axis] = low[axis].min(place);
                high[axis] = high[axis].max(place);
            }
        }
        let side = (high[0] - low[0]).max(high[1] - low[1]) + 1e-6;
        let fill = dice.within(FILL[0], FILL[1]);
        let pixel = side / (fill * size as f64) as f32;
        let off = (1.0 - fill) * OFF * size as f64 * f64::from(pixel);
        let centre = [0, 1].map(|axis| 0.5 * (low[axis] + high[axis]) + dice.within(-off, off) as f32);
        // a free solid has no up: light comes from the camera's
        let up = match attitude {
            Attitude::Upright => [0, 1, 2].map(|i| turn[i][1] as f32),
            Attitude::Free => [0.0, -1.0, 0.0],
        };
        Self { corners, up, centre, pixel }
    }
}

/// From axes with y up to those of a camera that looks down by `pitch` at a solid turned by `yaw` about the vertical.
fn upright(yaw: f64, pitch: f64, roll: f64) -> [[f64; 3]; 3] {
    let [(sy, cy), (sp, cp), (sr, cr)] = [yaw, pitch, roll].map(f64::sin_cos);
    let about = [[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]];
    let down = [[1.0, 0.0, 0.0], [0.0, -cp, sp], [0.0, -sp, -cp]];
    let rolled = [[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]];
    product(rolled, product(down, about))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::testing::boxed;
    use crate::vector::{dot, times};
    use gradreel::Key;

    /// A camera that looks down sees the upper side of what lies before it: up is up in the picture, and towards the camera.
    #[test]
    fn an_upright_solid_stays_so() {
        let turn = upright(0.7, 0.5, 0.0);
        let up = times(&turn, [0.0, 1.0, 0.0]);
        assert!((up[1] + 0.5f64.cos()).abs() < 1e-12 && (up[2] + 0.5f64.sin()).abs() < 1e-12 && up[0].abs() < 1e-12);
        // a rotation, not a mirror
        let [a, b, c] = turn;
        assert!((dot(a, crate::vector::cross(b, c)) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_window_holds_the_solid() {
        let solid = boxed([0.5, 0.2, 0.3]);
        for number in 0..200 {
            let mut dice = Dice::new(Key::new(number));
            let attitude = if number % 2 == 0 { Attitude::Upright } else { Attitude::Free };
            let scene = Scene::draw(&solid, attitude, Stretch::Random, 64, &mut dice);
            for [x, y, z] in scene.corners {
                assert!(z > 0.0);
                for (at, centre) in [x / z, y / z].into_iter().zip(scene.centre) {
                    let pixel = (at - centre) / scene.pixel + 32.0;
                    assert!((1.0..63.0).contains(&pixel), "{pixel}");
                }
            }
        }
    }
}
