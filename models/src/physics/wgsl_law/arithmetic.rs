//! Operators.

use gradreel::scalar::Scalar;
use naga::{BinaryOperator as Op, Span, TypeInner, UnaryOperator};

use super::expression::varies;
use super::fault::{Fault, Outcome};
use super::value::{Truth, Value};

pub(super) fn integer(value: &Value, span: Span) -> Outcome<i64> {
    match value {
        Value::Integer(n) => Ok(*n),
        Value::Unknown => Err(varies(span)),
        _ => Err(Fault::new(span, "this is no integer").wanted("i32 or u32")),
    }
}

pub(super) fn truth(value: &Value, span: Span) -> Outcome<Truth> {
    match value {
        Value::Truth(truth) => Ok(*truth),
        Value::Unknown => Err(varies(span)),
        _ => Err(Fault::new(span, "this is no condition").wanted("bool")),
    }
}

pub(super) fn unary(op: UnaryOperator, value: &Value, span: Span) -> Outcome<Value> {
    value.map(&mut |x| match (op, x) {
        (UnaryOperator::Negate, Value::Number(x)) => Ok((-*x).into()),
        (UnaryOperator::Negate, Value::Integer(n)) => Ok(Value::Integer(wrapped(-n))),
        (UnaryOperator::LogicalNot, Value::Truth(truth)) => Ok(truth.not().into()),
        (_, Value::Unknown) => Err(varies(span)),
        _ => Err(Fault::unsupported(span, "this operator")),
    })
}

/// The value, and how many operations it takes.
pub(super) fn binary(
    op: Op,
    (a, left): (&Value, &TypeInner),
    (b, right): (&Value, &TypeInner),
    span: Span,
) -> Outcome<(Value, usize)> {
    let shape = |inner: &TypeInner| match inner {
        TypeInner::Matrix { .. } => 2,
        TypeInner::Vector { .. } => 1,
        _ => 0,
    };
    match (op, shape(left), shape(right)) {
        (Op::Multiply, 2, 2) => {
            let columns = b.parts().iter().map(|column| matrix_vector(a, column));
            let found = columns.collect::<Option<Vec<_>>>().map(Value::many);
            priced(found, 2 * a.parts().len(), span)
        }
        (Op::Multiply, 2, 1) => priced(matrix_vector(a, b), 2 * a.parts().len(), span),
        (Op::Multiply, 1, 2) => {
            let columns = b.parts().iter().map(|column| dot(a, column).map(Value::from));
            let found = columns.collect::<Option<Vec<_>>>().map(Value::many);
            priced(found, 2 * a.parts().len(), span)
        }
        _ => {
            let value = a.zip(b, &mut |a, b| single(op, a, b, span))?;
            let cost = value.len();
            Ok((value, cost))
        }
    }
}

fn priced(value: Option<Value>, each: usize, span: Span) -> Outcome<(Value, usize)> {
    let value = value.ok_or_else(|| Fault::unsupported(span, "this product"))?;
    let cost = each * value.len();
    Ok((value, cost))
}

/// `a · b`
pub(super) fn dot(a: &Value, b: &Value) -> Option<Scalar> {
    let (a, b) = (a.numbers()?, b.numbers()?);
    a.iter().zip(&b).map(|(a, b)| *a * *b).reduce(|sum, x| sum + x)
}

/// The matrix with these columns times a vector.
fn matrix_vector(columns: &Value, v: &Value) -> Option<Value> {
    let columns: Vec<Vec<Scalar>> = columns.parts().iter().map(Value::numbers).collect::<Option<_>>()?;
    let v = v.numbers()?;
    let rows = columns.first()?.len();
    let row = |i: usize| columns.iter().zip(&v).map(|(column, x)| column[i] * *x).reduce(|sum, x| sum + x);
    (0..rows).map(|i| row(i).map(Value::from)).collect::<Option<Vec<_>>>().map(Value::many)
}

fn single(op: Op, a: &Value, b: &Value, span: Span) -> Outcome<Value> {
    let unsupported = || Fault::unsupported(span, "this operator");
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => number(op, *a, *b).ok_or_else(unsupported),
        (Value::Integer(a), Value::Integer(b)) => whole(op, *a, *b, span),
        (Value::Truth(a), Value::Truth(b)) => match op {
            Op::And | Op::LogicalAnd => Ok(a.and(*b).into()),
            Op::InclusiveOr | Op::LogicalOr => Ok(a.or(*b).into()),
            Op::Equal => Ok(a.choose(*b, b.not()).into()),
            Op::NotEqual => Ok(a.choose(b.not(), *b).into()),
            _ => Err(unsupported()),
        },
        (Value::Unknown, _) | (_, Value::Unknown) => Err(varies(span)),
        _ => Err(unsupported()),
    }
}

fn number(op: Op, a: Scalar, b: Scalar) -> Option<Value> {
    let truth = |condition| Value::from(Truth::from(condition));
    Some(match op {
        Op::Add => (a + b).into(),
        Op::Subtract => (a - b).into(),
        Op::Multiply => (a * b).into(),
        Op::Divide => (a / b).into(),
        Op::Modulo => (a - b * truncated(a / b)).into(),
        Op::Equal => truth(a.eq(b)),
        Op::NotEqual => Truth::from(a.eq(b)).not().into(),
        Op::Less => truth(a.lt(b)),
        Op::LessEqual => truth(a.le(b)),
        Op::Greater => truth(a.gt(b)),
        Op::GreaterEqual => truth(a.ge(b)),
        _ => return None,
    })
}

/// The whole number between a number and 0 that is nearest to it.
pub(super) fn truncated(x: Scalar) -> Scalar {
    x.lt(0.0).select(x.ceil(), x.floor())
}

/// An integer of 32 bits; `u32` stays as it is.
fn wrapped(n: i64) -> i64 {
    if (0..=i64::from(u32::MAX)).contains(&n) { n } else { i64::from(n as i32) }
}

fn whole(op: Op, a: i64, b: i64, span: Span) -> Outcome<Value> {
    let truth = |holds| Ok(Truth::Known(holds).into());
    let found = match op {
        Op::Add => a.checked_add(b),
        Op::Subtract => a.checked_sub(b),
        Op::Multiply => a.checked_mul(b),
        Op::Divide => a.checked_div(b),
        Op::Modulo => a.checked_rem(b),
        Op::And => Some(a & b),
        Op::InclusiveOr => Some(a | b),
        Op::ExclusiveOr => Some(a ^ b),
        Op::ShiftLeft => u32::try_from(b).ok().filter(|b| *b < 32).map(|b| a << b),
        Op::ShiftRight => u32::try_from(b).ok().filter(|b| *b < 32).map(|b| a >> b),
        Op::Equal => return truth(a == b),
        Op::NotEqual => return truth(a != b),
        Op::Less => return truth(a < b),
        Op::LessEqual => return truth(a <= b),
        Op::Greater => return truth(a > b),
        Op::GreaterEqual => return truth(a >= b),
        _ => return Err(Fault::unsupported(span, "this operator")),
    };
    let fits = |n: &i64| (i64::from(i32::MIN)..=i64::from(u32::MAX)).contains(n);
    found
        .filter(fits)
        .map(Value::Integer)
        .ok_or_else(|| Fault::new(span, "an integer overflows, or is divided by 0").found(format!("{a} and {b}")))
}
