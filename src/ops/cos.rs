//! `cos` of an angle in radians.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const COS: Pointwise<1> = Pointwise {
    name: "cos",
    function: |[x]| x.cos(),
    cases: || {
        vec![[uniform(1, [4, 5], -3.0..3.0)], [Tensor::from_vec(vec![-981.0f64, -512.5, 0.0, 1.0, 30.25, 801.0], [6])]]
    },
    entry: || COS.all_cases(),
};

impl Var {
    /// The cosine of each element, an angle in radians.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0], [1]));
    /// assert_eq!(x.cos().value()?.slice::<f64>(), [1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn cos(&self) -> Self {
        COS.apply([self])
    }
}
