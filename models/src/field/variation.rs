//! Total variation of a grid, as an explicit gradient.

use gradreel::{Result, Tape, Tensor, Var};

/// Nodes to which the gradient is added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reach {
    /// All nodes.
    #[default]
    Dense,
    /// Nodes with a nonzero image gradient.
    Sparse,
}

/// The gradient of the total variation of a grid `[x, y, z, channels]`: for each node, the sum over its neighbours
/// along the axes of `weight/6 · clamp(d − d_neighbour, −1, 1)`, the derivative of a Huber function of the difference.
///
/// The published optimiser divides `weight` by the number of nodes beforehand.
///
/// # Errors
/// Propagates errors of the ops.
pub fn variation_gradient(grid: &Tensor, weight: f64) -> Result<Tensor> {
    let tape = Tape::new();
    let grid = tape.constant(grid.clone());
    let mut total = &grid * 0.0;
    for axis in (0..3).filter(|&axis| grid.dims()[axis] > 1) {
        let size = grid.dims()[axis];
        let rise = (grid.slice(axis, 1..size) - grid.slice(axis, 0..size - 1)).clamp(-1.0, 1.0);
        total = total + (rise.pad(axis, 1, 0) - rise.pad(axis, 0, 1));
    }
    (total * (weight / 6.0)).value().cloned()
}

/// Adds the gradient of the total variation ([`variation_gradient`]) to a gradient of the grid.
///
/// # Errors
/// Propagates errors of the ops.
pub fn with_variation(gradient: &Tensor, grid: &Tensor, weight: f64, reach: Reach) -> Result<Tensor> {
    let tape = Tape::new();
    let [gradient, added]: [Var; 2] =
        [tape.constant(gradient.clone()), tape.constant(variation_gradient(grid, weight)?)];
    let added = match reach {
        Reach::Dense => added,
        Reach::Sparse => &added * &gradient.ne(&(&gradient * 0.0)),
    };
    (&gradient + &added).value().cloned()
}
