//! `+ − * /`, negation and sums of [`Scalar`], with `f64` allowed on either side.

use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

use super::handle::Scalar;
use super::instruction::{Binary, Unary};
use super::trace;

macro_rules! operators {
    ($($operator:ident $method:ident $assign:ident $assign_method:ident;)*) => {$(
        impl $operator for Scalar {
            type Output = Self;
            #[track_caller]
            fn $method(self, b: Self) -> Self {
                trace::binary(Binary::$operator, self, b)
            }
        }

        impl $operator<f64> for Scalar {
            type Output = Self;
            #[track_caller]
            fn $method(self, b: f64) -> Self {
                trace::binary(Binary::$operator, self, b.into())
            }
        }

        impl $operator<Scalar> for f64 {
            type Output = Scalar;
            #[track_caller]
            fn $method(self, b: Scalar) -> Scalar {
                trace::binary(Binary::$operator, self.into(), b)
            }
        }

        impl<B> $assign<B> for Scalar
        where
            Scalar: $operator<B, Output = Scalar>,
        {
            #[track_caller]
            fn $assign_method(&mut self, b: B) {
                *self = $operator::$method(*self, b);
            }
        }
    )*};
}

operators! {
    Add add AddAssign add_assign;
    Sub sub SubAssign sub_assign;
    Mul mul MulAssign mul_assign;
    Div div DivAssign div_assign;
}

impl Neg for Scalar {
    type Output = Self;
    #[track_caller]
    fn neg(self) -> Self {
        trace::unary(Unary::Neg, self)
    }
}

impl Sum for Scalar {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(0.0.into(), |sum, term| sum + term)
    }
}
