//! Rows in x86-64 vector registers.

use super::Row;
use core::arch::x86_64::*;

/// Eight and four `f32`.
#[derive(Clone, Copy)]
pub struct Middle32(__m256, __m128);

/// Three times four `f64`.
#[derive(Clone, Copy)]
pub struct Middle64(__m256d, __m256d, __m256d);

/// Eight and four `f64`.
#[derive(Clone, Copy)]
pub struct Wide64(__m512d, __m256d);

impl Row<f32> for __m512 {
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        unsafe { _mm512_loadu_ps(from) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe { _mm512_storeu_ps(to, self) }
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        unsafe { _mm512_set1_ps(value) }
    }

    #[inline(always)]
    unsafe fn nodes([a, b, c]: [f32; 3]) -> Self {
        unsafe {
            let first = _mm512_maskz_mov_ps(0x000f, _mm512_set1_ps(a));
            let second = _mm512_mask_mov_ps(first, 0x00f0, _mm512_set1_ps(b));
            _mm512_mask_mov_ps(second, 0x0f00, _mm512_set1_ps(c))
        }
    }

    #[inline(always)]
    unsafe fn repeat(from: *const f32) -> Self {
        unsafe { _mm512_broadcast_f32x4(_mm_loadu_ps(from)) }
    }

