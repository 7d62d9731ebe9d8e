//! `eq`: 1 where `x = y`, else 0, in the operands' dtype; 0 where either is NaN. Its derivative is 0.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const EQ: Pointwise<2> = Pointwise {
    name: "eq",
    function: |[x, y]| x.eq(y).to_scalar(),
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [4, 5], -3.0..3.0)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [5], -3.0..3.0)],
            [uniform(1, [2, 3], -3.0..3.0), Tensor::from_vec(vec![f64::NAN], [1])],
        ]
    },
    entry: || EQ.conditions(),
};

impl Var {
    /// 1 where this is equal to `other`, else 0; 0 where either is NaN. A constant: it has no derivative.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// let y = tape.leaf(Tensor::from_vec(vec![2.0, 2.0, 2.0], [3]));
    /// assert_eq!(x.eq(&y).value()?.slice::<f64>(), [0.0, 1.0, 0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    #[must_use]
    pub fn eq(&self, other: &Self) -> Self {
        EQ.apply([&self.detach(), &other.detach()])
    }
}
