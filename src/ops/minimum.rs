//! `min(x, y)`; a tie gives its derivative to `x`.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const MINIMUM: Pointwise<2> = Pointwise {
    name: "minimum",
    function: |[x, y]| x.min(y),
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [4, 5], -3.0..3.0)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [1], -1.0..1.0)],
        ]
    },
    entry: || MINIMUM.all_cases(),
};

impl Var {
    /// The smaller of two numbers, element by element; a tie gives its derivative to `self`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 5.0], [2]));
    /// let y = tape.leaf(Tensor::from_vec(vec![2.0, 3.0], [2]));
    /// assert_eq!(x.minimum(&y).value()?.slice::<f64>(), [1.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    #[must_use]
    pub fn minimum(&self, other: &Self) -> Self {
        MINIMUM.apply([self, other])
    }
}
