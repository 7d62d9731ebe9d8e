//! `rsqrt`: `1 / √x`.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const RSQRT: Pointwise<1> = Pointwise {
    name: "rsqrt",
    function: |[x]| x.sqrt().recip(),
    cases: || vec![[uniform(1, [4, 5], 0.2..3.0)]],
    entry: || RSQRT.all_cases(),
};

impl Var {
    /// `1 / √x` of each element.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![4.0], [1]));
    /// assert_eq!(x.rsqrt().value()?.slice::<f64>(), [0.5]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn rsqrt(&self) -> Self {
        RSQRT.apply([self])
    }
}
