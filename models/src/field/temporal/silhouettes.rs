//! The mask that silhouettes give: what no frame shows the object in front of.

use gradreel::Result;
use rayon::prelude::*;

use super::batch::ClipRays;
use crate::field::{DenseGrid, Occupancy};
use crate::video::Frame;

/// Coverage from which a pixel belongs to the object.
const COVERED: f32 = 0.1;

/// Half a cube's diagonal over its edge.
const REACH: f64 = 0.866_025_403_784_438_6;

/// How many pixels of the object lie above and to the left of each pixel of a picture.
struct Counts {
    width: usize,
    height: usize,
    sums: Vec<u32>,
}

impl Counts {
    fn of(frame: &Frame) -> Self {
        let (height, width) = frame.alpha.dim();
        let mut sums = vec![0u32; (width + 1) * (height + 1)];
        for row in 0..height {
            let mut along = 0;
            for column in 0..width {
                // a pixel that is excluded may hide the object
                let object = frame.alpha[[row, column]] >= COVERED || frame.weight[[row, column]] < 0.5;
                along += u32::from(object);
                sums[(row + 1) * (width + 1) + column + 1] = sums[row * (width + 1) + column + 1] + along;
            }
        }
        Self { width, height, sums }
    }

    /// Whether the object is within `reach` pixels of a place; `None` where the picture does not show that.
    fn sees(&self, u: f64, v: f64, reach: f64) -> Option<bool> {
        let (width, height) = (self.width as f64, self.height as f64);
        if u + reach < 0.0 || v + reach < 0.0 || u - reach > width || v - reach > height {
            return None;
        }
        let cut = |x: f64, most: usize| (x.max(0.0) as usize).min(most);
        let (left, right) = (cut((u - reach).floor(), self.width), cut((u + reach).ceil(), self.width));
        let (top, bottom) = (cut((v - reach).floor(), self.height), cut((v + reach).ceil(), self.height));
        let at = |row: usize, column: usize| self.sums[row * (self.width + 1) + column];
        Some(at(bottom, right) + at(top, left) > at(top, right) + at(bottom, left))
    }
}

impl ClipRays<'_> {
    /// The nodes of a box \[m\] around which the object may be at some time: in some frame every real camera that sees the cube
    /// of the node sees the object there, and at least half of the imagined ones do. What is outside need not be looked at.
    ///
    /// # Errors
    /// When about `nodes` nodes do not fit the box.
    pub fn hull_mask(&self, low: [f64; 3], high: [f64; 3], nodes: usize) -> Result<Occupancy> {
        let grid = DenseGrid::of_count(low, high, nodes)?;
        let points = grid.nodes();
        let apart = grid.scale().map(|s| 1.0 / s).into_iter().fold(0.0, f64::max);
        let mut occupied = vec![false; points.len()];
        for frame in 0..self.times.len() {
            let counts: Vec<Counts> = self.clip.frames.par_iter().map(|frames| Counts::of(&frames[frame])).collect();
            let may_be = |x: &[f64; 3]| {
                let (mut for_it, mut against, mut seen) = (0, 0, false);
                for ((camera, counts), imagined) in self.clip.cameras.iter().zip(&counts).zip(&self.imagined) {
                    let Some([u, v, depth]) = camera.project(*x) else { continue };
                    let reach = REACH * apart * camera.fx.max(camera.fy) / depth + 1.0;
                    match counts.sees(u, v, reach) {
                        None => continue,
                        Some(false) if !imagined => return false,
                        Some(sees) if *imagined && sees => for_it += 1,
                        Some(_) if *imagined => against += 1,
                        Some(_) => {}
                    }
                    seen = true;
                }
                seen && for_it >= against
            };
            occupied.par_iter_mut().zip(&points).for_each(|(occupied, x)| *occupied = *occupied || may_be(x));
        }
        Ok(Occupancy { grid, occupied })
    }
}
