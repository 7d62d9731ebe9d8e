//! `ln_1p`: `ln(1 + x)` without cancellation near 0.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const LN_1P: Pointwise<1> = Pointwise {
    name: "ln_1p",
    function: |[x]| x.ln_1p(),
    cases: || vec![[uniform(1, [4, 5], -0.7..3.0)], [Tensor::from_vec(vec![1e-9f64, -1e-9, 1e6], [3])]],
    entry: || LN_1P.all_cases(),
};

impl Var {
    /// `ln(1 + x)` of each element, without cancellation near 0.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1e-20], [1]));
    /// assert_eq!(x.ln_1p().item()?, 1e-20);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn ln_1p(&self) -> Self {
        LN_1P.apply([self])
    }
}
