//! Imagined views derived from real ones, with the errors of synthesised views.

use gradreel::Key;
use ndarray::{Array2, Array3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::video::{Clip, Frame};

/// Deviation of imagined views from real ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Perturbation {
    /// Largest shift of an image \[pixels\]: half of it constant over the frames of a view, half redrawn in each frame.
    pub shift: f64,
    /// Largest relative change of a colour channel, constant over the frames of a view.
    pub tint: f64,
    /// Seed; the same seed gives the same views.
    pub seed: u64,
}

impl Default for Perturbation {
    fn default() -> Self {
        Self { shift: 3.0, tint: 0.2, seed: 1 }
    }
}

impl Perturbation {
    /// The clip with all views except `primary` perturbed and marked as imagined.
    ///
    /// # Panics
    /// When `primary` is out of range.
    #[must_use]
    pub fn of(&self, clip: &Clip, primary: usize) -> Clip {
        assert!(primary < clip.cameras.len(), "view {primary} of {}", clip.cameras.len());
        let view = |(position, frames): (usize, &Vec<Frame>)| {
            if position == primary {
                return frames.clone();
            }
            let [view, pictures] = Key::new(self.seed).fold(clip.cameras[position].id as u64).split();
            let drawn: Vec<f64> = view.uniform(4).collect();
            let lasting = polar(0.5 * self.shift, drawn[0]);
            let gains = [1, 2, 3].map(|c| 1.0 + self.tint * (2.0 * drawn[c] - 1.0));
            let picture = |(number, frame): (usize, &Frame)| {
                let drawn: Vec<f64> = pictures.fold(number as u64).uniform(2).collect();
                let passing = polar(0.5 * self.shift * drawn[0].sqrt(), drawn[1]);
                tinted(&shifted(frame, [lasting[0] + passing[0], lasting[1] + passing[1]]), gains)
            };
            frames.iter().enumerate().map(picture).collect()
        };
        Clip {
            frames: clip.frames.par_iter().enumerate().map(view).collect(),
            imagined: (0..clip.cameras.len()).map(|position| position != primary).collect(),
            ..clip.clone()
        }
    }
}

fn polar(length: f64, turn: f64) -> [f64; 2] {
    let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
    [length * cos, length * sin]
}

/// The image shifted to the right and down by some pixels, bilinear; white and empty where there is no source.
fn shifted(frame: &Frame, [right, down]: [f64; 2]) -> Frame {
    let (height, width) = frame.alpha.dim();
    let (whole, part) = ([right, down].map(f64::floor), [right - right.floor(), down - down.floor()]);
    // four neighbours with their weights; `None` outside the image
    let corners = |row: usize, column: usize| {
        [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(below, beside): (i64, i64)| {
            let weight = [(part[1], below), (part[0], beside)].map(|(p, one)| if one == 1 { p } else { 1.0 - p });
            let at = (row as i64 - whole[1] as i64 - below, column as i64 - whole[0] as i64 - beside);
            let inside = (0..height as i64).contains(&at.0) && (0..width as i64).contains(&at.1);
            ((weight[0] * weight[1]) as f32, inside.then_some((at.0 as usize, at.1 as usize)))
        })
    };
    let mixed = |row: usize, column: usize, beyond: f32, value: &dyn Fn((usize, usize)) -> f32| {
        corners(row, column).iter().map(|(weight, at)| weight * at.map_or(beyond, value)).sum::<f32>()
    };
    Frame {
        rgb: Array3::from_shape_fn((height, width, 3), |(y, x, c)| mixed(y, x, 1.0, &|(r, q)| frame.rgb[[r, q, c]])),
        alpha: Array2::from_shape_fn((height, width), |(y, x)| mixed(y, x, 0.0, &|at| frame.alpha[at])),
        weight: Array2::from_shape_fn((height, width), |(y, x)| mixed(y, x, 1.0, &|at| frame.weight[at])),
    }
}

/// The image with the object's colours multiplied by gains.
fn tinted(frame: &Frame, gains: [f64; 3]) -> Frame {
    let colour = |(y, x, c): (usize, usize, usize)| {
        let alpha = frame.alpha[[y, x]];
        // the object is over white
        let object = frame.rgb[[y, x, c]] - (1.0 - alpha);
        (object * gains[c] as f32).clamp(0.0, alpha.max(0.0)) + (1.0 - alpha)
    };
    Frame { rgb: Array3::from_shape_fn(frame.rgb.dim(), colour), ..frame.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot() -> Frame {
        let on = |y: usize, x: usize| f32::from(u8::from(y == 3 && x == 4));
        Frame {
            rgb: Array3::from_shape_fn((8, 9, 3), |(y, x, c)| 1.0 - on(y, x) * 0.25 * (c + 1) as f32),
            alpha: Array2::from_shape_fn((8, 9), |(y, x)| on(y, x)),
            weight: Array2::ones((8, 9)),
        }
    }

    #[test]
    fn a_shift_moves_the_middle_by_itself() {
        let moved = shifted(&dot(), [1.25, -0.5]);
        let sum: f32 = moved.alpha.sum();
        let middle =
            moved.alpha.indexed_iter().fold([0.0; 2], |m, ((y, x), a)| [m[0] + a * x as f32, m[1] + a * y as f32]);
        assert!((sum - 1.0).abs() < 1e-6);
        assert!((middle[0] - 5.25).abs() < 1e-6 && (middle[1] - 2.5).abs() < 1e-6, "{middle:?}");
        // still over white: uncovered pixels are white
        for ((y, x), alpha) in moved.alpha.indexed_iter() {
            for c in 0..3 {
                let white = 1.0 - 0.25 * (c + 1) as f32 * alpha;
                assert!((moved.rgb[[y, x, c]] - white).abs() < 1e-6);
            }
        }
        assert_eq!(shifted(&dot(), [0.0, 0.0]), dot());
        assert_eq!(shifted(&dot(), [-20.0, 0.0]).alpha.sum(), 0.0);
    }

    #[test]
    fn a_tint_changes_the_object_alone() {
        let other = tinted(&dot(), [0.5, 1.0, 2.0]);
        assert_eq!(other.rgb[[0, 0, 0]], 1.0);
        assert_eq!([0, 1, 2].map(|c| other.rgb[[3, 4, c]]), [0.375, 0.5, 0.5]);
        assert_eq!(other.alpha, dot().alpha);
    }
}
