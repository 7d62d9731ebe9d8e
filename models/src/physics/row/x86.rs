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
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { _mm512_loadu_ps(from) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { _mm512_storeu_ps(to, self) }
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { _mm512_set1_ps(value) }
    }

    #[inline(always)]
    unsafe fn nodes([a, b, c]: [f32; 3]) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            let first = _mm512_maskz_mov_ps(0x000f, _mm512_set1_ps(a));
            let second = _mm512_mask_mov_ps(first, 0x00f0, _mm512_set1_ps(b));
            _mm512_mask_mov_ps(second, 0x0f00, _mm512_set1_ps(c))
        }
    }

    #[inline(always)]
    unsafe fn repeat(from: *const f32) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { _mm512_broadcast_f32x4(_mm_loadu_ps(from)) }
    }

    #[inline(always)]
    unsafe fn without_mass(self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { _mm512_maskz_mov_ps(0x7777, self) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { _mm512_add_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { _mm512_mul_ps(self, other) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { _mm512_fmadd_ps(self, factor, addend) }
    }

    #[inline(always)]
    unsafe fn fold([a, b, c, d]: [Self; 4]) -> [f32; 16] {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            // two rows at a time: concatenate their first halves, add their second halves without the fourth node
            let ab = _mm512_shuffle_f32x4::<0x44>(a, b);
            let ab = _mm512_add_ps(ab, _mm512_maskz_shuffle_f32x4::<0xee>(0x0f0f, a, b));
            let cd = _mm512_shuffle_f32x4::<0x44>(c, d);
            let cd = _mm512_add_ps(cd, _mm512_maskz_shuffle_f32x4::<0xee>(0x0f0f, c, d));
            let sums = _mm512_add_ps(_mm512_shuffle_f32x4::<0x88>(ab, cd), _mm512_shuffle_f32x4::<0xdd>(ab, cd));
            let mut out = [0.0; 16];
            _mm512_storeu_ps(out.as_mut_ptr(), sums);
            out
        }
    }

    #[inline(always)]
    unsafe fn turn(from: [*const f32; 4], to: [*mut f32; 4]) {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { turn32(from, to) }
    }
}

impl Row<f32> for Middle32 {
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_loadu_ps(from), _mm_loadu_ps(from.add(8))) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            _mm256_storeu_ps(to, self.0);
            _mm_storeu_ps(to.add(8), self.1);
        }
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_set1_ps(value), _mm_set1_ps(value)) }
    }

    #[inline(always)]
    unsafe fn nodes([a, b, c]: [f32; 3]) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_blend_ps::<0xf0>(_mm256_set1_ps(a), _mm256_set1_ps(b)), _mm_set1_ps(c)) }
    }

    #[inline(always)]
    unsafe fn repeat(from: *const f32) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            let one = _mm_loadu_ps(from);
            Self(_mm256_set_m128(one, one), one)
        }
    }

    #[inline(always)]
    unsafe fn without_mass(self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            Self(_mm256_blend_ps::<0x88>(self.0, _mm256_setzero_ps()), _mm_blend_ps::<0x8>(self.1, _mm_setzero_ps()))
        }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_add_ps(self.0, other.0), _mm_add_ps(self.1, other.1)) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_mul_ps(self.0, other.0), _mm_mul_ps(self.1, other.1)) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_fmadd_ps(self.0, factor.0, addend.0), _mm_fmadd_ps(self.1, factor.1, addend.1)) }
    }

    #[inline(always)]
    unsafe fn fold(rows: [Self; 4]) -> [f32; 16] {
        let mut out = [0.0; 16];
        for (k, Self(two, third)) in rows.into_iter().enumerate() {
            // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
            unsafe {
                let both = _mm_add_ps(_mm256_castps256_ps128(two), _mm256_extractf128_ps::<1>(two));
                _mm_storeu_ps(out.as_mut_ptr().add(4 * k), _mm_add_ps(both, third));
            }
        }
        out
    }

    #[inline(always)]
    unsafe fn turn(from: [*const f32; 4], to: [*mut f32; 4]) {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { turn32(from, to) }
    }
}

impl Row<f64> for Middle64 {
    #[inline(always)]
    unsafe fn load(from: *const f64) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_loadu_pd(from), _mm256_loadu_pd(from.add(4)), _mm256_loadu_pd(from.add(8))) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f64) {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            _mm256_storeu_pd(to, self.0);
            _mm256_storeu_pd(to.add(4), self.1);
            _mm256_storeu_pd(to.add(8), self.2);
        }
    }

    #[inline(always)]
    unsafe fn splat(value: f64) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            let one = _mm256_set1_pd(value);
            Self(one, one, one)
        }
    }

    #[inline(always)]
    unsafe fn nodes([a, b, c]: [f64; 3]) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_set1_pd(a), _mm256_set1_pd(b), _mm256_set1_pd(c)) }
    }

    #[inline(always)]
    unsafe fn repeat(from: *const f64) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            let one = _mm256_loadu_pd(from);
            Self(one, one, one)
        }
    }

    #[inline(always)]
    unsafe fn without_mass(self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
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
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_add_pd(self.0, other.0), _mm256_add_pd(self.1, other.1), _mm256_add_pd(self.2, other.2)) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm256_mul_pd(self.0, other.0), _mm256_mul_pd(self.1, other.1), _mm256_mul_pd(self.2, other.2)) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            Self(
                _mm256_fmadd_pd(self.0, factor.0, addend.0),
                _mm256_fmadd_pd(self.1, factor.1, addend.1),
                _mm256_fmadd_pd(self.2, factor.2, addend.2),
            )
        }
    }

    #[inline(always)]
    unsafe fn fold(rows: [Self; 4]) -> [f64; 16] {
        let mut out = [0.0; 16];
        for (k, Self(a, b, c)) in rows.into_iter().enumerate() {
            // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
            unsafe { _mm256_storeu_pd(out.as_mut_ptr().add(4 * k), _mm256_add_pd(_mm256_add_pd(a, b), c)) };
        }
        out
    }

    #[inline(always)]
    unsafe fn turn(from: [*const f64; 4], to: [*mut f64; 4]) {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { turn64(from, to) }
    }
}

