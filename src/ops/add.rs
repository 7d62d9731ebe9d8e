//! `x + y`, element by element; an operand of one element is used for all.

use std::ops;

use crate::ops::{Pointwise, uniform};
use crate::{Device, Tensor, Var};

pub(super) const ADD: Pointwise<2> = Pointwise {
    name: "add",
    function: |[x, y]| x + y,
    cases: || {
        vec![
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [4, 5], -3.0..3.0)],
            [uniform(1, [4, 5], -3.0..3.0), uniform(2, [1], -3.0..3.0)],
            [uniform(1, [], -3.0..3.0), uniform(2, [3], -3.0..3.0)],
        ]
    },
    entry: || ADD.all_cases(),
};

impl ops::Add<&Var> for &Var {
    type Output = Var;

    #[track_caller]
    fn add(self, other: &Var) -> Var {
        ADD.apply([self, other])
    }
}

impl ops::Add<f64> for &Var {
    type Output = Var;

    #[track_caller]
    fn add(self, number: f64) -> Var {
        ADD.apply([self, &self.number(number)])
    }
}

impl ops::Add<&Var> for f64 {
    type Output = Var;

    #[track_caller]
    fn add(self, other: &Var) -> Var {
        ADD.apply([&other.number(self), other])
    }
}

impl Var {
    /// A constant of the same dtype on the same device: the partner of `x + 1.0`.
    pub(super) fn number(&self, number: f64) -> Self {
        let (value, device) = (Tensor::scalar(number, self.dtype()), self.device());
        if device == Device::Cpu {
            return self.tape().constant(value);
        }
        match value.to_device(&device) {
            Ok(value) => self.tape().constant(value),
            Err(fault) => {
                self.tape().keep_fault(fault);
                self.tape().constant(value)
            }
        }
    }
}
