//! `sqrt`: The square root; its derivative at 0 is infinite.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const SQRT: Pointwise<1> = Pointwise {
    name: "sqrt",
    function: |[x]| x.sqrt(),
    cases: || vec![[uniform(1, [4, 5], 0.2..9.0)]],
    entry: || SQRT.all_cases(),
};

impl Var {
    /// The square root of each element; its derivative at 0 is infinite.
    #[track_caller]
    #[must_use]
    pub fn sqrt(&self) -> Self {
        SQRT.apply([self])
    }
}
