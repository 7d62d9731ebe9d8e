//! Random position and size of an object: inside the cube and completely visible in every view (training data of
//! the paper).

use gradreel::Key;

use super::dice::Dice;
use crate::views::Ring;

/// Minimum distance of an object from the edge of a view, as a share of the image.
const EDGE: f64 = 4.0 / 256.0;
/// Number of positions tried before the object is shrunk.
const TRIES: usize = 60;

/// Scale and translation: `world = scale · object + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// The longest side of the object's box in units of the model.
    pub scale: f64,
    /// Centre of the box.
    pub shift: [f64; 3],
}

impl Placement {
    /// Draws a size from a range and a position: uniform over those that keep the object in the cube, multiplied by
    /// `reach` (0: centred), and such that the object's box is within the images of all cameras. If there is none,
    /// the object is shrunk.
    pub fn draw(key: Key, half: [f64; 3], ring: &Ring, scale: [f64; 2], reach: f64) -> Self {
        let mut dice = Dice::new(key);
        let mut scale = dice.within(scale[0], scale[1]);
        loop {
            for _ in 0..TRIES {
                let room = reach * (ring.half - 0.5 * scale).max(0.0);
                let found = Self { scale, shift: dice.three(-room, room) };
                if found.is_seen(half, ring) {
                    return found;
                }
                if reach == 0.0 {
                    break;
                }
            }
            scale *= 0.95;
        }
    }

    /// Whether a box with these half sides is within all images.
    pub fn is_seen(&self, half: [f64; 3], ring: &Ring) -> bool {
        let corner = |number: usize| -> [f64; 3] {
            std::array::from_fn(|axis| {
                let side = if number >> axis & 1 == 1 { half[axis] } else { -half[axis] };
                self.shift[axis] + self.scale * side
            })
        };
        (0..ring.views).all(|view| {
            let pose = ring.pose(view);
            (0..8).all(|number| {
                let [u, v, depth] = ring.project(&pose, corner(number), 1);
                depth > 0.0 && [u, v].iter().all(|x| (EDGE..=1.0 - EDGE).contains(x))
            })
        })
    }
}
