//! `recip`: `1 / x`.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const RECIP: Pointwise<1> = Pointwise {
    name: "recip",
    function: |[x]| x.recip(),
    cases: || vec![[uniform(1, [4, 5], 0.3..3.0)], [uniform(1, [3], -3.0..-0.3)]],
    entry: || RECIP.all_cases(),
};

impl Var {
    /// `1 / x` of each element.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![2.0, 4.0], [2]));
    /// assert_eq!(x.recip().value()?.slice::<f64>(), [0.5, 0.25]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn recip(&self) -> Self {
        RECIP.apply([self])
    }
}
