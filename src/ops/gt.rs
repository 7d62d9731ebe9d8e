//! `gt`: 1 where `x > y`, else 0, in the operands' dtype; 0 where either is NaN. Its derivative is 0.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const GT: Pointwise<2> = Pointwise {
    name: "gt",
    function: |[x, y]| x.gt(y).to_scalar(),
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [4, 5], -3.0..3.0)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [5], -3.0..3.0)],
            [uniform(1, [2, 3], -3.0..3.0), Tensor::from_vec(vec![f64::NAN], [1])],
        ]
    },
    entry: || GT.conditions(),
};

impl Var {
    /// 1 where this is above `other`, else 0; 0 where either is NaN. A constant: it has no derivative.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// let y = tape.leaf(Tensor::from_vec(vec![2.0, 2.0, 2.0], [3]));
    /// assert_eq!(x.gt(&y).value()?.slice::<f64>(), [0.0, 0.0, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    #[must_use]
    pub fn gt(&self, other: &Self) -> Self {
        GT.apply([&self.detach(), &other.detach()])
    }
}
