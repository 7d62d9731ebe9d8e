//! The quadratic B-splines around a batch of particles.
//!
//! They are made number by number for the whole batch, which compilers turn into vectors; the transfers then read one
//! particle's numbers at a time. Everything here is inlined into [`super::kernel`], which chooses the instruction set.

use super::node_grid::NodeGrid;
use super::row::Number;

/// Particles whose stencils are made together.
pub(crate) const BATCH: usize = 16;

/// One number of each particle of a batch.
pub(crate) type Batch<T> = [T; BATCH];

/// Weights, node offsets and places in the grid.
#[repr(C, align(64))]
pub(crate) struct Stencils<T> {
    /// `w[axis][node]`
    pub w: [[Batch<T>; 3]; 3],
    /// `across[x node][y node]`, the product of both weights.
    pub across: [[Batch<T>; 3]; 3],
    /// `δ` per axis and node \[m\]
    pub delta: [[Batch<T>; 3]; 3],
    /// Where the first row starts.
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
    /// If nine rows of four nodes do not lie in the region for each of them. The memory safety of the transfers rests on it.
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
    /// Those at `x[axis]` \[m\].
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

/// How the weights of rows change as particles move.
#[repr(C, align(64))]
pub(crate) struct Moved<T> {
    /// Times the weights along z: what movement along x and y does, per plane and row.
    pub across: [[Batch<T>; 3]; 3],
    /// Times the derivative of the weights along z: what movement along z does.
    pub along: [[Batch<T>; 3]; 3],
}

impl<T: Number> Moved<T> {
    /// By `dx[axis]` \[m\].
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
