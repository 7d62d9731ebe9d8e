//! Vectors of 64-bit ARM: NEON, which has fused multiply-add.

// NEON is part of the baseline of most targets, where its intrinsics are safe to call
#![allow(clippy::wildcard_imports, unused_unsafe)]

use std::arch::aarch64::*;

use super::exp_ln::{Lane32, SQRT_HALF, single_precision};
use super::lanes::{Lane, elementwise, memory, methods};

/// Four `f32`.
#[derive(Clone, Copy)]
pub struct F32x4(float32x4_t);
/// Two `f64`.
#[derive(Clone, Copy)]
pub struct F64x2(float64x2_t);

macro_rules! lane {
    (
        $name:ident: $float:ident x $width:literal, $transpose:ident
        $load:ident $store:ident $splat:ident $add:ident $sub:ident $mul:ident $div:ident $sqrt:ident
        $neg:ident $abs:ident $floor:ident $fma:ident $fms:ident $lt:ident $le:ident $eq:ident $zero:ident $select:ident
        $and:ident $without:ident $bits:ident $number:ident { $($rest:tt)* }
    ) => {
        impl Lane for $name {
            type Element = $float;
            const WIDTH: usize = $width;
            const REGISTERS: usize = 32;
            const SIDE: usize = 4;

            memory!($float: $load $store $splat $transpose);

            methods! {
                add(b) |x| $add(x, b);
                sub(b) |x| $sub(x, b);
                mul(b) |x| $mul(x, b);
                div(b) |x| $div(x, b);
                sqrt() |x| $sqrt(x);
                abs() |x| $abs(x);
                floor() |x| $floor(x);
                mul_add(b, c) |x| $fma(c, x, b);
                mul_sub(b, c) |x| $fma($neg(c), x, b);
                neg_mul_add(b, c) |x| $fms(c, x, b);
                // the instructions of these names give NaN for NaN
                smaller(b) |x| $select($lt(x, b), x, b);
                larger(b) |x| $select($lt(b, x), x, b);
                lt(b) |x| $number($and($lt(x, b), $bits($splat(1.0))));
                le(b) |x| $number($and($le(x, b), $bits($splat(1.0))));
                is_nan() |x| $number($without($bits($splat(1.0)), $eq(x, x)));
                choose(a, b) |x| $select($zero(x), b, a);
                if_less(a, b, other) |x| $select($lt(a, b), x, other);
            }

            $($rest)*
        }
    };
}

lane!(F32x4: f32 x 4, transpose32
    vld1q_f32 vst1q_f32 vdupq_n_f32 vaddq_f32 vsubq_f32 vmulq_f32 vdivq_f32 vsqrtq_f32
    vnegq_f32 vabsq_f32 vrndmq_f32 vfmaq_f32 vfmsq_f32 vcltq_f32 vcleq_f32 vceqq_f32 vceqzq_f32 vbslq_f32
    vandq_u32 vbicq_u32 vreinterpretq_u32_f32 vreinterpretq_f32_u32 {
    single_precision!();

    #[inline(always)]
    unsafe fn any(self) -> bool {
        // SAFETY: the contract of `Lane`.
        unsafe { vminvq_u32(vceqzq_f32(self.0)) == 0 }
    }
});

lane!(F64x2: f64 x 2, transpose64
    vld1q_f64 vst1q_f64 vdupq_n_f64 vaddq_f64 vsubq_f64 vmulq_f64 vdivq_f64 vsqrtq_f64
    vnegq_f64 vabsq_f64 vrndmq_f64 vfmaq_f64 vfmsq_f64 vcltq_f64 vcleq_f64 vceqq_f64 vceqzq_f64 vbslq_f64
    vandq_u64 vbicq_u64 vreinterpretq_u64_f64 vreinterpretq_f64_u64 {
    elementwise!(exp, ln, exp_m1, ln_1p, sin, cos, tanh, logistic, softplus, erf);

    #[inline(always)]
    unsafe fn any(self) -> bool {
        // SAFETY: the contract of `Lane`.
        unsafe {
            let zero = vceqzq_f64(self.0);
            vgetq_lane_u64::<0>(zero) & vgetq_lane_u64::<1>(zero) == 0
        }
    }
});

impl Lane32 for F32x4 {
    #[inline(always)]
    unsafe fn all(self) -> bool {
        // SAFETY: the contract of `Lane`.
        unsafe { vmaxvq_u32(vceqzq_f32(self.0)) == 0 }
    }

    methods! {
        shift_into_exponent() |x| {
            let bits = vaddq_s32(vreinterpretq_s32_f32(x), vdupq_n_s32(127));
            vreinterpretq_f32_s32(vshlq_n_s32::<23>(bits))
        };
        exponent() |x| {
            let above = vsubq_s32(vreinterpretq_s32_f32(x), vdupq_n_s32(SQRT_HALF.cast_signed()));
            vcvtq_f32_s32(vshrq_n_s32::<23>(above))
        };
        mantissa() |x| {
            let bits = vreinterpretq_s32_f32(x);
            let above = vsubq_s32(bits, vdupq_n_s32(SQRT_HALF.cast_signed()));
            let exponent = vshlq_n_s32::<23>(vshrq_n_s32::<23>(above));
            vreinterpretq_f32_s32(vsubq_s32(bits, exponent))
        };
    }
}

/// Rows of a 4×4 square of `f32` as columns: pairs, then the halves of a vector change places.
#[inline(always)]
unsafe fn transpose32(rows: &[*const f32; 8], to: *mut f32, stride: usize) {
    // SAFETY: the contract of `Lane::transpose`.
    unsafe {
        let (a, b) = (vld1q_f32(rows[0]), vld1q_f32(rows[1]));
        let (c, d) = (vld1q_f32(rows[2]), vld1q_f32(rows[3]));
        let (ab, cd) = (vreinterpretq_f64_f32(vtrn1q_f32(a, b)), vreinterpretq_f64_f32(vtrn1q_f32(c, d)));
        let (ba, dc) = (vreinterpretq_f64_f32(vtrn2q_f32(a, b)), vreinterpretq_f64_f32(vtrn2q_f32(c, d)));
        // in the order of the rows: a row may reach into the next ones, which are written after it
        vst1q_f32(to, vreinterpretq_f32_f64(vtrn1q_f64(ab, cd)));
        vst1q_f32(to.add(stride), vreinterpretq_f32_f64(vtrn1q_f64(ba, dc)));
        vst1q_f32(to.add(2 * stride), vreinterpretq_f32_f64(vtrn2q_f64(ab, cd)));
        vst1q_f32(to.add(3 * stride), vreinterpretq_f32_f64(vtrn2q_f64(ba, dc)));
    }
}

/// Rows of a 4×4 square of `f64` as columns, made of four squares of 2×2.
#[inline(always)]
unsafe fn transpose64(rows: &[*const f64; 8], to: *mut f64, stride: usize) {
    // SAFETY: the contract of `Lane::transpose`.
    unsafe {
        let mut halves = [[vdupq_n_f64(0.0); 2]; 4];
        for c in 0..2 {
            for r in 0..2 {
                let (a, b) = (vld1q_f64(rows[2 * r].add(2 * c)), vld1q_f64(rows[2 * r + 1].add(2 * c)));
                halves[2 * c][r] = vtrn1q_f64(a, b);
                halves[2 * c + 1][r] = vtrn2q_f64(a, b);
            }
        }
        // in the order of the rows, as above
        for c in 0..4 {
            vst1q_f64(to.add(c * stride), halves[c][0]);
            vst1q_f64(to.add(c * stride + 2), halves[c][1]);
        }
    }
}
