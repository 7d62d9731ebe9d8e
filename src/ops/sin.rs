//! `sin` of an angle in radians.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const SIN: Pointwise<1> = Pointwise {
    name: "sin",
    function: |[x]| x.sin(),
    cases: || {
        vec![[uniform(1, [4, 5], -3.0..3.0)], [Tensor::from_vec(vec![-981.0f64, -512.5, 0.0, 1.0, 30.25, 801.0], [6])]]
    },
    entry: || SIN.all_cases(),
};

impl Var {
    /// The sine of each element, an angle in radians.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0], [1]));
    /// assert_eq!(x.sin().value()?.slice::<f64>(), [0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn sin(&self) -> Self {
        SIN.apply([self])
    }
}
