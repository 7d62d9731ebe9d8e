//! Vectors of the x86-64 instruction sets: AVX2 with FMA, and AVX-512F.

#![allow(clippy::wildcard_imports)]

use std::arch::x86_64::*;

use super::exp_ln::{Lane32, SQRT_HALF, single_precision};
use super::lanes::{Lane, elementwise, memory, methods};

/// Eight `f32`.
#[derive(Clone, Copy)]
pub struct F32x8(__m256);
/// Four `f64`.
#[derive(Clone, Copy)]
pub struct F64x4(__m256d);
/// Sixteen `f32`.
#[derive(Clone, Copy)]
pub struct F32x16(__m512);
/// Eight `f64`.
#[derive(Clone, Copy)]
pub struct F64x8(__m512d);

macro_rules! lane {
    (
        $name:ident: $float:ident x $width:literal in $registers:literal, $transpose:ident of $side:literal
        $load:ident $store:ident $splat:ident $add:ident $sub:ident $mul:ident $div:ident $sqrt:ident
        $fmadd:ident $fmsub:ident $fnmadd:ident $min:ident $max:ident { $($rest:tt)* }
    ) => {
        impl Lane for $name {
            type Element = $float;
            const WIDTH: usize = $width;
            const REGISTERS: usize = $registers;

            const SIDE: usize = $side;

            memory!($float: $load $store $splat $transpose);

            methods! {
                add(b) |x| $add(x, b);
                sub(b) |x| $sub(x, b);
                mul(b) |x| $mul(x, b);
                div(b) |x| $div(x, b);
                sqrt() |x| $sqrt(x);
                mul_add(b, c) |x| $fmadd(x, b, c);
                mul_sub(b, c) |x| $fmsub(x, b, c);
                neg_mul_add(b, c) |x| $fnmadd(x, b, c);
                smaller(b) |x| $min(x, b);
                larger(b) |x| $max(x, b);
            }

            $($rest)*
        }
    };
}

lane!(F32x8: f32 x 8 in 16, transpose32 of 8
    _mm256_loadu_ps _mm256_storeu_ps _mm256_set1_ps _mm256_add_ps _mm256_sub_ps _mm256_mul_ps _mm256_div_ps
    _mm256_sqrt_ps _mm256_fmadd_ps _mm256_fmsub_ps _mm256_fnmadd_ps _mm256_min_ps _mm256_max_ps {
    methods! {
        abs() |x| _mm256_andnot_ps(_mm256_set1_ps(-0.0), x);
        floor() |x| _mm256_floor_ps(x);
        lt(b) |x| _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(x, b), _mm256_set1_ps(1.0));
        le(b) |x| _mm256_and_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(x, b), _mm256_set1_ps(1.0));
        is_nan() |x| _mm256_and_ps(_mm256_cmp_ps::<_CMP_UNORD_Q>(x, x), _mm256_set1_ps(1.0));
        choose(a, b) |x| _mm256_blendv_ps(b, a, _mm256_cmp_ps::<_CMP_NEQ_UQ>(x, _mm256_setzero_ps()));
    }
    single_precision!();
    methods! {
        if_less(a, b, other) |x| _mm256_blendv_ps(other, x, _mm256_cmp_ps::<_CMP_LT_OQ>(a, b));
    }

    #[inline(always)]
    unsafe fn any(self) -> bool {
        // SAFETY: the contract of `Lane`.
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_NEQ_UQ>(self.0, _mm256_setzero_ps())) != 0 }
    }
});

lane!(F64x4: f64 x 4 in 16, transpose64 of 4
    _mm256_loadu_pd _mm256_storeu_pd _mm256_set1_pd _mm256_add_pd _mm256_sub_pd _mm256_mul_pd _mm256_div_pd
    _mm256_sqrt_pd _mm256_fmadd_pd _mm256_fmsub_pd _mm256_fnmadd_pd _mm256_min_pd _mm256_max_pd {
    methods! {
        abs() |x| _mm256_andnot_pd(_mm256_set1_pd(-0.0), x);
        floor() |x| _mm256_floor_pd(x);
        lt(b) |x| _mm256_and_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(x, b), _mm256_set1_pd(1.0));
        le(b) |x| _mm256_and_pd(_mm256_cmp_pd::<_CMP_LE_OQ>(x, b), _mm256_set1_pd(1.0));
        is_nan() |x| _mm256_and_pd(_mm256_cmp_pd::<_CMP_UNORD_Q>(x, x), _mm256_set1_pd(1.0));
        choose(a, b) |x| _mm256_blendv_pd(b, a, _mm256_cmp_pd::<_CMP_NEQ_UQ>(x, _mm256_setzero_pd()));
    }
    elementwise!(exp, ln, exp_m1, ln_1p, sin, cos, tanh, logistic, softplus, erf);
    methods! {
        if_less(a, b, other) |x| _mm256_blendv_pd(other, x, _mm256_cmp_pd::<_CMP_LT_OQ>(a, b));
    }

    #[inline(always)]
    unsafe fn any(self) -> bool {
        // SAFETY: the contract of `Lane`.
        unsafe { _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_NEQ_UQ>(self.0, _mm256_setzero_pd())) != 0 }
    }
});

