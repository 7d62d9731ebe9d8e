//! The functions of WGSL.

use gradreel::scalar::{Mat3, Scalar};
use naga::{MathFunction as Math, Span};

use super::arithmetic::{dot, truncated};
use super::expression::varies;
use super::fault::{Fault, Outcome};
use super::value::Value;

/// The value of a built-in function, and how many operations it takes.
pub(super) fn call(function: Math, all: &[Value], span: Span) -> Outcome<(Value, usize)> {
    let unsupported = || Fault::unsupported(span, &format!("the function `{}`", name(function)));
    let found = match all {
        _ if all.iter().any(is_unknown) => return Err(varies(span)),
        [a] => one(function, a).or_else(|| a.map(&mut |x| each(function, x).ok_or(())).ok()),
        [a, b] => two(function, a, b).or_else(|| a.zip(b, &mut |a, b| each_two(function, a, b).ok_or(())).ok()),
        [a, b, c] => {
            let pairs = |a: &Value, b: &Value, c: &Value| each_three(function, a, b, c);
            match (a, b, c) {
                (Value::Many(p), ..) => {
                    let pick = |v: &Value, i: usize| v.parts().get(i).unwrap_or(v).clone();
                    let part = |i: usize| pairs(&p[i], &pick(b, i), &pick(c, i));
                    (0..p.len()).map(part).collect::<Option<Vec<_>>>().map(Value::many)
                }
                _ => pairs(a, b, c),
            }
        }
        _ => None,
    };
    let value = found.ok_or_else(unsupported)?;
    let cost = all.iter().map(Value::len).max().unwrap_or(1).max(value.len()) * weight(function);
    Ok((value, cost))
}

fn is_unknown(value: &Value) -> bool {
    matches!(value, Value::Unknown) || value.parts().iter().any(is_unknown)
}

/// About how many operations a function takes for each number.
fn weight(function: Math) -> usize {
    match function {
        Math::Sinh | Math::Cosh | Math::Asinh | Math::Acosh | Math::Atanh | Math::Mix | Math::Round => 4,
        Math::SmoothStep | Math::Refract => 8,
        Math::Dot | Math::Length | Math::Distance | Math::Normalize | Math::Cross | Math::Clamp | Math::Tan => 3,
        Math::Determinant => 2,
        _ => 1,
    }
}

