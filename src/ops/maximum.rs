//! `max(x, y)`; a tie gives its derivative to `x`.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const MAXIMUM: Pointwise<2> = Pointwise {
    name: "maximum",
    function: |[x, y]| x.max(y),
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [4, 5], -3.0..3.0)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [1], -1.0..1.0)],
        ]
    },
    entry: || MAXIMUM.all_cases(),
};

impl Var {
    /// The larger of two numbers, element by element; a tie gives its derivative to `self`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 5.0], [2]));
    /// let y = tape.leaf(Tensor::from_vec(vec![2.0, 3.0], [2]));
    /// assert_eq!(x.maximum(&y).value()?.slice::<f64>(), [2.0, 5.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    #[must_use]
    pub fn maximum(&self, other: &Self) -> Self {
        MAXIMUM.apply([self, other])
    }
}