lane!(F32x16: f32 x 16 in 32, transpose32 of 8
    _mm512_loadu_ps _mm512_storeu_ps _mm512_set1_ps _mm512_add_ps _mm512_sub_ps _mm512_mul_ps _mm512_div_ps
    _mm512_sqrt_ps _mm512_fmadd_ps _mm512_fmsub_ps _mm512_fnmadd_ps _mm512_min_ps _mm512_max_ps {
    methods! {
        abs() |x| _mm512_abs_ps(x);
        floor() |x| _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(x);
        lt(b) |x| _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(x, b), _mm512_set1_ps(1.0));
        le(b) |x| _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(x, b), _mm512_set1_ps(1.0));
        is_nan() |x| _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_UNORD_Q>(x, x), _mm512_set1_ps(1.0));
        choose(a, b) |x|
            _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_NEQ_UQ>(x, _mm512_setzero_ps()), b, a);
    }
    single_precision!();
    methods! {
        if_less(a, b, other) |x| _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b), other, x);
        rsqrt() |x| {
            // 14 bits, and one step of Newton's: r (3 − x r²)/2
            let r = _mm512_rsqrt14_ps(x);
            let half = _mm512_mul_ps(r, _mm512_set1_ps(0.5));
            let rest = _mm512_fnmadd_ps(_mm512_mul_ps(x, r), r, _mm512_set1_ps(1.0));
            _mm512_fmadd_ps(rest, half, r)
        };
    }

    #[inline(always)]
    unsafe fn any(self) -> bool {
        // SAFETY: the contract of `Lane`.
        unsafe { _mm512_cmp_ps_mask::<_CMP_NEQ_UQ>(self.0, _mm512_setzero_ps()) != 0 }
    }
});

lane!(F64x8: f64 x 8 in 32, transpose64 of 4
    _mm512_loadu_pd _mm512_storeu_pd _mm512_set1_pd _mm512_add_pd _mm512_sub_pd _mm512_mul_pd _mm512_div_pd
    _mm512_sqrt_pd _mm512_fmadd_pd _mm512_fmsub_pd _mm512_fnmadd_pd _mm512_min_pd _mm512_max_pd {
    methods! {
        abs() |x| _mm512_abs_pd(x);
        floor() |x| _mm512_roundscale_pd::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(x);
        lt(b) |x| _mm512_maskz_mov_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(x, b), _mm512_set1_pd(1.0));
        le(b) |x| _mm512_maskz_mov_pd(_mm512_cmp_pd_mask::<_CMP_LE_OQ>(x, b), _mm512_set1_pd(1.0));
        is_nan() |x| _mm512_maskz_mov_pd(_mm512_cmp_pd_mask::<_CMP_UNORD_Q>(x, x), _mm512_set1_pd(1.0));
        choose(a, b) |x|
            _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_NEQ_UQ>(x, _mm512_setzero_pd()), b, a);
    }
    elementwise!(exp, ln, exp_m1, ln_1p, sin, cos, tanh, logistic, softplus, erf);
    methods! {
        if_less(a, b, other) |x| _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b), other, x);
    }

    #[inline(always)]
    unsafe fn any(self) -> bool {
        // SAFETY: the contract of `Lane`.
        unsafe { _mm512_cmp_pd_mask::<_CMP_NEQ_UQ>(self.0, _mm512_setzero_pd()) != 0 }
    }
});

impl Lane32 for F32x8 {
    #[inline(always)]
    unsafe fn all(self) -> bool {
        // SAFETY: the contract of `Lane`.
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_NEQ_UQ>(self.0, _mm256_setzero_ps())) == 0xff }
    }

    methods! {
        shift_into_exponent() |x| {
            let bits = _mm256_add_epi32(_mm256_castps_si256(x), _mm256_set1_epi32(127));
            _mm256_castsi256_ps(_mm256_slli_epi32::<23>(bits))
        };
        exponent() |x| {
            let above = _mm256_sub_epi32(_mm256_castps_si256(x), _mm256_set1_epi32(SQRT_HALF.cast_signed()));
            _mm256_cvtepi32_ps(_mm256_srai_epi32::<23>(above))
        };
        mantissa() |x| {
            let bits = _mm256_castps_si256(x);
            let above = _mm256_sub_epi32(bits, _mm256_set1_epi32(SQRT_HALF.cast_signed()));
            let exponent = _mm256_slli_epi32::<23>(_mm256_srai_epi32::<23>(above));
            _mm256_castsi256_ps(_mm256_sub_epi32(bits, exponent))
        };
    }
}

