//! `tanh`: The hyperbolic tangent.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const TANH: Pointwise<1> = Pointwise {
    name: "tanh",
    function: |[x]| x.tanh(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)], [Tensor::from_vec(vec![-40.0f64, -1e-3, 0.0, 1e-3, 40.0], [5])]],
    entry: || TANH.all_cases(),
};

impl Var {
    /// The hyperbolic tangent of each element.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0], [1]));
    /// assert_eq!(x.tanh().value()?.slice::<f64>(), [0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn tanh(&self) -> Self {
        TANH.apply([self])
    }
}
