//! `abs`: `|x|`; the derivative at 0 is 0.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const ABS: Pointwise<1> = Pointwise {
    name: "abs",
    function: |[x]| x.abs(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)]],
    entry: || ABS.all_cases(),
};

impl Var {
    /// The absolute value of each element; its derivative at 0 is 0.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![-2.0, 3.0], [2]));
    /// assert_eq!(x.abs().value()?.slice::<f64>(), [2.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn abs(&self) -> Self {
        ABS.apply([self])
    }
}
