//! Multi-distance interpolation: lookups in a grid and in its copies thinned by 2 and 4.

use gradreel::{Result, Var};

use crate::constant;
use crate::field::DenseGrid;

/// Strides of the thinned grids.
const STRIDES: [usize; 3] = [1, 2, 4];

/// A feature grid and its thinned copies, all over the same box.
pub(super) struct Distances {
    grids: Vec<(DenseGrid, Var)>,
}

impl Distances {
    /// Thins values `[x, y, z, channels]`. Each axis is zero-padded at its far end until its number of nodes is one
    /// more than a multiple of 4; the padded grid spans the same box.
    pub fn new(grid: &DenseGrid, values: &Var) -> Result<Self> {
        let channels = values.dims()[3];
        let padded = grid.dims.map(|n| n + (5 - n % 4) % 4);
        let mut whole = values.clone();
        for axis in 0..3 {
            if padded[axis] > grid.dims[axis] {
                whole = whole.pad(axis, 0, padded[axis] - grid.dims[axis]);
            }
        }
        let rows = whole.reshape([padded.iter().product(), channels]);
        let thinned = |stride: usize| -> Result<(DenseGrid, Var)> {
            let dims = padded.map(|n| (n - 1) / stride + 1);
            let grid = DenseGrid { dims, ..grid.clone() };
            if stride == 1 {
                return Ok((grid, whole.clone()));
            }
            let [x, y, z] = dims;
            let flat = |i: usize| {
                let node = [i / (y * z), i / z % y, i % z].map(|n| n * stride);
                ((node[0] * padded[1] + node[1]) * padded[2] + node[2]) as u32
            };
            let nodes = constant::indices(values, (0..x * y * z).map(flat).collect())?;
            Ok((grid, rows.index_select(&nodes)?.reshape([x, y, z, channels])))
        };
        let fits = |stride: &usize| padded.iter().all(|n| (n - 1) / stride >= 1);
        Ok(Self { grids: STRIDES.into_iter().filter(fits).map(thinned).collect::<Result<_>>()? })
    }

    /// Features at points, the finest grid first: `[n, 3 · channels]`.
    pub fn lookup(&self, points: &Var) -> Result<Var> {
        let found: Vec<Var> =
            self.grids.iter().map(|(grid, values)| grid.lookup(values, points)).collect::<Result<_>>()?;
        Ok(found[0].concat(&found[1..].iter().collect::<Vec<_>>(), 1))
    }
}
