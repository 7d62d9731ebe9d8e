//! Floor, wall and lamp of a scene that is filmed with what is around it.

use gradreel::Key;

use crate::vector::dot;
use crate::views::objects::Dice;

/// What stands behind and under a body: a floor at height 0 with a grainy pattern, and a wall far away.
pub(crate) struct Paint {
    floor: [[f64; 3]; 2],
    wall: [[f64; 3]; 2],
    waves: [f64; 4],
    grain: u64,
    /// Towards the lamp, of length 1.
    pub lamp: [f64; 3],
    /// Share of the light that comes from everywhere.
    pub everywhere: f64,
}

impl Paint {
    pub fn draw(key: Key) -> Self {
        let mut dice = Dice::new(key);
        let mut shade = |low: f64, high: f64| {
            let grey = dice.within(low, high);
            [0; 3].map(|_| (grey + dice.within(-0.06, 0.06)).clamp(0.02, 0.98))
        };
        let floor = [shade(0.25, 0.8), shade(0.25, 0.8)];
        let wall = [shade(0.3, 0.9), shade(0.3, 0.9)];
        let waves = [0; 4].map(|_| dice.within(2.0, 12.0));
        let direction = dice.direction();
        let lamp = [0.6 * direction[0], 0.8 + 0.4 * direction[1].abs(), 0.6 * direction[2]];
        let length = dot(lamp, lamp).sqrt();
        let grain = dice.below(1 << 30) as u64;
        Self { floor, wall, waves, grain, lamp: lamp.map(|x| x / length), everywhere: dice.within(0.55, 0.8) }
    }

    /// Brightness of a surface with this normal; less of it in shadow.
    pub fn light(&self, normal: [f64; 3], shadow: bool) -> f64 {
        let direct = if shadow { 0.0 } else { dot(normal, self.lamp).max(0.0) };
        self.everywhere + (1.0 - self.everywhere) * direct
    }

    /// Where a ray meets the floor, if it does.
    pub fn foot(origin: [f64; 3], along: [f64; 3]) -> Option<[f64; 3]> {
        let t = -origin[1] / along[1];
        (t > 0.0 && t.is_finite()).then(|| std::array::from_fn(|axis| origin[axis] + t * along[axis]))
    }

    /// The colour of the floor at a place, fully lit.
    pub fn floor(&self, place: [f64; 3]) -> [f64; 3] {
        let [a, b, c, d] = self.waves;
        let wave =
            0.5 + 0.25 * (a * place[0] + (b * place[2]).sin()).sin() + 0.25 * (c * place[2] - d * place[0]).sin();
        let cell = [place[0], place[2]].map(|x| (x / 0.02).floor() as i64);
        let grain = 0.08 * (self.noise(cell) - 0.5);
        std::array::from_fn(|k| self.floor[0][k] + wave * (self.floor[1][k] - self.floor[0][k]) + grain)
    }

    /// The same lit by the lamp, or in shadow.
    pub fn lit_floor(&self, place: [f64; 3], shadow: bool) -> [f64; 3] {
        let light = self.light([0.0, 1.0, 0.0], shadow);
        self.floor(place).map(|c| light * c)
    }

    /// The colour of the wall in a direction.
    pub fn wall(&self, along: [f64; 3]) -> [f64; 3] {
        let around = along[0].atan2(along[2]);
        let up = along[1] / dot(along, along).sqrt();
        let wave = (0.5 + 0.3 * (3.0 * around + self.waves[0]).sin() + 0.4 * up).clamp(0.0, 1.0);
        std::array::from_fn(|k| self.wall[0][k] + wave * (self.wall[1][k] - self.wall[0][k]))
    }

    /// A number from 0 to 1 that belongs to a cell of the floor.
    fn noise(&self, [x, z]: [i64; 2]) -> f64 {
        let mut h = self.grain
            ^ (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
            ^ (z as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
        h = (h ^ (h >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((h ^ (h >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// The noise of a sensor: standard deviation in bytes.
    pub const NOISE: f64 = 1.0;

    /// Some numbers of that noise.
    pub fn grain(key: Key, count: usize) -> impl Iterator<Item = f64> {
        key.normal(count).map(|z| Self::NOISE * z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_colours_and_shadows_are_dark() {
        let paint = Paint::draw(Key::new(5));
        for along in (0..40).map(|k| [f64::from(k).sin(), 0.1, f64::from(k).cos()]) {
            assert!(paint.wall(along).iter().all(|c| (0.0..=1.0).contains(c)));
            assert!(paint.floor(along.map(|x| 3.0 * x)).iter().all(|c| (-0.05..=1.05).contains(c)));
        }
        assert!(paint.light([0.0, 1.0, 0.0], true) < paint.light([0.0, 1.0, 0.0], false));
        assert_eq!(Paint::foot([0.0, 2.0, 0.0], [1.0, -1.0, 0.0]), Some([2.0, 0.0, 0.0]));
        assert_eq!(Paint::foot([0.0, 2.0, 0.0], [1.0, 1.0, 0.0]), None);
    }
}
