//! Bodies: a few solids, joined, carved, mirrored and bent.

use gradreel::Key;

use super::dice::Dice;
use super::solid::{Solid, joined};
use crate::vector::{minus, plus, product, rotation, times};

type Matrix = [[f64; 3]; 3];

/// A placed solid.
struct Part {
    solid: Solid,
    /// Rotation from the body's axes to the solid's.
    turn: Matrix,
    centre: [f64; 3],
}

impl Part {
    fn distance(&self, x: [f64; 3]) -> f64 {
        self.solid.distance(times(&self.turn, minus(x, self.centre)))
    }
}

/// A union of solids.
pub(crate) struct Body {
    parts: Vec<Part>,
    /// The solid that is subtracted.
    carved: Option<Part>,
    /// Width of the fillets.
    fillet: f64,
    /// Whether it is symmetric in x.
    mirrored: bool,
    /// Twist per unit of height, relative taper per unit of height, bending, amplitude of waves.
    bends: [f64; 4],
    /// Rotation from the world's axes to the body's.
    turn: Matrix,
}

/// Half the side of a cube that contains every body.
pub(super) const CUBE: f64 = 2.4;

impl Body {
    /// A body from a key.
    pub fn new(key: Key) -> Self {
        let mut dice = Dice::new(key);
        let (first, count) = match dice.below(10) {
            0 => (Solid::letter(&mut dice), 1),
            1 => (Solid::blob(&mut dice), 1),
            2 | 3 => (Solid::draw(&mut dice), 1),
            4..=6 => (Solid::draw(&mut dice), 2),
            7 | 8 => (Solid::draw(&mut dice), 3),
            _ => (Solid::draw(&mut dice), 4),
        };
        let mut parts = vec![Part { solid: first, turn: any_turn(&mut dice), centre: [0.0; 3] }];
        while parts.len() < count {
            let (solid, on) = (Solid::draw(&mut dice), &parts[dice.below(parts.len())]);
            parts.push(beside(on, solid, &mut dice));
        }
        let carved = dice.chance(0.15).then(|| Part {
            solid: Solid::Cylinder { radius: dice.within(0.08, 0.2), half: 3.0, round: 0.0 },
            turn: any_turn(&mut dice),
            centre: dice.three(-0.15, 0.15),
        });
        let mut bends = [0.0; 4];
        for (bend, most) in bends.iter_mut().zip([1.2, 0.45, 0.5, 0.06]) {
            if dice.chance(0.3) {
                *bend = dice.within(-most, most);
            }
        }
        // mostly upright
        let upright = rotation([0.0, 0.0, dice.within(0.0, std::f64::consts::TAU)]);
        let tilt = if dice.chance(0.4) { any_turn(&mut dice) } else { rotation(dice.three(-0.2, 0.2)) };
        Self {
            parts,
            carved,
            fillet: dice.within(0.02, 0.2),
            mirrored: dice.chance(0.3),
            bends,
            turn: product(tilt, upright),
        }
    }

    /// A body of so many parts, turned uniformly over all attitudes; the first part of a thin one is a plate or a ring.
    pub fn of_parts(key: Key, count: usize, thin: bool) -> Self {
        let mut dice = Dice::new(key);
        let first = if thin { Solid::thin(&mut dice) } else { Solid::draw(&mut dice) };
        let mut parts = vec![Part { solid: first, turn: any_turn(&mut dice), centre: [0.0; 3] }];
        while parts.len() < count {
            let (solid, on) = (Solid::draw(&mut dice), &parts[dice.below(parts.len())]);
            parts.push(beside(on, solid, &mut dice));
        }
        let fillet = dice.within(0.02, 0.2);
        Self { parts, carved: None, fillet, mirrored: false, bends: [0.0; 4], turn: dice.turn() }
    }

    /// Number of parts.
    pub fn parts(&self) -> usize {
        self.parts.len()
    }

    /// Maps a world point to the body's undeformed space.
    pub fn inside(&self, x: [f64; 3]) -> [f64; 3] {
        let [mut x, mut y, mut z] = times(&self.turn, x);
        let [twist, taper, bend, wave] = self.bends;
        if bend != 0.0 {
            let (sin, cos) = (bend * z).sin_cos();
            (x, z) = (cos * x - sin * z, sin * x + cos * z);
        }
        if twist != 0.0 {
            let (sin, cos) = (twist * z).sin_cos();
            (x, y) = (cos * x - sin * y, sin * x + cos * y);
        }
        if taper != 0.0 {
            let wide = 1.0 / (1.0 + taper * z).clamp(0.4, 2.5);
            (x, y) = (x * wide, y * wide);
        }
        if wave != 0.0 {
            x += wave * (7.0 * z).sin();
            z += wave * (6.0 * y).sin();
        }
        [if self.mirrored { x.abs() } else { x }, y, z]
    }

    /// Approximate signed distance of a world point, negative inside.
    pub fn distance(&self, x: [f64; 3]) -> f64 {
        let x = self.inside(x);
        let each = self.parts.iter().map(|part| part.distance(x));
        let whole = each.fold(f64::INFINITY, |sum, distance| joined(sum, distance, self.fillet));
        self.carved.as_ref().map_or(whole, |part| whole.max(-part.distance(x)))
    }

    /// Index of the part that contains a point of the undeformed space.
    pub fn part_at(&self, x: [f64; 3]) -> usize {
        let each = self.parts.iter().map(|part| part.distance(x)).enumerate();
        each.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(part, _)| part)
    }
}

/// A solid near enough to a part to overlap it.
fn beside(on: &Part, solid: Solid, dice: &mut Dice) -> Part {
    let far = 0.75 * (on.solid.reach() + solid.reach());
    let centre = plus(on.centre, dice.direction().map(|d| d * far));
    let centre = centre.map(|x| x.clamp(-0.9, 0.9));
    Part { solid, turn: any_turn(dice), centre }
}

fn any_turn(dice: &mut Dice) -> Matrix {
    let angle = dice.within(0.0, std::f64::consts::PI);
    rotation(dice.direction().map(|d| d * angle))
}
