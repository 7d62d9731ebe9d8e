//! `neg`: `−x`.

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const NEG: Pointwise<1> = Pointwise {
    name: "neg",
    function: |[x]| -x,
    cases: || vec![[uniform(1, [4, 5], -3.0..3.0)]],
    entry: || NEG.all_cases(),
};

impl std::ops::Neg for &Var {
    type Output = Var;

    #[track_caller]
    fn neg(self) -> Var {
        NEG.apply([self])
    }
}
