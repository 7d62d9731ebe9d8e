//! `cos` of an angle in radians.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const COS: Pointwise<1> = Pointwise {
    name: "cos",
    function: |[x]| x.cos(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)], [uniform(2, [7], -900.0..900.0)]],
    entry: || COS.all_cases(),
};

impl Var {
    /// The cosine of each element, an angle in radians.
    #[track_caller]
    #[must_use]
    pub fn cos(&self) -> Self {
        COS.apply([self])
    }
}
