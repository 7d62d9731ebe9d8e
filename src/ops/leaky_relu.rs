//! `leaky_relu`: `x` above 0, `slope · x` below.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const LEAKY_RELU: Pointwise<2> = Pointwise {
    name: "leaky_relu",
    function: |[x, slope]| x.gt(0.0).select(x, slope * x),
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [1], 0.1..0.9)],
            [uniform(3, [2, 3], -90.0..90.0), uniform(4, [3], 0.1..0.9)],
        ]
    },
    entry: || LEAKY_RELU.all_cases(),
};

impl Var {
    /// `x` above 0, `slope · x` elsewhere; the derivative at 0 is `slope`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![-2.0, 3.0], [2]));
    /// assert_eq!(x.leaky_relu(0.5).value()?.slice::<f64>(), [-1.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn leaky_relu(&self, slope: f64) -> Self {
        LEAKY_RELU.apply([self, &self.number(slope)])
    }
}
