//! Surface colours of a body: two per part, in a pattern.

use gradreel::Key;

use super::dice::Dice;
use crate::vector::dot;

/// The texture of a body.
pub(super) struct Texture {
    /// Colours of each part.
    colours: Vec<[[f64; 3]; 2]>,
    pattern: Pattern,
    direction: [f64; 3],
    /// Spatial frequency in radians per unit.
    waves: f64,
}

enum Pattern {
    Plain,
    Stripes,
    Checks,
    Spots,
    Fade,
    Marble,
}

impl Texture {
    pub fn new(key: Key, parts: usize) -> Self {
        let mut dice = Dice::new(key);
        let pattern = match dice.below(9) {
            0..=2 => Pattern::Plain,
            3 => Pattern::Stripes,
            4 => Pattern::Checks,
            5 => Pattern::Spots,
            6 | 7 => Pattern::Fade,
            _ => Pattern::Marble,
        };
        let same = dice.chance(0.4).then(|| [colour(&mut dice), colour(&mut dice)]);
        let colours = (0..parts).map(|_| same.unwrap_or_else(|| [colour(&mut dice), colour(&mut dice)])).collect();
        Self { colours, pattern, direction: dice.direction(), waves: dice.within(6.0, 16.0) }
    }

    /// Colour of a part at a point of the undeformed space.
    pub fn colour(&self, part: usize, x: [f64; 3]) -> [f64; 3] {
        let wave = |axis: usize| (self.waves * x[axis]).sin();
        let along = dot(self.direction, x);
        let second = match self.pattern {
            Pattern::Plain => 0.0,
            Pattern::Stripes => f64::from(u8::from((self.waves * along).sin() > 0.2)),
            Pattern::Checks => f64::from(u8::from(wave(0) * wave(1) * wave(2) > 0.0)),
            Pattern::Spots => f64::from(u8::from(wave(0) + wave(1) + wave(2) > 1.2)),
            Pattern::Fade => (0.5 + along).clamp(0.0, 1.0),
            Pattern::Marble => 0.5 + 0.5 * (self.waves * along + 2.0 * (wave(0) + wave(1))).sin(),
        };
        let [a, b] = self.colours[part];
        std::array::from_fn(|c| a[c] + second * (b[c] - a[c]))
    }
}

/// A colour that differs from the white background.
fn colour(dice: &mut Dice) -> [f64; 3] {
    let (hue, saturation, value) = (dice.within(0.0, 6.0), dice.within(0.3, 1.0), dice.within(0.2, 0.9));
    let channel = |shift: f64| {
        let ramp = ((hue + shift).rem_euclid(6.0) - 3.0).abs() - 1.0;
        value * (1.0 - saturation * (1.0 - ramp.clamp(0.0, 1.0)))
    };
    [channel(0.0), channel(4.0), channel(2.0)]
}