    #[inline(always)]
    unsafe fn without_mass(self) -> Self {
        unsafe { _mm512_maskz_mov_ps(0x7777, self) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        unsafe { _mm512_add_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        unsafe { _mm512_mul_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        unsafe { _mm512_fmadd_ps(self, factor, addend) }
    }

    #[inline(always)]
    unsafe fn fold(self) -> [f32; 4] {
        unsafe {
            let first = _mm512_castps512_ps128(self);
            let second = _mm512_extractf32x4_ps::<1>(self);
            let third = _mm512_extractf32x4_ps::<2>(self);
            let mut sum = [0.0; 4];
            _mm_storeu_ps(sum.as_mut_ptr(), _mm_add_ps(_mm_add_ps(first, second), third));
            sum
        }
    }
}

impl Row<f32> for Middle32 {
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        unsafe { Self(_mm256_loadu_ps(from), _mm_loadu_ps(from.add(8))) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe {
            _mm256_storeu_ps(to, self.0);
            _mm_storeu_ps(to.add(8), self.1);
        }
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        unsafe { Self(_mm256_set1_ps(value), _mm_set1_ps(value)) }
    }

    #[inline(always)]
    unsafe fn nodes([a, b, c]: [f32; 3]) -> Self {
        unsafe { Self(_mm256_blend_ps::<0xf0>(_mm256_set1_ps(a), _mm256_set1_ps(b)), _mm_set1_ps(c)) }
    }

    #[inline(always)]
    unsafe fn repeat(from: *const f32) -> Self {
        unsafe {
            let one = _mm_loadu_ps(from);
            Self(_mm256_set_m128(one, one), one)
        }
    }

    #[inline(always)]
    unsafe fn without_mass(self) -> Self {
        unsafe {
            Self(_mm256_blend_ps::<0x88>(self.0, _mm256_setzero_ps()), _mm_blend_ps::<0x8>(self.1, _mm_setzero_ps()))
        }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        unsafe { Self(_mm256_add_ps(self.0, other.0), _mm_add_ps(self.1, other.1)) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        unsafe { Self(_mm256_mul_ps(self.0, other.0), _mm_mul_ps(self.1, other.1)) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        unsafe { Self(_mm256_fmadd_ps(self.0, factor.0, addend.0), _mm_fmadd_ps(self.1, factor.1, addend.1)) }
    }

    #[inline(always)]
    unsafe fn fold(self) -> [f32; 4] {
        unsafe {
            let first = _mm256_castps256_ps128(self.0);
            let second = _mm256_extractf128_ps::<1>(self.0);
            let mut sum = [0.0; 4];
            _mm_storeu_ps(sum.as_mut_ptr(), _mm_add_ps(_mm_add_ps(first, second), self.1));
            sum
        }
    }
}

impl Row<f64> for Middle64 {
    #[inline(always)]
    unsafe fn load(from: *const f64) -> Self {
        unsafe { Self(_mm256_loadu_pd(from), _mm256_loadu_pd(from.add(4)), _mm256_loadu_pd(from.add(8))) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f64) {
        unsafe {
            _mm256_storeu_pd(to, self.0);
            _mm256_storeu_pd(to.add(4), self.1);
            _mm256_storeu_pd(to.add(8), self.2);
        }
    }

    #[inline(always)]
    unsafe fn splat(value: f64) -> Self {
        unsafe {
            let one = _mm256_set1_pd(value);
            Self(one, one, one)
        }
    }

    #[inline(always)]
    unsafe fn nodes([a, b, c]: [f64; 3]) -> Self {
        unsafe { Self(_mm256_set1_pd(a), _mm256_set1_pd(b), _mm256_set1_pd(c)) }
    }

    #[inline(always)]
    unsafe fn repeat(from: *const f64) -> Self {
        unsafe {
            let one = _mm256_loadu_pd(from);
            Self(one, one, one)
        }
    }

    #[inline(always)]
    unsafe fn without_mass(self) -> Self {
        unsafe {
            let zero = _mm256_setzero_pd();
            Self(
                _mm256_blend_pd::<0x8>(self.0, zero),
                _mm256_blend_pd::<0x8>(self.1, zero),
                _mm256_blend_pd::<0x8>(self.2, zero),
            )
        }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        unsafe { Self(_mm256_add_pd(self.0, other.0), _mm256_add_pd(self.1, other.1), _mm256_add_pd(self.2, other.2)) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        unsafe { Self(_mm256_mul_pd(self.0, other.0), _mm256_mul_pd(self.1, other.1), _mm256_mul_pd(self.2, other.2)) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        unsafe {
            Self(
                _mm256_fmadd_pd(self.0, factor.0, addend.0),
                _mm256_fmadd_pd(self.1, factor.1, addend.1),
                _mm256_fmadd_pd(self.2, factor.2, addend.2),
            )
        }
    }

    #[inline(always)]
    unsafe fn fold(self) -> [f64; 4] {
        unsafe {
            let mut sum = [0.0; 4];
            _mm256_storeu_pd(sum.as_mut_ptr(), _mm256_add_pd(_mm256_add_pd(self.0, self.1), self.2));
            sum
        }
    }
}

impl Row<f64> for Wide64 {
    #[inline(always)]
    unsafe fn load(from: *const f64) -> Self {
        unsafe { Self(_mm512_loadu_pd(from), _mm256_loadu_pd(from.add(8))) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f64) {
        unsafe {
            _mm512_storeu_pd(to, self.0);
            _mm256_storeu_pd(to.add(8), self.1);
        }
    }

    #[inline(always)]
    unsafe fn splat(value: f64) -> Self {
        unsafe { Self(_mm512_set1_pd(value), _mm256_set1_pd(value)) }
    }

    #[inline(always)]
    unsafe fn nodes([a, b, c]: [f64; 3]) -> Self {
        unsafe { Self(_mm512_mask_mov_pd(_mm512_set1_pd(a), 0xf0, _mm512_set1_pd(b)), _mm256_set1_pd(c)) }
    }

    #[inline(always)]
    unsafe fn repeat(from: *const f64) -> Self {
        unsafe {
            let one = _mm256_loadu_pd(from);
            Self(_mm512_broadcast_f64x4(one), one)
        }
    }

    #[inline(always)]
    unsafe fn without_mass(self) -> Self {
        unsafe { Self(_mm512_maskz_mov_pd(0x77, self.0), _mm256_blend_pd::<0x8>(self.1, _mm256_setzero_pd())) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        unsafe { Self(_mm512_add_pd(self.0, other.0), _mm256_add_pd(self.1, other.1)) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        unsafe { Self(_mm512_mul_pd(self.0, other.0), _mm256_mul_pd(self.1, other.1)) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        unsafe { Self(_mm512_fmadd_pd(self.0, factor.0, addend.0), _mm256_fmadd_pd(self.1, factor.1, addend.1)) }
    }

    #[inline(always)]
    unsafe fn fold(self) -> [f64; 4] {
        unsafe {
            let first = _mm512_castpd512_pd256(self.0);
            let second = _mm512_extractf64x4_pd::<1>(self.0);
            let mut sum = [0.0; 4];
            _mm256_storeu_pd(sum.as_mut_ptr(), _mm256_add_pd(_mm256_add_pd(first, second), self.1));
            sum
        }
    }
}
