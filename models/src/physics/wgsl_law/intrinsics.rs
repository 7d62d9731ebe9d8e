//! The functions of the prelude that the lowering knows.

use gradreel::scalar::{Mat3, Scalar, Vec3};

use super::value::Value;

/// The value of an intrinsic and how many operations it takes; `None` for any other function, and inside for arguments that
/// do not fit.
pub(super) fn call(name: &str, all: &[Value]) -> Option<Option<(Value, usize)>> {
    let matrix = |f: fn(Mat3) -> Value, cost: usize| match all {
        [a] => Some((f(a.mat3()?), cost)),
        _ => None,
    };
    let framed = |f: fn(Mat3, Vec3) -> Mat3| match all {
        [a, d] => Some((f(a.mat3()?, d.vec3()?).into(), 27)),
        _ => None,
    };
    let scalar = |f: fn(Scalar) -> Scalar| match all {
        [x] => Some((f(x.number()?).into(), 1)),
        _ => None,
    };
    Some(match name {
        "svd" => matrix(
            |a| {
                let p = a.principal();
                Value::many([p.u().into(), p.stretches().into(), p.v().into()])
            },
            1,
        ),
        "stretches" => matrix(|a| a.principal().stretches().into(), 1),
        "two_point" => framed(|a, d| a.principal().two_point(d)),
        "left" => framed(|a, d| a.principal().left(d)),
        "right" => framed(|a, d| a.principal().right(d)),
        "softplus" => scalar(Scalar::softplus),
        "logistic" => scalar(Scalar::logistic),
        "log1p" => scalar(Scalar::ln_1p),
        "expm1" => scalar(Scalar::exp_m1),
        "erf" => scalar(Scalar::erf),
        "det" => matrix(|a| a.det().into(), 14),
        "inverse" => matrix(|a| a.inverse().into(), 42),
        "cofactor" => matrix(|a| a.cofactor().into(), 27),
        "trace" => matrix(|a| a.trace().into(), 2),
        "dev" => matrix(|a| a.dev().into(), 6),
        "sym" => matrix(|a| a.sym().into(), 12),
        "ddot" => match all {
            [a, b] => a.mat3().zip(b.mat3()).map(|(a, b)| (a.ddot(b).into(), 17)),
            _ => None,
        },
        "outer" => match all {
            [a, b] => a.vec3().zip(b.vec3()).map(|(a, b)| (a.outer(b).into(), 9)),
            _ => None,
        },
        "diagonal" => match all {
            [d] => d.vec3().map(|d| (Mat3::diag(d).into(), 0)),
            _ => None,
        },
        _ => return None,
    })
}
