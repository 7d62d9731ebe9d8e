//! `sqrt`: The square root; its derivative at 0 is infinite.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const SQRT: Pointwise<1> = Pointwise {
    name: "sqrt",
    function: |[x]| x.sqrt(),
    cases: || vec![[uniform(1, [4, 5], 0.2..9.0)]],
    entry: || SQRT.all_cases(),
};

impl Var {
    /// The square root of each element; its derivative at 0 is infinite.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![4.0, 9.0], [2]));
    /// assert_eq!(x.sqrt().value()?.slice::<f64>(), [2.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn sqrt(&self) -> Self {
        SQRT.apply([self])
    }
}