impl Lane32 for F32x16 {
    #[inline(always)]
    unsafe fn all(self) -> bool {
        // SAFETY: the contract of `Lane`.
        unsafe { _mm512_cmp_ps_mask::<_CMP_NEQ_UQ>(self.0, _mm512_setzero_ps()) == 0xffff }
    }

    methods! {
        times_two_to_the(n) |x| _mm512_scalef_ps(x, n);
        shift_into_exponent() |x| {
            let bits = _mm512_add_epi32(_mm512_castps_si512(x), _mm512_set1_epi32(127));
            _mm512_castsi512_ps(_mm512_slli_epi32::<23>(bits))
        };
        exponent() |x| {
            let above = _mm512_sub_epi32(_mm512_castps_si512(x), _mm512_set1_epi32(SQRT_HALF.cast_signed()));
            _mm512_cvtepi32_ps(_mm512_srai_epi32::<23>(above))
        };
        mantissa() |x| {
            let bits = _mm512_castps_si512(x);
            let above = _mm512_sub_epi32(bits, _mm512_set1_epi32(SQRT_HALF.cast_signed()));
            let exponent = _mm512_slli_epi32::<23>(_mm512_srai_epi32::<23>(above));
            _mm512_castsi512_ps(_mm512_sub_epi32(bits, exponent))
        };
    }
}

/// Rows of an 8×8 square of `f32` as columns: pairs, then fours, then the halves of a vector change places.
#[inline(always)]
unsafe fn transpose32(rows: &[*const f32; 8], to: *mut f32, stride: usize) {
    // SAFETY: the contract of `Lane::transpose`.
    unsafe {
        let (mut x, mut y) = ([_mm256_setzero_ps(); 8], [_mm256_setzero_ps(); 8]);
        for r in 0..8 {
            x[r] = _mm256_loadu_ps(rows[r]);
        }
        for r in 0..4 {
            y[2 * r] = _mm256_unpacklo_ps(x[2 * r], x[2 * r + 1]);
            y[2 * r + 1] = _mm256_unpackhi_ps(x[2 * r], x[2 * r + 1]);
        }
        for r in 0..2 {
            x[4 * r] = _mm256_shuffle_ps::<0x44>(y[4 * r], y[4 * r + 2]);
            x[4 * r + 1] = _mm256_shuffle_ps::<0xee>(y[4 * r], y[4 * r + 2]);
            x[4 * r + 2] = _mm256_shuffle_ps::<0x44>(y[4 * r + 1], y[4 * r + 3]);
            x[4 * r + 3] = _mm256_shuffle_ps::<0xee>(y[4 * r + 1], y[4 * r + 3]);
        }
        // in the order of the rows: a row may reach into the next ones, which are written after it
        for c in 0..4 {
            _mm256_storeu_ps(to.add(c * stride), _mm256_permute2f128_ps::<0x20>(x[c], x[c + 4]));
        }
        for c in 0..4 {
            _mm256_storeu_ps(to.add((c + 4) * stride), _mm256_permute2f128_ps::<0x31>(x[c], x[c + 4]));
        }
    }
}

/// Rows of a 4×4 square of `f64` as columns.
#[inline(always)]
unsafe fn transpose64(rows: &[*const f64; 8], to: *mut f64, stride: usize) {
    // SAFETY: the contract of `Lane::transpose`.
    unsafe {
        let (a, b) = (_mm256_loadu_pd(rows[0]), _mm256_loadu_pd(rows[1]));
        let (c, d) = (_mm256_loadu_pd(rows[2]), _mm256_loadu_pd(rows[3]));
        let (ab, cd) = (_mm256_unpacklo_pd(a, b), _mm256_unpacklo_pd(c, d));
        let (ba, dc) = (_mm256_unpackhi_pd(a, b), _mm256_unpackhi_pd(c, d));
        _mm256_storeu_pd(to, _mm256_permute2f128_pd::<0x20>(ab, cd));
        _mm256_storeu_pd(to.add(stride), _mm256_permute2f128_pd::<0x20>(ba, dc));
        _mm256_storeu_pd(to.add(2 * stride), _mm256_permute2f128_pd::<0x31>(ab, cd));
        _mm256_storeu_pd(to.add(3 * stride), _mm256_permute2f128_pd::<0x31>(ba, dc));
    }
}
