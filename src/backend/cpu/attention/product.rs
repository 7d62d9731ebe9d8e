//! Small matrix products over panels in cache: what attention does between its softmaxes.
//!
//! Elements of the left operand are broadcast from wherever they lie, so that keys and values are read in place, as they
//! are or transposed. Rows of the right operand and of the result are vectors.

// plain loops: iterator adaptors would lose the instruction set
#![allow(clippy::needless_range_loop)]

use crate::backend::cpu::vectorised;
use crate::scalar::{Job, Lane, Real};

/// What the sums start from.
#[derive(Clone, Copy)]
pub(super) enum Start<'a, T> {
    /// Nothing.
    Zero,
    /// What the result holds.
    Result,
    /// What the result holds times a factor for each column.
    Scaled(&'a [T]),
}

/// A panel read element by element: element `(row, depth)` lies at `row · row_step + depth · depth_step`.
#[derive(Clone, Copy)]
pub(super) struct Left<'a, T> {
    pub values: &'a [T],
    pub row_step: usize,
    pub depth_step: usize,
}

/// `result[row][column] = start + Σ_depth left(row, depth) · right[depth][column]`; both panels have `columns` columns, a
/// multiple of 16.
pub(super) struct Product<'a, T> {
    pub rows: usize,
    pub depth: usize,
    pub columns: usize,
    pub left: Left<'a, T>,
    pub right: &'a [T],
    pub result: &'a mut [T],
    pub start: Start<'a, T>,
}

impl<T: Real> Product<'_, T> {
    /// Checks that the panels hold what will be read, and multiplies.
    pub(super) fn run(self) {
        if self.rows == 0 {
            return;
        }
        assert_eq!(self.columns % 16, 0, "panels are padded to whole vectors");
        assert!(self.right.len() >= self.depth * self.columns && self.result.len() >= self.rows * self.columns);
        if let Some(last) = self.depth.checked_sub(1) {
            assert!((self.rows - 1) * self.left.row_step + last * self.left.depth_step < self.left.values.len());
        }
        if let Start::Scaled(factors) = self.start {
            assert!(factors.len() >= self.columns);
        }
        // SAFETY: the panels hold what is read and written, as was just checked.
        unsafe { vectorised(self) };
    }
}

impl<T: Real> Job<T> for Product<'_, T> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(mut self) {
        let mut column = 0;
        while column < self.columns {
            let vectors = (self.columns - column) / V::WIDTH;
            // SAFETY: the panels hold every element of the columns up to `columns`.
            unsafe {
                column += V::WIDTH
                    * match vectors {
                        4.. if V::REGISTERS == 32 => stripe::<V, 4>(&mut self, column),
                        3 if V::REGISTERS == 32 => stripe::<V, 3>(&mut self, column),
                        2.. => stripe::<V, 2>(&mut self, column),
                        _ => stripe::<V, 1>(&mut self, column),
                    };
            }
        }
    }
}

/// All rows of `Q` vectors of columns; returns `Q`.
#[inline(always)]
unsafe fn stripe<V: Lane, const Q: usize>(p: &mut Product<'_, V::Element>, column: usize) -> usize {
    let mut row = 0;
    while row < p.rows {
        // SAFETY: as the caller.
        unsafe {
            row += match p.rows - row {
                6.. => tile::<V, 6, Q>(p, row, column),
                5 => tile::<V, 5, Q>(p, row, column),
                4 => tile::<V, 4, Q>(p, row, column),
                3 => tile::<V, 3, Q>(p, row, column),
                2 => tile::<V, 2, Q>(p, row, column),
                _ => tile::<V, 1, Q>(p, row, column),
            };
        }
    }
    Q
}

/// `R` rows of `Q` vectors, whose sums stay in registers; returns `R`.
#[inline(always)]
unsafe fn tile<V: Lane, const R: usize, const Q: usize>(
    p: &mut Product<'_, V::Element>,
    row: usize,
    column: usize,
) -> usize {
    // SAFETY: rows `row..row + R` and columns `column..column + Q · WIDTH` lie within the panels.
    unsafe {
        let to = p.result.as_mut_ptr().add(row * p.columns + column);
        let mut sums = [[V::splat(V::Element::ZERO); Q]; R];
        match p.start {
            Start::Zero => {}
            Start::Result => {
                for r in 0..R {
                    for q in 0..Q {
                        sums[r][q] = V::load(to.add(r * p.columns + q * V::WIDTH));
                    }
                }
            }
            Start::Scaled(factors) => {
                for q in 0..Q {
                    let factor = V::load(factors.as_ptr().add(column + q * V::WIDTH));
                    for r in 0..R {
                        sums[r][q] = V::load(to.add(r * p.columns + q * V::WIDTH)).mul(factor);
                    }
                }
            }
        }
        let mut left = p.left.values.as_ptr().wrapping_add(row * p.left.row_step);
        let mut right = p.right.as_ptr().add(column);
        for _ in 0..p.depth {
            let mut vectors = [V::splat(V::Element::ZERO); Q];
            for q in 0..Q {
                vectors[q] = V::load(right.add(q * V::WIDTH));
            }
            for r in 0..R {
                let factor = V::splat(*left.add(r * p.left.row_step));
                for q in 0..Q {
                    sums[r][q] = factor.mul_add(vectors[q], sums[r][q]);
                }
            }
            left = left.wrapping_add(p.left.depth_step);
            right = right.wrapping_add(p.columns);
        }
        for r in 0..R {
            for q in 0..Q {
                sums[r][q].store(to.add(r * p.columns + q * V::WIDTH));
            }
        }
        R
    }
}

#[cfg(test)]
mod tests {
    use super::{Left, Product, Start};
    use crate::ops::uniform;

    #[test]
    fn agrees_with_the_definition_for_every_tile() {
        for (rows, depth, columns) in [(1, 1, 16), (2, 5, 32), (3, 0, 16), (5, 3, 48), (13, 7, 64), (6, 2, 80)] {
            for (row_step, depth_step) in [(depth.max(1), 1), (1, rows)] {
                let random = |seed, len: usize| uniform(seed, [len], -1.0..1.0).slice::<f64>().to_vec();
                let (left, right) = (random(1, rows * depth), random(2, depth * columns));
                let (before, factors) = (random(3, rows * columns), random(4, columns));
                for start in [Start::Zero, Start::Result, Start::Scaled(&factors)] {
                    let mut result = before.clone();
                    let left = Left { values: &left, row_step, depth_step };
                    Product { rows, depth, columns, left, right: &right, result: &mut result, start }.run();
                    for (i, found) in result.iter().enumerate() {
                        let (row, column) = (i / columns, i % columns);
                        let first = match start {
                            Start::Zero => 0.0,
                            Start::Result => before[i],
                            Start::Scaled(factors) => before[i] * factors[column],
                        };
                        let sum: f64 = (0..depth)
                            .map(|k| left.values[row * row_step + k * depth_step] * right[k * columns + column])
                            .sum();
                        assert!((found - first - sum).abs() < 1e-13, "{rows}x{depth}x{columns}: {found} at {i}");
                    }
                }
            }
        }
    }
}
