//! `floor`: the largest integer not above `x`; its derivative is 0 everywhere.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const FLOOR: Pointwise<1> = Pointwise {
    name: "floor",
    function: |[x]| x.floor(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)]],
    entry: || FLOOR.all_cases(),
};

impl Var {
    /// The largest integer not above each element; its derivative is 0 everywhere.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.7, -1.2], [2]));
    /// assert_eq!(x.floor().value()?.slice::<f64>(), [1.0, -2.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn floor(&self) -> Self {
        FLOOR.apply([self])
    }
}
