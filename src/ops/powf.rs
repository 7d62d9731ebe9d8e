//! `x^y` for positive `x`.

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
    /// `x^y` of positive numbers, element by element.
    ///
    /// # Panics
    /// When the shapes do not broadcast.
    #[track_caller]
    #[must_use]
    pub fn powf(&self, other: &Self) -> Self {
        POWF.apply([self, other])
    }
}
