//! `erf`: the error function.

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const ERF: Pointwise<1> = Pointwise {
    name: "erf",
    function: |[x]| x.erf(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)], [Tensor::from_vec(vec![-7.0f64, -1e-9, 0.0, 0.92, 7.0], [5])]],
    entry: || ERF.all_cases(),
};

impl Var {
    /// The error function `2/√π ∫₀ˣ e^{−t²} dt` of each element.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0], [1]));
    /// assert!((x.erf().item()? - 0.842_700_792_949_714_9).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn erf(&self) -> Self {
        ERF.apply([self])
    }
}