impl Row<f64> for Wide64 {
    #[inline(always)]
    unsafe fn load(from: *const f64) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm512_loadu_pd(from), _mm256_loadu_pd(from.add(8))) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f64) {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            _mm512_storeu_pd(to, self.0);
            _mm256_storeu_pd(to.add(8), self.1);
        }
    }

    #[inline(always)]
    unsafe fn splat(value: f64) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm512_set1_pd(value), _mm256_set1_pd(value)) }
    }

    #[inline(always)]
    unsafe fn nodes([a, b, c]: [f64; 3]) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm512_mask_mov_pd(_mm512_set1_pd(a), 0xf0, _mm512_set1_pd(b)), _mm256_set1_pd(c)) }
    }

    #[inline(always)]
    unsafe fn repeat(from: *const f64) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe {
            let one = _mm256_loadu_pd(from);
            Self(_mm512_broadcast_f64x4(one), one)
        }
    }

    #[inline(always)]
    unsafe fn without_mass(self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm512_maskz_mov_pd(0x77, self.0), _mm256_blend_pd::<0x8>(self.1, _mm256_setzero_pd())) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm512_add_pd(self.0, other.0), _mm256_add_pd(self.1, other.1)) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm512_mul_pd(self.0, other.0), _mm256_mul_pd(self.1, other.1)) }
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { Self(_mm512_fmadd_pd(self.0, factor.0, addend.0), _mm256_fmadd_pd(self.1, factor.1, addend.1)) }
    }

    #[inline(always)]
    unsafe fn fold(rows: [Self; 4]) -> [f64; 16] {
        let mut out = [0.0; 16];
        for (k, Self(two, third)) in rows.into_iter().enumerate() {
            // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
            unsafe {
                let both = _mm256_add_pd(_mm512_castpd512_pd256(two), _mm512_extractf64x4_pd::<1>(two));
                _mm256_storeu_pd(out.as_mut_ptr().add(4 * k), _mm256_add_pd(both, third));
            }
        }
        out
    }

    #[inline(always)]
    unsafe fn turn(from: [*const f64; 4], to: [*mut f64; 4]) {
        // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
        unsafe { turn64(from, to) }
    }
}

/// [`Row::turn`] for `f32`.
#[inline(always)]
unsafe fn turn32(from: [*const f32; 4], to: [*mut f32; 4]) {
    // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
    unsafe {
        let (a, b, c, d) = (_mm_loadu_ps(from[0]), _mm_loadu_ps(from[1]), _mm_loadu_ps(from[2]), _mm_loadu_ps(from[3]));
        let (ab, cd) = (_mm_unpacklo_ps(a, b), _mm_unpacklo_ps(c, d));
        _mm_storeu_ps(to[0], _mm_movelh_ps(ab, cd));
        _mm_storeu_ps(to[1], _mm_movehl_ps(cd, ab));
        let (ab, cd) = (_mm_unpackhi_ps(a, b), _mm_unpackhi_ps(c, d));
        _mm_storeu_ps(to[2], _mm_movelh_ps(ab, cd));
        _mm_storeu_ps(to[3], _mm_movehl_ps(cd, ab));
    }
}

/// [`Row::turn`] for `f64`.
#[inline(always)]
unsafe fn turn64(from: [*const f64; 4], to: [*mut f64; 4]) {
    // SAFETY: the contract of `Row`: the instruction set is there, and pointers are valid.
    unsafe {
        let (a, b, c, d) =
            (_mm256_loadu_pd(from[0]), _mm256_loadu_pd(from[1]), _mm256_loadu_pd(from[2]), _mm256_loadu_pd(from[3]));
        let (ab, cd) = (_mm256_unpacklo_pd(a, b), _mm256_unpacklo_pd(c, d));
        _mm256_storeu_pd(to[0], _mm256_permute2f128_pd::<0x20>(ab, cd));
        _mm256_storeu_pd(to[2], _mm256_permute2f128_pd::<0x31>(ab, cd));
        let (ab, cd) = (_mm256_unpackhi_pd(a, b), _mm256_unpackhi_pd(c, d));
        _mm256_storeu_pd(to[1], _mm256_permute2f128_pd::<0x20>(ab, cd));
        _mm256_storeu_pd(to[3], _mm256_permute2f128_pd::<0x31>(ab, cd));
    }
}
