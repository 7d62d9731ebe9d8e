//! `abs`: `|x|`; the derivative at 0 is 0.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const ABS: Pointwise<1> = Pointwise {
    name: "abs",
    function: |[x]| x.abs(),
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)]],
    entry: || ABS.all_cases(),
};

impl Var {
    /// The absolute value of each element; its derivative at 0 is 0.
    #[track_caller]
    #[must_use]
    pub fn abs(&self) -> Self {
        ABS.apply([self])
    }
}
