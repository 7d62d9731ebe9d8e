//! The singular value decomposition of 3×3 matrices, one per lane.
//!
//! One-sided Jacobi: rotations from the right make the columns of `B = F V` orthogonal to each other. Columns are
//! compared by their own lengths, so that small singular values are as accurate, relative to themselves, as large ones;
//! forming `FᵀF` would square the condition. The frames are completed by a cross product, which makes both of them
//! rotations and leaves the sign of the determinant with the smallest value. Twin of `kernels/shared/svd.wgsl`.
//!
//! Source: Hestenes, *Inversion of Matrices by Biorthogonalization and Related Results*, 1958; Demmel and Veselić,
//! *Jacobi's Method is More Accurate than QR*, 1992.

use super::lanes::Lane;
use super::real::Real;
use crate::Element;

/// Rounds over the three pairs of columns, at most; three or four are usual in `f32`, five in `f64`.
const SWEEPS: usize = 8;

/// A matrix by columns.
type Columns<V> = [[V; 3]; 3];

/// `a · b`
#[inline(always)]
unsafe fn dot<V: Lane>(a: [V; 3], b: [V; 3]) -> V {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe { a[2].mul_add(b[2], a[1].mul_add(b[1], a[0].mul(b[0]))) }
}

/// `U` (row by row), singular values in descending order, `V` (row by row), of a matrix given row by row:
/// `F = U Σ Vᵀ` with rotations `U` and `V`; the last singular value has the sign of `det F`.
///
/// A lane that holds NaN or infinity gets NaN among its singular values.
#[inline(always)]
pub(super) unsafe fn svd<V: Lane>(f: [V; 9]) -> [V; 21] {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (zero, one) = (V::splat(V::Element::ZERO), V::splat(V::Element::ONE));
        // Squares of squares must neither overflow nor vanish: matrices of unusual size are scaled.
        let mut size = zero;
        for n in 0..9 {
            size = f[n].abs().larger(size);
        }
        let usual = V::splat(V::Element::from_f64(1e-3)).lt(size).mul(size.lt(V::splat(V::Element::from_f64(1e3))));
        let scale = usual.choose(one, one.if_less(zero, size, zero).choose(size, one));
        let inverse = scale.recip();
        let mut b: Columns<V> = [[zero; 3]; 3];
        for n in 0..9 {
            b[n % 3][n / 3] = f[n].mul(inverse);
        }
        let mut v: Columns<V> = [[one, zero, zero], [zero, one, zero], [zero, zero, one]];
        for _ in 0..SWEEPS {
            let first = rotate(&mut b, &mut v, 0, 1);
            let second = rotate(&mut b, &mut v, 0, 2);
            let third = rotate(&mut b, &mut v, 1, 2);
            if !(first || second || third) {
                break;
            }
        }
        // Rounding of the rotations has piled up in both: V is made a rotation again, and B = F V formed afresh.
        orthonormalise(&mut v);
        for j in 0..3 {
            for i in 0..3 {
                let row = [f[3 * i].mul(inverse), f[3 * i + 1].mul(inverse), f[3 * i + 2].mul(inverse)];
                b[j][i] = dot(row, v[j]);
            }
        }
        let mut squares = [dot(b[0], b[0]), dot(b[1], b[1]), dot(b[2], b[2])];
        sort(&mut squares, &mut b, &mut v, 0, 1);
        sort(&mut squares, &mut b, &mut v, 1, 2);
        sort(&mut squares, &mut b, &mut v, 0, 1);
        let (u, sigma) = frame(b, squares[0]);
        let mut result = [zero; 21];
        for n in 0..9 {
            result[n] = u[n % 3][n / 3];
            result[12 + n] = v[n % 3][n / 3];
        }
        for n in 0..3 {
            result[9 + n] = sigma[n].mul(scale);
        }
        result
    }
}

/// Makes columns `p` and `q` of `b` orthogonal, and turns those of `v` along. Lanes in which they already are stay as
/// they are, bit for bit; the answer is whether there were others.
#[inline(always)]
unsafe fn rotate<V: Lane>(b: &mut Columns<V>, v: &mut Columns<V>, p: usize, q: usize) -> bool {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (zero, one, half) =
            (V::splat(V::Element::ZERO), V::splat(V::Element::ONE), V::splat(V::Element::from_f64(0.5)));
        let epsilon = V::Element::EPSILON;
        let (pp, qq, pq) = (dot(b[p], b[p]), dot(b[q], b[q]), dot(b[p], b[q]));
        let four = V::Element::from_f64(4.0);
        let relative = V::splat(four * four * epsilon * epsilon);
        let floor = V::splat(epsilon * epsilon * epsilon * epsilon * epsilon);
        let threshold = pp.mul(qq).mul_add(relative, floor);
        let square = pq.mul(pq);
        if !threshold.lt(square).any() {
            return false;
        }
        // tan 2θ = h/d; with r = √(d² + h²): cos² θ = ½ + ½ |d|/r
        let (d, h) = (qq.sub(pp), pq.add(pq));
        let per_r = d.mul_add(d, h.mul(h)).rsqrt();
        let cos_square = d.abs().mul(per_r).mul_add(half, half);
        let per_cos = cos_square.rsqrt();
        let sine = pq.mul(per_r).mul(per_cos);
        let sine = sine.neg().if_less(d, zero, sine);
        let c = cos_square.mul(per_cos).if_less(threshold, square, one);
        let s = sine.if_less(threshold, square, zero);
        for i in 0..3 {
            let (x, y) = (b[p][i], b[q][i]);
            b[p][i] = s.neg_mul_add(y, c.mul(x));
            b[q][i] = s.mul_add(x, c.mul(y));
            let (x, y) = (v[p][i], v[q][i]);
            v[p][i] = s.neg_mul_add(y, c.mul(x));
            v[q][i] = s.mul_add(x, c.mul(y));
        }
        true
    }
}

