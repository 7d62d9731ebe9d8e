//! `relu`: `max(x, 0)`; the derivative at 0 is 0. NaN stays NaN.

use crate::Var;
use crate::ops::{Pointwise, uniform};
use crate::scalar::Scalar;

pub(super) const RELU: Pointwise<1> = Pointwise {
    name: "relu",
    function: |[x]| Scalar::from(0.0).max(x),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)]],
    entry: || RELU.all_cases(),
};

impl Var {
    /// `max(x, 0)` of each element; its derivative at 0 is 0.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![-2.0, 3.0], [2]));
    /// assert_eq!(x.relu().value()?.slice::<f64>(), [0.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn relu(&self) -> Self {
        RELU.apply([self])
    }
}
