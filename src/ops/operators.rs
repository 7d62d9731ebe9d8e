//! `+ − * /` and negation for variables by value: what is written for references, for every mixture.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::Var;

macro_rules! by_value {
    ($($operator:ident $method:ident;)*) => {$(
        impl $operator for Var {
            type Output = Var;

            #[track_caller]
            fn $method(self, other: Var) -> Var {
                (&self).$method(&other)
            }
        }

        impl $operator<&Var> for Var {
            type Output = Var;

            #[track_caller]
            fn $method(self, other: &Var) -> Var {
                (&self).$method(other)
            }
        }

        impl $operator<Var> for &Var {
            type Output = Var;

            #[track_caller]
            fn $method(self, other: Var) -> Var {
                self.$method(&other)
            }
        }

        impl $operator<f64> for Var {
            type Output = Var;

            #[track_caller]
            fn $method(self, number: f64) -> Var {
                (&self).$method(number)
            }
        }

        impl $operator<Var> for f64 {
            type Output = Var;

            #[track_caller]
            fn $method(self, other: Var) -> Var {
                self.$method(&other)
            }
        }
    )*};
}

by_value! {
    Add add;
    Sub sub;
    Mul mul;
    Div div;
}

impl Neg for Var {
    type Output = Var;

    #[track_caller]
    fn neg(self) -> Var {
        -&self
    }
}