/// Makes columns that are nearly orthonormal exactly so, up to rounding.
#[inline(always)]
unsafe fn orthonormalise<V: Lane>(v: &mut Columns<V>) {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        // For a length near 1, 1/√s = (3 − s)/2 up to the square of the rest.
        let (half, three_halves) = (V::splat(V::Element::from_f64(0.5)), V::splat(V::Element::from_f64(1.5)));
        let scale = dot(v[0], v[0]).neg_mul_add(half, three_halves);
        for i in 0..3 {
            v[0][i] = v[0][i].mul(scale);
        }
        let along = dot(v[0], v[1]);
        for i in 0..3 {
            v[1][i] = along.neg_mul_add(v[0][i], v[1][i]);
        }
        let scale = dot(v[1], v[1]).neg_mul_add(half, three_halves);
        for i in 0..3 {
            v[1][i] = v[1][i].mul(scale);
        }
        v[2] = cross(v[0], v[1]);
    }
}

/// `a × b`
#[inline(always)]
unsafe fn cross<V: Lane>(a: [V; 3], b: [V; 3]) -> [V; 3] {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        [a[1].mul_sub(b[2], a[2].mul(b[1])), a[2].mul_sub(b[0], a[0].mul(b[2])), a[0].mul_sub(b[1], a[1].mul(b[0]))]
    }
}

/// Puts the longer of two columns first; a quarter turn, so that `v` stays a rotation.
#[inline(always)]
unsafe fn sort<V: Lane>(squares: &mut [V; 3], b: &mut Columns<V>, v: &mut Columns<V>, p: usize, q: usize) {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (x, y) = (squares[p], squares[q]);
        squares[p] = y.if_less(x, y, x);
        squares[q] = x.if_less(x, y, y);
        for i in 0..3 {
            let (first, second) = (b[p][i], b[q][i]);
            b[p][i] = second.if_less(x, y, first);
            b[q][i] = first.neg().if_less(x, y, second);
            let (first, second) = (v[p][i], v[q][i]);
            v[p][i] = second.if_less(x, y, first);
            v[q][i] = first.neg().if_less(x, y, second);
        }
    }
}

/// The left frame and the singular values of orthogonal columns in order of length; `square` is that of the first.
/// Columns without a direction get one.
#[inline(always)]
unsafe fn frame<V: Lane>(b: Columns<V>, square: V) -> (Columns<V>, [V; 3]) {
    // SAFETY: as the caller, the contract of `Lane`.
    unsafe {
        let (zero, one) = (V::splat(V::Element::ZERO), V::splat(V::Element::ONE));
        let epsilon = V::Element::EPSILON;
        let least = V::splat(epsilon * epsilon * epsilon * epsilon * epsilon);
        let mut u = [[zero; 3]; 3];
        let per_length = square.rsqrt();
        for i in 0..3 {
            let fallback = if i == 0 { one } else { zero };
            u[0][i] = b[0][i].mul(per_length).if_less(least, square, fallback);
        }
        let along = dot(u[0], b[1]);
        let mut rest = [zero; 3];
        for i in 0..3 {
            rest[i] = along.neg_mul_add(u[0][i], b[1][i]);
        }
        // A vector across the first: (−z, 0, x) or (0, z, −y), whichever is longer.
        let (x, y) = (u[0][0].abs(), u[0][1].abs());
        let across =
            [u[0][2].neg().if_less(y, x, zero), zero.if_less(y, x, u[0][2]), u[0][0].if_less(y, x, u[0][1].neg())];
        // a column of rounding errors may lie along the first one: what is left of it has no direction either
        let length = dot(rest, rest);
        let least = dot(b[1], b[1]).mul_add(V::splat(V::Element::from_f64(0.25)), least);
        for i in 0..3 {
            rest[i] = rest[i].if_less(least, length, across[i]);
        }
        let per_length = length.if_less(least, length, dot(across, across)).rsqrt();
        for i in 0..3 {
            u[1][i] = rest[i].mul(per_length);
        }
        u[2] = cross(u[0], u[1]);
        (u, [dot(u[0], b[0]), dot(u[1], b[1]), dot(u[2], b[2])])
    }
}
