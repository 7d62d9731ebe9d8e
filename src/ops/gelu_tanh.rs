//! `gelu_tanh`: the approximation of GELU by a hyperbolic tangent.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const GELU_TANH: Pointwise<1> = Pointwise {
    name: "gelu_tanh",
    function: |[x]| 0.5 * x * (1.0 + ((2.0 / std::f64::consts::PI).sqrt() * (x + 0.044_715 * x.powi(3))).tanh()),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)]],
    entry: || GELU_TANH.all_cases(),
};

impl Var {
    /// `x/2 (1 + tanh(√(2/π) (x + 0.044715 x³)))` of each element: the approximate GELU of GPT-2.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0, 10.0], [2]));
    /// assert_eq!(x.gelu_tanh().value()?.slice::<f64>(), [0.0, 10.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn gelu_tanh(&self) -> Self {
        GELU_TANH.apply([self])
    }
}
