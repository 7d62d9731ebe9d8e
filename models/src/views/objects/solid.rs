//! Implicit solids: approximate signed distances, negative inside.

use super::dice::Dice;
use crate::vector::{dot, minus};

/// A solid around the origin, of about unit size.
pub(super) enum Solid {
    /// `((|x/a|^(2/e₂) + |y/b|^(2/e₂))^(e₂/e₁) + |z/c|^(2/e₁)) = 1` (Barr 1981): from boxes and ellipsoids to
    /// octahedra.
    Superquadric { radii: [f64; 3], exponents: [f64; 2] },
    /// A box with rounded edges.
    Box { half: [f64; 3], round: f64 },
    /// A torus around z.
    Torus { ring: f64, tube: f64 },
    /// Along z, with rounded edges.
    Cylinder { radius: f64, half: f64, round: f64 },
    /// A letter in the plane of x and z.
    Letter { rows: [u8; 7], depth: f64 },
    /// Blended balls.
    Blob { balls: Vec<([f64; 3], f64)> },
}

/// Glyphs of five columns and seven rows, from the top row; the left column is the highest bit.
const LETTERS: [[u8; 7]; 14] = [
    [14, 17, 17, 31, 17, 17, 17],
    [30, 17, 17, 30, 17, 17, 30],
    [15, 16, 16, 16, 16, 16, 15],
    [31, 16, 16, 30, 16, 16, 31],
    [31, 16, 16, 30, 16, 16, 16],
    [17, 17, 17, 31, 17, 17, 17],
    [17, 18, 20, 24, 20, 18, 17],
    [16, 16, 16, 16, 16, 16, 31],
    [30, 17, 17, 30, 16, 16, 16],
    [30, 17, 17, 30, 20, 18, 17],
    [15, 16, 16, 14, 1, 1, 30],
    [31, 4, 4, 4, 4, 4, 4],
    [17, 10, 10, 4, 10, 10, 17],
    [31, 1, 2, 4, 8, 16, 31],
];
/// Side of a glyph cell.
const CELL: f64 = 0.2;

impl Solid {
    /// Draws a random solid.
    pub fn draw(dice: &mut Dice) -> Self {
        match dice.below(12) {
            0..=3 => {
                let exponents = [0; 2].map(|_| dice.within(0.3, 1.7));
                Self::Superquadric { radii: dice.three(0.25, 0.6), exponents }
            }
            4 | 5 => {
                let half = dice.three(0.15, 0.5);
                let least = half.into_iter().fold(f64::INFINITY, f64::min);
                Self::Box { half, round: least * dice.within(0.05, 0.8) }
            }
            6 | 7 => {
                let ring = dice.within(0.35, 0.5);
                Self::Torus { ring, tube: ring * dice.within(0.25, 0.6) }
            }
            8 | 9 => {
                let (radius, half) = (dice.within(0.15, 0.45), dice.within(0.15, 0.6));
                Self::Cylinder { radius, half, round: radius.min(half) * dice.within(0.05, 0.7) }
            }
            10 => Self::letter(dice),
            _ => Self::blob(dice),
        }
    }

    /// A plate or a ring, as thin as a few particles.
    pub fn thin(dice: &mut Dice) -> Self {
        if dice.chance(0.5) {
            let half = [0.5, dice.within(0.3, 0.5), dice.within(0.06, 0.09)];
            return Self::Box { half, round: 0.3 * half[2] };
        }
        Self::Torus { ring: dice.within(0.38, 0.45), tube: dice.within(0.06, 0.1) }
    }

    /// A letter.
    pub fn letter(dice: &mut Dice) -> Self {
        Self::Letter { rows: LETTERS[dice.below(LETTERS.len())], depth: dice.within(0.12, 0.3) }
    }

    /// A blob.
    pub fn blob(dice: &mut Dice) -> Self {
        let ball = |dice: &mut Dice| (dice.three(-0.3, 0.3), dice.within(0.15, 0.4));
        let count = 3 + dice.below(4);
        Self::Blob { balls: (0..count).map(|_| ball(dice)).collect() }
    }

    /// Approximate radius.
    pub fn reach(&self) -> f64 {
        match self {
            Self::Superquadric { radii, .. } => radii.iter().sum::<f64>() / 3.0,
            Self::Box { half, .. } => half.iter().sum::<f64>() / 3.0,
            Self::Torus { ring, tube } => ring + tube,
            Self::Cylinder { radius, half, .. } => 0.5 * (radius + half),
            Self::Letter { .. } | Self::Blob { .. } => 0.5,
        }
    }

