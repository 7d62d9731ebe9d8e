//! `square`: `x²`.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const SQUARE: Pointwise<1> = Pointwise {
    name: "square",
    function: |[x]| x.square(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)]],
    entry: || SQUARE.all_cases(),
};

impl Var {
    /// The square of each element.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![-2.0, 3.0], [2]));
    /// assert_eq!(x.square().value()?.slice::<f64>(), [4.0, 9.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn square(&self) -> Self {
        SQUARE.apply([self])
    }
}
