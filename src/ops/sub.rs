//! `x − y`, element by element; an operand of one element is used for all.

use std::ops;

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const SUB: Pointwise<2> = Pointwise {
    name: "sub",
    function: |[x, y]| x - y,
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [4, 5], -3.0..3.0)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [1], -3.0..3.0)],
            [uniform(1, [], -3.0..3.0), uniform(2, [3], -3.0..3.0)],
        ]
    },
    entry: || SUB.all_cases(),
};

impl ops::Sub<&Var> for &Var {
    type Output = Var;

    #[track_caller]
    fn sub(self, other: &Var) -> Var {
        SUB.apply([self, other])
    }
}

impl ops::Sub<f64> for &Var {
    type Output = Var;

    #[track_caller]
    fn sub(self, number: f64) -> Var {
        SUB.apply([self, &self.number(number)])
    }
}

impl ops::Sub<&Var> for f64 {
    type Output = Var;

    #[track_caller]
    fn sub(self, other: &Var) -> Var {
        SUB.apply([&other.number(self), other])
    }
}
