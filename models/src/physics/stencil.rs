//! The quadratic B-splines around a batch of particles.
//!
//! Weights are computed component by component for the whole batch, which compilers vectorise; the transfers then
//! process one particle at a time. Everything here is inlined into [`super::kernel`], which selects the instruction
//! set.

use super::node_grid::NodeGrid;
use super::row::Number;

/// Number of particles whose stencils are computed together.
pub(crate) const BATCH: usize = 16;

/// One value per particle of a batch.
pub(crate) type Batch<T> = [T; BATCH];

/// Weights, node offsets and grid offsets.
#[repr(C, align(64))]
pub(crate) struct Stencils<T> {
    /// `w[axis][node]`
    pub w: [[Batch<T>; 3]; 3],
    /// `across[x node][y node]`, the product of the two weights.
    pub across: [[Batch<T>; 3]; 3],
    /// `δ` per axis and node \[m\]
    pub delta: [[Batch<T>; 3]; 3],
    /// Grid offset of the first row.
    pub start: Batch<usize>,
}

/// `∂w/∂x` per axis and node \[1/m\].
#[repr(C, align(64))]
pub(crate) struct Slopes<T>(pub [[Batch<T>; 3]; 3]);

impl<T: Number> Stencils<T> {
    /// The stencils at `x[axis]` \[m\] in a region of `planes` node planes from `first_plane` on.
    ///
    /// # Panics
    ///
    /// If, for any of them, nine rows of four nodes do not lie in the region. The memory safety of the transfers
    /// depends on it.
    #[inline(always)]
    pub fn new(node_grid: &NodeGrid<T>, first_plane: usize, planes: usize, x: &[Batch<T>; 3]) -> Self {
        let number = |value: f64| T::from_f64(value);
        let zero = [[[T::ZERO; BATCH]; 3]; 3];
        let mut s = Self { w: zero, across: zero, delta: zero, start: [0; BATCH] };
        let mut base = [[0; BATCH]; 3];
        for axis in 0..3 {
            for i in 0..BATCH {
                let (node, f) = node_grid.locate(x[axis][i]);
                base[axis][i] = node;
                let (a, b, c) = (number(1.5) - f, f - number(1.0), f - number(0.5));
                s.w[axis][0][i] = number(0.5) * a * a;
                s.w[axis][1][i] = number(0.75) - b * b;
                s.w[axis][2][i] = number(0.5) * c * c;
                s.delta[axis][0][i] = -(f * node_grid.dx);
                s.delta[axis][1][i] = -(b * node_grid.dx);
                s.delta[axis][2][i] = (number(2.0) - f) * node_grid.dx;
            }
        }
        for a in 0..3 {
            for b in 0..3 {
                for i in 0..BATCH {
                    s.across[a][b][i] = s.w[0][a][i] * s.w[1][b][i];
                }
            }
        }
        s.start = node_grid.starts(&base, first_plane, planes);
        s
    }
}

impl<T: Number> Slopes<T> {
    /// The derivatives at `x[axis]` \[m\].
    #[inline(always)]
    pub fn new(node_grid: &NodeGrid<T>, x: &[Batch<T>; 3]) -> Self {
        let number = |value: f64| T::from_f64(value);
        let mut dw = [[[T::ZERO; BATCH]; 3]; 3];
        for axis in 0..3 {
            for i in 0..BATCH {
                let f = node_grid.locate(x[axis][i]).1;
                let per_metre = node_grid.inverse_dx;
                dw[axis][0][i] = -((number(1.5) - f) * per_metre);
                dw[axis][1][i] = number(-2.0) * (f - number(1.0)) * per_metre;
                dw[axis][2][i] = (f - number(0.5)) * per_metre;
            }
        }
        Self(dw)
    }
}

/// The change of row weights as particles move.
#[repr(C, align(64))]
pub(crate) struct Moved<T> {
    /// Change due to motion along x and y, per plane and row; multiplies the weights along z.
    pub across: [[Batch<T>; 3]; 3],
    /// Change due to motion along z; multiplies the derivative of the weights along z.
    pub along: [[Batch<T>; 3]; 3],
}

impl<T: Number> Moved<T> {
    /// For a motion by `dx[axis]` \[m\].
    #[inline(always)]
    pub fn new(s: &Stencils<T>, Slopes(dw): &Slopes<T>, dx: &[Batch<T>; 3]) -> Self {
        let zero = [[[T::ZERO; BATCH]; 3]; 3];
        let mut moved = Self { across: zero, along: zero };
        for a in 0..3 {
            for b in 0..3 {
                for i in 0..BATCH {
                    let along_x = dw[0][a][i] * dx[0][i] * s.w[1][b][i];
                    moved.across[a][b][i] = along_x + s.w[0][a][i] * (dw[1][b][i] * dx[1][i]);
                    moved.along[a][b][i] = s.across[a][b][i] * dx[2][i];
                }
            }
        }
        moved
    }
}
