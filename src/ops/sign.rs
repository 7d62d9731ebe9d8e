//! `sign`: −1, 0 or 1; its derivative is 0 everywhere.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const SIGN: Pointwise<1> = Pointwise {
    name: "sign",
    function: |[x]| x.sign(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)]],
    entry: || SIGN.all_cases(),
};

impl Var {
    /// −1, 0 or 1 for each element; its derivative is 0 everywhere.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![-2.0, 0.0, 3.0], [3]));
    /// assert_eq!(x.sign().value()?.slice::<f64>(), [-1.0, 0.0, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn sign(&self) -> Self {
        SIGN.apply([self])
    }
}
