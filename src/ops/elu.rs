//! `elu`: `x` above 0, `alpha (eˣ − 1)` below (Clevert and others 2015).

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const ELU: Pointwise<2> = Pointwise {
    name: "elu",
    function: |[x, alpha]| x.gt(0.0).select(x, alpha * x.min(0.0).exp_m1()),
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [1], 0.1..0.9)],
            [uniform(3, [2, 3], -90.0..90.0), uniform(4, [3], 0.1..0.9)],
        ]
    },
    entry: || ELU.all_cases(),
};

impl Var {
    /// `x` above 0, `alpha (eˣ − 1)` elsewhere.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![-1.0], [1]));
    /// assert!((x.elu(2.0).item()? - 2.0 * (-1.0f64).exp_m1()).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn elu(&self, alpha: f64) -> Self {
        ELU.apply([self, &self.number(alpha)])
    }
}
