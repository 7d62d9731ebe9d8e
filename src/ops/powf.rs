//! `x^y`.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const POWF: Pointwise<2> = Pointwise {
    name: "powf",
    function: |[x, y]| x.powf(y),
    cases: || {
        vec![
            [uniform(1, [4, 5], 0.3..3.0), uniform(2, [4, 5], -3.0..3.0)],
            [uniform(1, [4, 5], 0.3..3.0), uniform(2, [1], -1.0..1.0)],
        ]
    },
    entry: || POWF.all_cases(),
};

impl Var {
    /// `x^y`, element by element; NaN for negative `x`, unless `y` is whole.
    ///
    /// The gradient in `x` is 0 where `y = 0`. That in `y` is 0 where `x = 0` and `y ≥ 0`, −∞ where `x = 0` and `y < 0`, and
    /// NaN where `x < 0`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![2.0, 9.0], [2]));
    /// let y = tape.leaf(Tensor::from_vec(vec![3.0, 0.5], [2]));
    /// assert_eq!(x.powf(&y).value()?.slice::<f64>(), [8.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    #[must_use]
    pub fn powf(&self, other: &Self) -> Self {
        POWF.apply([self, other])
    }
}
