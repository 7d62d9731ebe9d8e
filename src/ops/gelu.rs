//! `gelu`: `x Φ(x)` with the distribution function Φ of the standard normal distribution (Hendrycks, Gimpel 2016).

use crate::ops::{Pointwise, uniform};
use crate::{Tensor, Var};

pub(super) const GELU: Pointwise<1> = Pointwise {
    name: "gelu",
    function: |[x]| 0.5 * x * (1.0 + (x * std::f64::consts::FRAC_1_SQRT_2).erf()),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)], [Tensor::from_vec(vec![-20.0f64, -1.0, 0.0, 20.0], [4])]],
    entry: || GELU.all_cases(),
};

impl Var {
    /// `x Φ(x) = x/2 (1 + erf(x/√2))` of each element: the exact GELU.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0], [1]));
    /// assert!((x.gelu().item()? - 0.5 * (1.0 + 0.682_689_492_137_085_9)).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn gelu(&self) -> Self {
        GELU.apply([self])
    }
}