    /// Approximate signed distance of a point to the surface, negative inside.
    pub fn distance(&self, x: [f64; 3]) -> f64 {
        match self {
            Self::Superquadric { radii, exponents: [e1, e2] } => {
                let away = dot(x, x).sqrt();
                let least = radii.iter().copied().fold(f64::INFINITY, f64::min);
                let [a, b, c] = [0, 1, 2].map(|axis| (x[axis] / radii[axis]).abs());
                let form = (a.powf(2.0 / e2) + b.powf(2.0 / e2)).powf(e2 / e1) + c.powf(2.0 / e1);
                if form < 1e-12 { -least } else { (away * (1.0 - form.powf(-0.5 * e1))).max(-least) }
            }
            Self::Box { half, round } => boxed(&x, half, *round),
            Self::Torus { ring, tube } => (x[0].hypot(x[1]) - ring).hypot(x[2]) - tube,
            Self::Cylinder { radius, half, round } => boxed(&[x[0].hypot(x[1]), x[2]], &[*radius, *half], *round),
            Self::Letter { rows, depth } => {
                let mut flat = f64::INFINITY;
                for (row, bits) in rows.iter().enumerate() {
                    for column in (0..5).filter(|column| bits >> (4 - column) & 1 == 1) {
                        let at = [x[0] - CELL * (column as f64 - 2.0), x[2] - CELL * (3.0 - row as f64)];
                        flat = flat.min(boxed(&at, &[0.55 * CELL; 2], 0.0));
                    }
                }
                let ends = x[1].abs() - depth;
                flat.max(0.0).hypot(ends.max(0.0)) + flat.max(ends).min(0.0)
            }
            Self::Blob { balls } => {
                let each = balls.iter().map(|(centre, radius)| {
                    let away = minus(x, *centre);
                    dot(away, away).sqrt() - radius
                });
                each.fold(f64::INFINITY, |sum, distance| joined(sum, distance, 0.15))
            }
        }
    }
}

/// Signed distance to a rounded box in any number of dimensions.
fn boxed<const N: usize>(x: &[f64; N], half: &[f64; N], round: f64) -> f64 {
    let (mut outside, mut inside) = (0.0, f64::NEG_INFINITY);
    for axis in 0..N {
        let beyond = x[axis].abs() - (half[axis] - round);
        outside += beyond.max(0.0) * beyond.max(0.0);
        inside = inside.max(beyond);
    }
    outside.sqrt() + inside.min(0.0) - round
}

/// The union of two solids with a fillet of this width.
pub(super) fn joined(a: f64, b: f64, width: f64) -> f64 {
    if !a.is_finite() {
        return b;
    }
    let near = (width - (a - b).abs()).max(0.0) / width;
    a.min(b) - 0.25 * width * near * near
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Closed-form surfaces, and distances that are safe for ray marching.
    #[test]
    fn surfaces_are_where_they_should_be() {
        let ball = Solid::Superquadric { radii: [0.5; 3], exponents: [1.0; 2] };
        let bar = Solid::Box { half: [0.2, 0.3, 0.4], round: 0.1 };
        let ring = Solid::Torus { ring: 0.4, tube: 0.1 };
        let tin = Solid::Cylinder { radius: 0.3, half: 0.2, round: 0.05 };
        let letter = Solid::Letter { rows: LETTERS[11], depth: 0.2 };
        for (solid, x, distance) in [
            (&ball, [0.8, 0.0, 0.0], 0.3),
            (&ball, [0.0, 0.3, 0.4], 0.0),
            (&bar, [0.5, 0.1, -0.2], 0.3),
            (&bar, [0.0, 0.0, 0.0], -0.2),
            (&bar, [0.2 + 0.3, 0.3 + 0.4, 0.0], 0.4f64.hypot(0.5) - 0.1),
            (&ring, [0.0, 0.4, 0.3], 0.2),
            (&ring, [0.0, 0.0, 0.0], 0.3),
            (&tin, [0.0, 0.0, 0.7], 0.5),
            (&tin, [0.5, 0.0, 0.0], 0.2),
            // the base of a T, its empty corner and its face
            (&letter, [0.0, 0.0, -0.6 - 0.11 - 0.3], 0.3),
            (&letter, [0.0, 0.5, 0.0], 0.3),
        ] {
            let found = solid.distance(x);
            assert!((found - distance).abs() < 1e-9, "{x:?}: {found}, not {distance}");
        }
        assert!(letter.distance([0.4, 0.0, -0.6]) > 0.2 && letter.distance([0.4, 0.0, 0.6]) < 0.0);
        // a superquadric with small exponents is nearly a box
        let nearly = Solid::Superquadric { radii: [0.5; 3], exponents: [0.05; 2] };
        assert!(nearly.distance([0.47, 0.47, 0.47]) < 0.0 && nearly.distance([0.52, 0.0, 0.0]) > 0.0);
    }

    #[test]
    fn unions_are_filled_where_they_meet() {
        assert_eq!(joined(f64::INFINITY, 0.3, 0.1), 0.3);
        assert_eq!(joined(0.1, 0.5, 0.2), 0.1);
        assert!((joined(0.2, 0.2, 0.2) - 0.15).abs() < 1e-12);
    }
}
