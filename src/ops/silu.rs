//! `silu`: `x σ(x)` with the logistic sigmoid σ, also known as swish.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const SILU: Pointwise<1> = Pointwise {
    name: "silu",
    function: |[x]| x * x.logistic(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)], [Tensor::from_vec(vec![-80.0f64, -1.0, 0.0, 80.0], [4])]],
    entry: || SILU.all_cases(),
};

impl Var {
    /// `x σ(x)` of each element, with the logistic sigmoid σ (SiLU, swish).
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0], [1]));
    /// assert!((x.silu().item()? - 1.0 / (1.0 + (-1.0f64).exp())).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn silu(&self) -> Self {
        SILU.apply([self])
    }
}
