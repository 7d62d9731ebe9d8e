//! `softplus`: `ln(1 + eˣ)`: a smooth map to positive numbers that equals `x` for large `x`.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const SOFTPLUS: Pointwise<1> = Pointwise {
    name: "softplus",
    function: |[x]| x.softplus(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)], [Tensor::from_vec(vec![-80.0f64, -1.0, 0.0, 20.0, 80.0], [5])]],
    entry: || SOFTPLUS.all_cases(),
};

impl Var {
    /// `ln(1 + eˣ)` of each element: a smooth map to positive numbers.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0], [1]));
    /// assert!((x.softplus().item()? - std::f64::consts::LN_2).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn softplus(&self) -> Self {
        SOFTPLUS.apply([self])
    }
}
