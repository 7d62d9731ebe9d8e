//! The visual hull over all frames, as an occupancy mask.

use gradreel::Result;
use rayon::prelude::*;

use super::batch::ClipRays;
use crate::field::{DenseGrid, Occupancy};
use crate::vector::plus;
use crate::video::Frame;

/// Coverage above which a pixel belongs to the object.
const COVERED: f32 = 0.1;

/// Half the space diagonal of a unit cube.
const REACH: f64 = 0.866_025_403_784_438_6;

/// A summed-area table: the number of object pixels above and to the left of each pixel.
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
                // an excluded pixel may hide the object
                let object = frame.alpha[[row, column]] >= COVERED || frame.weight[[row, column]] < 0.5;
                along += u32::from(object);
                sums[(row + 1) * (width + 1) + column + 1] = sums[row * (width + 1) + column + 1] + along;
            }
        }
        Self { width, height, sums }
    }

    /// Whether there is object within `reach` pixels of an image point; `None` outside of the image.
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
    /// The nodes of a box \[m\] where the object may be at any time: in some frame, every real camera that has the
    /// node's cube in its image sees object there, and so do at least half of the imagined cameras.
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
            let offset = self.offsets[frame];
            let may_be = |x: &[f64; 3]| {
                let (mut for_it, mut against, mut seen) = (0, 0, false);
                for ((camera, counts), imagined) in self.clip.cameras.iter().zip(&counts).zip(&self.imagined) {
                    let Some([u, v, depth]) = camera.project(plus(*x, offset)) else { continue };
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
