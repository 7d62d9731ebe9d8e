//! `clamp`: the nearest number between two bounds. NaN stays NaN.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const CLAMP: Pointwise<3> = Pointwise {
    name: "clamp",
    function: |[x, low, high]| x.max(low).min(high),
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [1], -1.5..-0.5), uniform(3, [1], 0.5..1.5)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [5], -1.5..-0.5), uniform(3, [4, 1], 0.5..1.5)],
        ]
    },
    entry: || CLAMP.all_cases(),
};

impl Var {
    /// The nearest number in `[low, high]` to each element; the derivative is 1 inside and at both ends, 0 outside.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![-1.0, 0.5, 4.0], [3]));
    /// assert_eq!(x.clamp(0.0, 1.0).value()?.slice::<f64>(), [0.0, 0.5, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When `low > high` or either is NaN.
    #[track_caller]
    #[must_use]
    pub fn clamp(&self, low: f64, high: f64) -> Self {
        assert!(low <= high, "clamp: the lower end {low} is not below the upper end {high}");
        CLAMP.apply([self, &self.number(low), &self.number(high)])
    }
}
