//! The small matrices of Winograd's F(2×2, 3×3), applied to whole vectors of channels.
//!
//! ```text
//!      ⎡1  0 −1  0⎤        ⎡1  0  0⎤
//! Bᵀ = ⎢0  1  1  0⎥    G = ⎢½  ½  ½⎥    Aᵀ = ⎡1  1  1  0⎤
//!      ⎢0 −1  1  0⎥        ⎢½ −½  ½⎥         ⎣0  1 −1 −1⎦
//!      ⎣0  1  0 −1⎦        ⎣0  0  1⎦
//! ```

use crate::scalar::{Job, Lane, Real};

/// Where a small square of vectors lies: its rows, its columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Square<P> {
    pub(super) at: P,
    pub(super) row: usize,
    pub(super) column: usize,
}

impl<T> Square<*const T> {
    /// # Safety
    /// The instruction set of `V` must be enabled, and the square must be valid for `N × N` vectors from `offset` on.
    #[inline(always)]
    unsafe fn load<V: Lane<Element = T>, const N: usize>(self, offset: usize) -> [[V; N]; N] {
        // SAFETY: as this function.
        unsafe {
            let mut square = [[V::load(self.at.add(offset)); N]; N];
            for i in 0..N {
                for j in 0..N {
                    square[i][j] = V::load(self.at.add(offset + i * self.row + j * self.column));
                }
            }
            square
        }
    }
}

impl<T> Square<*mut T> {
    /// # Safety
    /// As [`Square::load`].
    #[inline(always)]
    unsafe fn store<V: Lane<Element = T>, const N: usize>(self, offset: usize, square: [[V; N]; N]) {
        // SAFETY: as this function.
        unsafe {
            for i in 0..N {
                for j in 0..N {
                    square[i][j].store(self.at.add(offset + i * self.row + j * self.column));
                }
            }
        }
    }
}

/// Channels of a block, for vectors of any width.
pub(super) const BLOCK: usize = 16;

/// Which product of small matrices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// `Bᵀ d B`: 4×4 pixels.
    Input,
    /// `G g Gᵀ`: 3×3 weights to 4×4.
    Weight,
    /// `Aᵀ m A`: 4×4 to 2×2 results.
    Output,
    /// `A y Aᵀ`: 2×2 slopes of the results to 4×4.
    OutputSlope,
    /// `Gᵀ u G`: 4×4 to the slopes of 3×3 weights.
    WeightSlope,
}

/// A step for some neighbouring squares and all their channels, a multiple of 16.
pub(super) struct Transform<T> {
    pub(super) step: Step,
    pub(super) from: Square<*const T>,
    pub(super) to: Square<*mut T>,
    pub(super) channels: usize,
    /// Distance between blocks of [`BLOCK`] channels where they go to; where they come from they are side by side.
    pub(super) to_block: usize,
    /// Number of squares, and the distances between them.
    pub(super) count: usize,
    pub(super) from_next: usize,
    pub(super) to_next: usize,
}

/// Applies a matrix to the rows of a square, and then to its columns.
macro_rules! both_sides {
    ($square:expr, $from:literal, $to:literal, |$x:ident| $apply:expr) => {{
        let square = $square;
        let mut half = [[square[0][0]; $from]; $to];
        for j in 0..$from {
            let mut $x = [square[0][0]; $from];
            for i in 0..$from {
                $x[i] = square[i][j];
            }
            let column = $apply;
            for i in 0..$to {
                half[i][j] = column[i];
            }
        }
        let mut whole = [[square[0][0]; $to]; $to];
        for i in 0..$to {
            let $x = half[i];
            whole[i] = $apply;
        }
        whole
    }};
}

impl<T: Real> Job<T> for Transform<T> {
    type Output = ();

    /// # Safety
    /// Both squares must be valid for all of the squares and channels.
    #[inline(always)]
    unsafe fn run<V: Lane<Element = T>>(self) {
        let Self { step, from, to, channels, to_block, count, from_next, to_next } = self;
        macro_rules! each {
            ($from:literal, $to:literal, |$x:ident| $apply:expr) => {
                for number in 0..count {
                    for c in (0..channels).step_by(V::WIDTH) {
                        let square = from.load::<V, $from>(number * from_next + c);
                        let square = both_sides!(square, $from, $to, |$x| $apply);
                        to.store::<V, $to>(number * to_next + c / BLOCK * to_block + c % BLOCK, square);
                    }
                }
            };
        }
        // SAFETY: the caller's promise.
        unsafe {
            let half = V::splat(T::from_f64(0.5));
            match step {
                Step::Input => each!(4, 4, |x| [x[0].sub(x[2]), x[1].add(x[2]), x[2].sub(x[1]), x[1].sub(x[3])]),
                Step::Weight => each!(3, 4, |x| {
                    let (ends, middle) = (x[0].add(x[2]).mul(half), x[1].mul(half));
                    [x[0], ends.add(middle), ends.sub(middle), x[2]]
                }),
                Step::Output => each!(4, 2, |x| [x[0].add(x[1]).add(x[2]), x[1].sub(x[2]).sub(x[3])]),
                Step::OutputSlope => each!(2, 4, |x| [x[0], x[0].add(x[1]), x[0].sub(x[1]), x[1].neg()]),
                Step::WeightSlope => each!(4, 3, |x| {
                    let (sum, difference) = (x[1].add(x[2]).mul(half), x[1].sub(x[2]).mul(half));
                    [x[0].add(sum), difference, sum.add(x[3])]
                }),
            }
        }
    }
}
