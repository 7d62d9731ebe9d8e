//! `x / y`, element by element; an operand of one element is used for all.

use std::ops;

use crate::Var;
use crate::ops::{Pointwise, uniform};

pub(super) const DIV: Pointwise<2> = Pointwise {
    name: "div",
    function: |[x, y]| x / y,
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [4, 5], 0.5..3.0)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [1], 0.5..3.0)],
            [uniform(1, [], -3.0..3.0), uniform(2, [3], 0.5..3.0)],
        ]
    },
    entry: || DIV.all_cases(),
};

impl ops::Div<&Var> for &Var {
    type Output = Var;

    #[track_caller]
    fn div(self, other: &Var) -> Var {
        DIV.apply([self, other])
    }
}

impl ops::Div<f64> for &Var {
    type Output = Var;

    #[track_caller]
    fn div(self, number: f64) -> Var {
        DIV.apply([self, &self.number(number)])
    }
}

impl ops::Div<&Var> for f64 {
    type Output = Var;

    #[track_caller]
    fn div(self, other: &Var) -> Var {
        DIV.apply([&other.number(self), other])
    }
}
