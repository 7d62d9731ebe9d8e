//! `exp_m1`: `eˣ − 1` without cancellation near 0.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const EXP_M1: Pointwise<1> = Pointwise {
    name: "exp_m1",
    function: |[x]| x.exp_m1(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)], [Tensor::from_vec(vec![1e-9f64, -1e-9, -50.0], [3])]],
    entry: || EXP_M1.all_cases(),
};

impl Var {
    /// `eˣ − 1` of each element, without cancellation near 0.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1e-20], [1]));
    /// assert_eq!(x.exp_m1().item()?, 1e-20);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn exp_m1(&self) -> Self {
        EXP_M1.apply([self])
    }
}