fn name(function: Math) -> String {
    let name = format!("{function:?}");
    let mut letters = name.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

/// Functions of a whole vector or matrix.
fn one(function: Math, a: &Value) -> Option<Value> {
    match function {
        Math::Length => Some(dot(a, a)?.sqrt().into()),
        Math::Normalize => {
            let length = dot(a, a)?.sqrt();
            Some(Value::many(a.numbers()?.into_iter().map(|x| Value::from(x / length))))
        }
        Math::Transpose => {
            let columns: Vec<Vec<Scalar>> = a.parts().iter().map(Value::numbers).collect::<Option<_>>()?;
            let rows = columns.first()?.len();
            let row = |i: usize| Value::many(columns.iter().map(|column| Value::from(column[i])));
            Some(Value::many((0..rows).map(row)))
        }
        Math::Determinant => match a.parts() {
            [p, q] => {
                let (p, q) = (p.numbers()?, q.numbers()?);
                Some((p[0] * q[1] - p[1] * q[0]).into())
            }
            _ => Some(a.mat3()?.det().into()),
        },
        _ => None,
    }
}

fn two(function: Math, a: &Value, b: &Value) -> Option<Value> {
    match function {
        Math::Dot => match (a.numbers(), b.numbers()) {
            (Some(_), Some(_)) => Some(dot(a, b)?.into()),
            _ => None,
        },
        Math::Cross => Some(a.vec3()?.cross(b.vec3()?).into()),
        Math::Outer => Some(Mat3::outer(a.vec3()?, b.vec3()?).into()),
        Math::Distance => {
            let off =
                a.zip(b, &mut |a, b| Ok::<Value, ()>((a.number().ok_or(())? - b.number().ok_or(())?).into())).ok()?;
            Some(dot(&off, &off)?.sqrt().into())
        }
        Math::Reflect => {
            let twice = dot(a, b)? * 2.0;
            a.zip(b, &mut |a, b| Ok::<Value, ()>((a.number().ok_or(())? - twice * b.number().ok_or(())?).into())).ok()
        }
        _ => None,
    }
}

fn each(function: Math, x: &Value) -> Option<Value> {
    if let Value::Integer(n) = *x {
        return match function {
            Math::Abs => Some(Value::Integer(n.abs())),
            Math::Sign => Some(Value::Integer(n.signum())),
            _ => None,
        };
    }
    let x = x.number()?;
    let sinh = |x: Scalar| {
        let e = x.exp_m1();
        (e + e / (e + 1.0)) * 0.5
    };
    let found = match function {
        Math::Abs => x.abs(),
        Math::Saturate => x.max(0.0).min(1.0),
        Math::Cos => x.cos(),
        Math::Sin => x.sin(),
        Math::Tan => x.sin() / x.cos(),
        Math::Tanh => x.tanh(),
        Math::Sinh => sinh(x),
        Math::Cosh => (x.exp() + (-x).exp()) * 0.5,
        Math::Asinh => {
            let size = x.abs();
            (size + (size * size + 1.0).sqrt()).ln() * x.sign()
        }
        Math::Acosh => (x + (x * x - 1.0).sqrt()).ln(),
        Math::Atanh => (x.ln_1p() - (-x).ln_1p()) * 0.5,
        Math::Radians => x * (std::f64::consts::PI / 180.0),
        Math::Degrees => x * (180.0 / std::f64::consts::PI),
        Math::Ceil => x.ceil(),
        Math::Floor => x.floor(),
        Math::Fract => x - x.floor(),
        Math::Trunc => truncated(x),
        Math::Round => {
            // halves go to the even neighbour
            let up = x.round();
            let half = (x - x.floor()).eq(0.5);
            let odd = (up * 0.5 - (up * 0.5).floor()).gt(0.0);
            half.and(odd).select(up - 1.0, up)
        }
        Math::Exp => x.exp(),
        Math::Exp2 => (x * std::f64::consts::LN_2).exp(),
        Math::Log => x.ln(),
        Math::Log2 => x.ln() * std::f64::consts::LOG2_E,
        Math::Sign => x.sign(),
        Math::Sqrt => x.sqrt(),
        Math::InverseSqrt => x.sqrt().recip(),
        _ => return None,
    };
    Some(found.into())
}

fn each_two(function: Math, a: &Value, b: &Value) -> Option<Value> {
    if let (Value::Integer(a), Value::Integer(b)) = (a, b) {
        return match function {
            Math::Min => Some(Value::Integer(*a.min(b))),
            Math::Max => Some(Value::Integer(*a.max(b))),
            _ => None,
        };
    }
    let (a, b) = (a.number()?, b.number()?);
    let found = match function {
        Math::Min => a.min(b),
        Math::Max => a.max(b),
        Math::Pow => a.powf(b),
        Math::Step => b.ge(a).select(1.0, 0.0),
        _ => return None,
    };
    Some(found.into())
}

fn each_three(function: Math, a: &Value, b: &Value, c: &Value) -> Option<Value> {
    if let (Math::Clamp, Value::Integer(a), Value::Integer(b), Value::Integer(c)) = (function, a, b, c) {
        return Some(Value::Integer((*a).max(*b).min(*c)));
    }
    let (a, b, c) = (a.number()?, b.number()?, c.number()?);
    let found = match function {
        Math::Clamp => a.max(b).min(c),
        Math::Fma => a * b + c,
        Math::Mix => a * (1.0 - c) + b * c,
        Math::SmoothStep => {
            let t = ((c - a) / (b - a)).max(0.0).min(1.0);
            t * t * (3.0 - t * 2.0)
        }
        _ => return None,
    };
    Some(found.into())
}
