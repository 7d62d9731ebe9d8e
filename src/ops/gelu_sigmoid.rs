//! `gelu_sigmoid`: `x σ(1.702 x)`, the approximation of GELU by a sigmoid.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const GELU_SIGMOID: Pointwise<1> = Pointwise {
    name: "gelu_sigmoid",
    function: |[x]| x * (1.702 * x).logistic(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)]],
    entry: || GELU_SIGMOID.all_cases(),
};

impl Var {
    /// `x σ(1.702 x)` of each element: the approximate GELU of CLIP ("QuickGELU").
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0], [1]));
    /// assert!((x.gelu_sigmoid().item()? - 1.0 / (1.0 + (-1.702f64).exp())).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn gelu_sigmoid(&self) -> Self {
        GELU_SIGMOID.apply([self])
    }
}
