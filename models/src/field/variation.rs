//! Total variation: how much neighbouring nodes of a grid differ, as a gradient of its own.

use gradreel::{Result, Tape, Tensor, Var};

/// Which nodes the gradient is added to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reach {
    /// All.
    #[default]
    Dense,
    /// Those to which the images gave a gradient.
    Sparse,
}

/// The gradient of the total variation of a grid `[x, y, z, channels]`: for each node and each neighbour along an axis
/// `weight/6 · clamp(d − d_neighbour, −1, 1)`, the derivative of a Huber function of their difference.
///
/// The published optimiser divides `weight` by the number of nodes beforehand.
///
/// # Errors
/// What the ops return.
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

/// A gradient of the grid with that of its total variation added ([`variation_gradient`]).
///
/// # Errors
/// What the ops return.
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
