//! Vectors as plain arrays: what runs where no instruction set is written out by hand.
//!
//! Eight elements, so that the compiler can put them into whatever registers the target has. Products and sums are
//! rounded separately: a fused multiply-add without hardware for it is a slow library call.

use super::exp_ln::{Lane32, single_precision};
use super::lanes::{Lane, elementwise};

/// Eight numbers.
#[derive(Clone, Copy)]
pub struct Portable<T>([T; 8]);

macro_rules! each_of {
    ($($name:ident($($b:ident),*) |$x:ident| $value:expr;)*) => {$(
        #[inline(always)]
        unsafe fn $name(self $(, $b: Self)*) -> Self {
            let mut result = self;
            for i in 0..8 {
                let $x = self.0[i];
                $(let $b = $b.0[i];)*
                result.0[i] = $value;
            }
            result
        }
    )*};
}

macro_rules! portable {
    ($float:ident { $($functions:tt)* }) => {
        impl Lane for Portable<$float> {
            type Element = $float;
            const WIDTH: usize = 8;
            // registers of 16 bytes: 32 of them on 64-bit ARM, 16 elsewhere
            const REGISTERS: usize = if cfg!(target_arch = "aarch64") { 64 } else { 32 } / size_of::<$float>();

            const SIDE: usize = 4;

            #[inline(always)]
            unsafe fn transpose(rows: &[*const $float; 8], to: *mut $float, stride: usize) {
                for c in 0..4 {
                    for r in 0..4 {
                        // SAFETY: the caller promises four readable rows and four writable ones.
                        unsafe { *to.add(c * stride + r) = *rows[r].add(c) };
                    }
                }
            }

            #[inline(always)]
            unsafe fn load(from: *const $float) -> Self {
                // SAFETY: the caller promises eight readable values.
                Self(unsafe { from.cast::<[$float; 8]>().read_unaligned() })
            }

            #[inline(always)]
            unsafe fn store(self, to: *mut $float) {
                // SAFETY: the caller promises eight writable values.
                unsafe { to.cast::<[$float; 8]>().write_unaligned(self.0) }
            }

            #[inline(always)]
            unsafe fn splat(x: $float) -> Self {
                Self([x; 8])
            }

            each_of! {
                add(b) |x| x + b;
                sub(b) |x| x - b;
                mul(b) |x| x * b;
                div(b) |x| x / b;
                abs() |x| x.abs();
                floor() |x| x.floor();
                sqrt() |x| x.sqrt();
                mul_add(b, c) |x| x * b + c;
                mul_sub(b, c) |x| x * b - c;
                neg_mul_add(b, c) |x| c - x * b;
                smaller(b) |x| if x < b { x } else { b };
                larger(b) |x| if x > b { x } else { b };
                lt(b) |x| if x < b { 1.0 } else { 0.0 };
                le(b) |x| if x <= b { 1.0 } else { 0.0 };
                is_nan() |x| if x.is_nan() { 1.0 } else { 0.0 };
                choose(a, b) |x| if x != 0.0 { a } else { b };
                if_less(a, b, other) |x| if a < b { x } else { other };
            }

            #[inline(always)]
            unsafe fn any(self) -> bool {
                self.0 != [0.0; 8]
            }

            $($functions)*
        }
    };
}

portable!(f32 { single_precision!(); });
portable!(f64 { elementwise!(exp, ln, exp_m1, ln_1p, sin, cos, tanh, logistic, softplus, erf); });

impl Lane32 for Portable<f32> {
    #[inline(always)]
    unsafe fn all(self) -> bool {
        self.0 == [1.0; 8]
    }

    each_of! {
        shift_into_exponent() |x| f32::from_bits(x.to_bits().wrapping_add(127) << 23);
        exponent() |x| ((x.to_bits().wrapping_sub(super::exp_ln::SQRT_HALF).cast_signed()) >> 23) as f32;
        mantissa() |x| {
            let bits = x.to_bits();
            let exponent = bits.wrapping_sub(super::exp_ln::SQRT_HALF).cast_signed() >> 23;
            f32::from_bits(bits.wrapping_sub(exponent.cast_unsigned() << 23))
        };
    }
}
