//! `ln`: The natural logarithm; NaN below 0, −∞ at 0.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const LN: Pointwise<1> = Pointwise {
    name: "ln",
    function: |[x]| x.ln(),
    cases: || vec![[uniform(1, [4, 5], 0.1..9.0)], [Tensor::from_vec(vec![1e-2f64, 1.0, 1e6], [3])]],
    entry: || LN.all_cases(),
};

impl Var {
    /// The natural logarithm of each element: −∞ at 0, NaN below.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 0.0], [2]));
    /// assert_eq!(x.ln().value()?.slice::<f64>(), [0.0, f64::NEG_INFINITY]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn ln(&self) -> Self {
        LN.apply([self])
    }
}
