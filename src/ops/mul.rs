//! `x · y`, element by element; an operand of one element is used for all.

use std::ops;

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const MUL: Pointwise<2> = Pointwise {
    name: "mul",
    function: |[x, y]| x * y,
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [4, 5], -3.0..3.0)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [1], -3.0..3.0)],
            [uniform(1, [], -3.0..3.0), uniform(2, [3], -3.0..3.0)],
        ]
    },
    entry: || MUL.all_cases(),
};

impl ops::Mul<&Var> for &Var {
    type Output = Var;

    #[track_caller]
    fn mul(self, other: &Var) -> Var {
        MUL.apply([self, other])
    }
}

impl ops::Mul<f64> for &Var {
    type Output = Var;

    #[track_caller]
    fn mul(self, number: f64) -> Var {
        MUL.apply([self, &self.number(number)])
    }
}

impl ops::Mul<&Var> for f64 {
    type Output = Var;

    #[track_caller]
    fn mul(self, other: &Var) -> Var {
        MUL.apply([&other.number(self), other])
    }
}
