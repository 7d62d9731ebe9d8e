//! `logistic`: `1 / (1 + e⁻ˣ)`, also called sigmoid; finite and exact for large `|x|`.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const LOGISTIC: Pointwise<1> = Pointwise {
    name: "logistic",
    function: |[x]| x.logistic(),
    cases: || vec![[uniform(1, [4, 5], -4.0..4.0)], [Tensor::from_vec(vec![-90.0f64, -20.0, 0.0, 20.0, 90.0], [5])]],
    entry: || LOGISTIC.all_cases(),
};

impl Var {
    /// `1 / (1 + e⁻ˣ)` of each element, also called sigmoid.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0], [1]));
    /// assert_eq!(x.logistic().value()?.slice::<f64>(), [0.5]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn logistic(&self) -> Self {
        LOGISTIC.apply([self])
    }
}
