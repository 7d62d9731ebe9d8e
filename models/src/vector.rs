//! 3-vectors and row-major 3×3 matrices.

use faer::Mat;
use faer::linalg::solvers::Solve;

type Vector = [f64; 3];
type Matrix = [Vector; 3];

pub(crate) const EYE: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

#[inline(always)]
pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `√(a·a)`
pub(crate) fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// `a/‖a‖`; zero for zero.
pub(crate) fn unit(a: Vector) -> Vector {
    let length = norm(a).max(f64::MIN_POSITIVE);
    a.map(|x| x / length)
}

pub(crate) fn plus(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(crate) fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `m x`
pub(crate) fn times(m: &Matrix, x: Vector) -> Vector {
    m.map(|row| dot(row, x))
}

pub(crate) fn product(a: Matrix, b: Matrix) -> Matrix {
    a.map(|row| std::array::from_fn(|j| (0..3).map(|k| row[k] * b[k][j]).sum()))
}

pub(crate) fn inverse(m: Matrix) -> Matrix {
    let inverse = Mat::from_fn(3, 3, |i, j| m[i][j]).partial_piv_lu().solve(Mat::<f64>::identity(3, 3));
    std::array::from_fn(|i| std::array::from_fn(|j| inverse[(i, j)]))
}

pub(crate) fn transposed(m: Matrix) -> Matrix {
    std::array::from_fn(|i| m.map(|row| row[i]))
}

/// A vector times a number.
pub(crate) fn scaled(a: Vector, by: f64) -> Vector {
    a.map(|x| by * x)
}

/// The rotation by `|turn|` radians about the axis `turn` (Rodrigues).
pub(crate) fn rotation(turn: Vector) -> Matrix {
    let angle = dot(turn, turn).sqrt();
    if angle == 0.0 {
        return EYE;
    }
    let n = turn.map(|t| t / angle);
    let (sin, cos) = angle.sin_cos();
    let skew = [[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]];
    std::array::from_fn(|i| std::array::from_fn(|j| cos * EYE[i][j] + sin * skew[i][j] + (1.0 - cos) * n[i] * n[j]))
}

/// Lowest and highest coordinates.
pub(crate) fn bounds(points: impl Iterator<Item = Vector>) -> [Vector; 2] {
    points.fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], x| {
        [[0, 1, 2].map(|axis| low[axis].min(x[axis])), [0, 1, 2].map(|axis| high[axis].max(x[axis]))]
    })
}
