//! `le`: 1 where `x ≤ y`, else 0, in the operands' dtype; 0 where either is NaN. Its derivative is 0.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const LE: Pointwise<2> = Pointwise {
    name: "le",
    function: |[x, y]| x.le(y).to_scalar(),
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [4, 5], -3.0..3.0)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [5], -3.0..3.0)],
            [uniform(1, [2, 3], -3.0..3.0), Tensor::from_vec(vec![f64::NAN], [1])],
        ]
    },
    entry: || LE.conditions(),
};

impl Var {
    /// 1 where this is at most `other`, else 0; 0 where either is NaN. A constant: it has no derivative.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// let y = tape.leaf(Tensor::from_vec(vec![2.0, 2.0, 2.0], [3]));
    /// assert_eq!(x.le(&y).value()?.slice::<f64>(), [1.0, 1.0, 0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    #[must_use]
    pub fn le(&self, other: &Self) -> Self {
        LE.apply([&self.detach(), &other.detach()])
    }
}
