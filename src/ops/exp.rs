//! `exp`: `eˣ`.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const EXP: Pointwise<1> = Pointwise {
    name: "exp",
    function: |[x]| x.exp(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)], [Tensor::from_vec(vec![-80.0f64, -1.0, 0.0, 5.0], [4])]],
    entry: || EXP.all_cases(),
};

impl Var {
    /// `eˣ` of each element.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0], [1]));
    /// assert!((x.exp().item()? - std::f64::consts::E).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn exp(&self) -> Self {
        EXP.apply([self])
    }
}
