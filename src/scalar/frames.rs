//! Derivatives of the singular value decomposition and of matrices composed in its frames.
//!
//! Everything passes through `P = Uᵀ dF V`, a change of the matrix seen from its own frames: its diagonal changes the
//! singular values, its other entries turn the frames. A composed matrix depends on those turns only through divided
//! differences of its three values, so that no difference of singular values is ever in a denominator alone.
//! For a pair `i < j`, with `a = (dᵢ − dⱼ)/(σᵢ − σⱼ)`, `b = (dᵢ + dⱼ)/(σᵢ + σⱼ)`, `k = a/(σᵢ + σⱼ)`:
//!
//! - `U diag(d) Vᵀ`: `½ (a + b) Pᵢⱼ + ½ (a − b) Pⱼᵢ`
//! - `U diag(d) Uᵀ`: `k (Pᵢⱼ σⱼ + σᵢ Pⱼᵢ)`
//! - `V diag(d) Vᵀ`: `k (σᵢ Pᵢⱼ + Pⱼᵢ σⱼ)`

use super::graph::{Form, Id};
use super::handle::Scalar;
use super::principal::matrix;
use super::slope::Slopes;
use super::{Mat3, Vec3};

/// Squares of singular values closer than this count as this far apart in the derivative of a frame by itself.
const LEAST_GAP: f64 = 1e-6;

/// The sum of two singular values, which vanishes when one is the other's negative, counts as this much at least.
const LEAST_SUM: f64 = 1e-9;

/// The pairs of different indices.
const PAIRS: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];

/// Frames and singular values of a decomposition.
pub(super) struct Frames {
    u: Mat3,
    sigma: Vec3,
    v: Mat3,
}

impl Frames {
    /// Those of the decomposition with this handle.
    pub fn of(svd: Scalar) -> Self {
        Self { u: matrix(svd, 0), sigma: matrix(svd, 9).row(0), v: matrix(svd, 12) }
    }

    /// `Uᵀ A V`
    pub fn seen(&self, a: Mat3) -> Mat3 {
        self.u.t() * (a * self.v)
    }

    /// `U P Vᵀ`
    pub fn turned_back(&self, p: Mat3) -> Mat3 {
        (self.u * p) * self.v.t()
    }

    /// `σᵢ + σⱼ`, kept from 0.
    fn sum(&self, i: usize, j: usize) -> Scalar {
        (self.sigma[i] + self.sigma[j]).max(LEAST_SUM)
    }

    /// `1/(σⱼ² − σᵢ²)`, kept finite.
    fn per_gap(&self, i: usize, j: usize) -> Scalar {
        let gap = (self.sigma[j] - self.sigma[i]) * (self.sigma[j] + self.sigma[i]);
        gap.ge(0.0).select(gap.max(LEAST_GAP), gap.min(-LEAST_GAP)).recip()
    }
}

/// Cotangents of the three values, and of `P`, from that of a matrix composed of them.
pub(super) fn compose_vjp(
    form: Form,
    frames: &Frames,
    [svd, d @ ..]: [Id; 4],
    slopes: &mut Slopes<'_>,
    cotangent: Mat3,
) -> (Vec3, Mat3) {
    let mut on_p = Mat3::zero();
    let values = d.map(|id| slopes.value(id));
    if form == Form::TwoPoint {
        let seen = frames.seen(cotangent);
        for [i, j] in PAIRS {
            let a = slopes.divided(svd, d, i, j, &frames.sigma);
            let b = (values[i] + values[j]) / frames.sum(i, j);
            let (even, odd) = ((a + b) * 0.5, (a - b) * 0.5);
            on_p.0[i][j] = even * seen.0[i][j] + odd * seen.0[j][i];
            on_p.0[j][i] = even * seen.0[j][i] + odd * seen.0[i][j];
        }
        return (Vec3([0, 1, 2].map(|i| seen.0[i][i])), on_p);
    }
    let frame = if form == Form::Left { frames.u } else { frames.v };
    let turned = (cotangent + cotangent.t()) * frame;
    let seen = |i: usize, j: usize| frame.column(i).dot(turned.column(j));
    for [i, j] in PAIRS {
        let k = slopes.divided(svd, d, i, j, &frames.sigma) / frames.sum(i, j);
        let work = k * seen(i, j);
        let (first, second) = if form == Form::Left { (j, i) } else { (i, j) };
        on_p.0[i][j] = work * frames.sigma[first];
        on_p.0[j][i] = work * frames.sigma[second];
    }
    (Vec3([0, 1, 2].map(|i| seen(i, i) * 0.5)), on_p)
}

/// The change of a composed matrix, from those of its three values and of the matrix decomposed, `P`.
pub(super) fn compose_jvp(
    form: Form,
    frames: &Frames,
    [svd, d @ ..]: [Id; 4],
    slopes: &mut Slopes<'_>,
    change: Vec3,
    p: Mat3,
) -> Mat3 {
    let mut seen = Mat3::diag(change);
    let values = d.map(|id| slopes.value(id));
    for [i, j] in PAIRS {
        let a = slopes.divided(svd, d, i, j, &frames.sigma);
        if form == Form::TwoPoint {
            let b = (values[i] + values[j]) / frames.sum(i, j);
            let (even, odd) = ((a + b) * 0.5, (a - b) * 0.5);
            seen.0[i][j] = even * p.0[i][j] + odd * p.0[j][i];
            seen.0[j][i] = even * p.0[j][i] + odd * p.0[i][j];
        } else {
            let (first, second) = if form == Form::Left { (j, i) } else { (i, j) };
            let moved = p.0[i][j] * frames.sigma[first] + p.0[j][i] * frames.sigma[second];
            seen.0[i][j] = a / frames.sum(i, j) * moved;
            seen.0[j][i] = seen.0[i][j];
        }
    }
    match form {
        Form::TwoPoint => frames.turned_back(seen),
        Form::Left => (frames.u * seen) * frames.u.t(),
        Form::Right => (frames.v * seen) * frames.v.t(),
    }
}

/// The cotangent of `P` from those of the frames themselves. Where two singular values nearly coincide the frames are
/// not differentiable; the result is kept finite.
pub(super) fn svd_vjp(frames: &Frames, on_u: Mat3, on_v: Mat3) -> Mat3 {
    let (a, b) = (frames.u.t() * on_u, frames.v.t() * on_v);
    let mut on_p = Mat3::zero();
    for [i, j] in PAIRS {
        let k = frames.per_gap(i, j);
        let (turn_u, turn_v) = (k * (a.0[i][j] - a.0[j][i]), k * (b.0[i][j] - b.0[j][i]));
        on_p.0[i][j] = turn_u * frames.sigma[j] + frames.sigma[i] * turn_v;
        on_p.0[j][i] = turn_u * frames.sigma[i] + frames.sigma[j] * turn_v;
    }
    on_p
}

/// The changes of `U` and `V` that belong to a change `P`.
pub(super) fn svd_jvp(frames: &Frames, p: Mat3) -> [Mat3; 2] {
    let (mut spin_u, mut spin_v) = (Mat3::zero(), Mat3::zero());
    for [i, j] in PAIRS {
        let k = frames.per_gap(i, j);
        let (x, y) = (p.0[i][j], p.0[j][i]);
        spin_u.0[i][j] = k * (x * frames.sigma[j] + frames.sigma[i] * y);
        spin_v.0[i][j] = k * (x * frames.sigma[i] + frames.sigma[j] * y);
        spin_u.0[j][i] = -spin_u.0[i][j];
        spin_v.0[j][i] = -spin_v.0[i][j];
    }
    [frames.u * spin_u, frames.v * spin_v]
}
