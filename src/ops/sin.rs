//! `sin` of an angle in radians.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const SIN: Pointwise<1> = Pointwise {
    name: "sin",
    function: |[x]| x.sin(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)], [uniform(2, [7], -900.0..900.0)]],
    entry: || SIN.all_cases(),
};

impl Var {
    /// The sine of each element, an angle in radians.
    #[track_caller]
    #[must_use]
    pub fn sin(&self) -> Self {
        SIN.apply([self])
    }
}
