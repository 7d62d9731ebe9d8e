//! The value of an expression.

use gradreel::scalar::Scalar;
use naga::{Expression, Handle, Literal, ScalarKind, Span, TypeInner};

use super::arithmetic;
use super::builtins;
use super::fault::{Fault, Outcome};
use super::machine::{Frame, Machine, Variables};
use super::value::{Place, Truth, Value};

impl<'m> Machine<'m> {
    /// The value of an expression that has been evaluated, or needs no evaluation.
    pub fn value(&mut self, frame: &mut Frame<'m>, handle: Handle<Expression>, now: &Variables) -> Outcome<Value> {
        match &frame.known[handle.index()] {
            Some(value) => Ok(value.clone()),
            None => self.evaluate(frame, handle, now),
        }
    }

    pub fn truth(&mut self, frame: &mut Frame<'m>, handle: Handle<Expression>, now: &Variables) -> Outcome<Truth> {
        match self.value(frame, handle, now)? {
            Value::Truth(truth) => Ok(truth),
            _ => Err(Fault::new(frame.span(handle), "this is no condition").wanted("bool")),
        }
    }

    pub fn integer(&mut self, frame: &mut Frame<'m>, handle: Handle<Expression>, now: &Variables) -> Outcome<i64> {
        let value = self.value(frame, handle, now)?;
        arithmetic::integer(&value, frame.span(handle))
    }

    pub fn place(&mut self, frame: &mut Frame<'m>, handle: Handle<Expression>, now: &Variables) -> Outcome<Place> {
        match self.value(frame, handle, now)? {
            Value::Place(place) => Ok((*place).clone()),
            _ => Err(Fault::unsupported(frame.span(handle), "this reference")),
        }
    }

    /// Computes an expression from its operands.
    pub fn evaluate(&mut self, frame: &mut Frame<'m>, handle: Handle<Expression>, now: &Variables) -> Outcome<Value> {
        let span = frame.span(handle);
        let expression = &frame.function.expressions[handle];
        let mut cost = None;
        let found = match expression {
            Expression::FunctionArgument(n) => frame.arguments[*n as usize].clone(),
            Expression::LocalVariable(variable) => Value::Place(frame.local(*variable).into()),
            Expression::Load { pointer } => {
                let place = self.place(frame, *pointer, now)?;
                let whole = now.0.get(place.slot).and_then(|whole| whole.at(&place.path));
                whole.cloned().ok_or_else(|| Fault::unsupported(span, "this reference"))?
            }
            Expression::Unary { op, expr } => {
                let value = self.value(frame, *expr, now)?;
                arithmetic::unary(*op, &value, span)?
            }
            Expression::Binary { op, left, right } => {
                let (a, b) = (self.value(frame, *left, now)?, self.value(frame, *right, now)?);
                let inner = |handle: Handle<Expression>| frame.info[handle].ty.inner_with(&self.parsed.module.types);
                let (value, operations) = arithmetic::binary(*op, (&a, inner(*left)), (&b, inner(*right)), span)?;
                cost = Some(operations);
                value
            }
            Expression::Math { fun, arg, arg1, arg2, arg3 } => {
                let mut all = vec![self.value(frame, *arg, now)?];
                for more in [arg1, arg2, arg3].into_iter().flatten() {
                    all.push(self.value(frame, *more, now)?);
                }
                let (value, operations) = builtins::call(*fun, &all, span)?;
                cost = Some(operations);
                value
            }
            Expression::CallResult(_) => return Err(Fault::unsupported(span, "a function without a value")),
            _ => {
                let mut operands = |machine: &mut Self, operand| machine.value(frame, operand, now);
                self.pure(expression, span, &mut operands)?
            }
        };
        let steps = cost.unwrap_or_else(|| found.len());
        self.spend(if found.is_known() || is_move(expression) { 0 } else { steps }, steps, span)?;
        Ok(found)
    }

    /// Expressions that may be constants of the module too.
    fn pure(
        &mut self,
        expression: &Expression,
        span: Span,
        of: &mut dyn FnMut(&mut Self, Handle<Expression>) -> Outcome<Value>,
    ) -> Outcome<Value> {
        Ok(match *expression {
            Expression::Literal(literal) => self::literal(literal, span)?,
            Expression::Constant(constant) => self.global(self.module().constants[constant].init)?,
            Expression::ZeroValue(ty) => self.zero(ty, span)?,
            Expression::Compose { ty, ref components } => {
                let parts = components.iter().map(|&part| of(self, part)).collect::<Outcome<Vec<_>>>()?;
                match self.module().types[ty].inner {
                    // vec4(a.xy, 0.0, 1.0)
                    TypeInner::Vector { .. } => Value::many(parts.iter().flat_map(|part| match part {
                        Value::Many(parts) => parts.to_vec(),
                        one => vec![one.clone()],
                    })),
                    _ => Value::many(parts),
                }
            }
            Expression::Splat { size, value } => {
                let value = of(self, value)?;
                Value::many(vec![value; size as usize])
            }
            Expression::Swizzle { size, vector, pattern } => {
                let vector = of(self, vector)?;
                let part = |&c: &naga::SwizzleComponent| vector.parts().get(c as usize).cloned();
                let parts: Option<Vec<Value>> = pattern[..size as usize].iter().map(part).collect();
                Value::many(parts.ok_or_else(|| Fault::unsupported(span, "this swizzle"))?)
            }
            Expression::AccessIndex { base, index } => part(&of(self, base)?, index, span)?,
            Expression::Access { base, index } => {
                let base = of(self, base)?;
                let found = arithmetic::integer(&of(self, index)?, span)?;
                let index = u32::try_from(found)
                    .map_err(|_| Fault::new(span, "an index is out of range").found(found.to_string()))?;
                part(&base, index, span)?
            }
            Expression::Select { condition, accept, reject } => {
                let (c, a, b) = (of(self, condition)?, of(self, accept)?, of(self, reject)?);
                select(&c, &a, &b, span)?
            }
            Expression::Relational { fun, argument } => {
                let value = of(self, argument)?;
                let each = value.parts().iter().map(|part| arithmetic::truth(part, span));
                let each = each.collect::<Outcome<Vec<_>>>()?;
                let single = || arithmetic::truth(&value, span);
                match fun {
                    _ if each.is_empty() => single()?.into(),
                    naga::RelationalFunction::All => each.into_iter().fold(Truth::Known(true), Truth::and).into(),
                    naga::RelationalFunction::Any => each.into_iter().fold(Truth::Known(false), Truth::or).into(),
                    _ => return Err(Fault::unsupported(span, "this function")),
                }
            }
            Expression::As { expr, kind, convert } => {
                if convert.is_none() {
                    return Err(Fault::unsupported(span, "`bitcast`"));
                }
                let value = of(self, expr)?;
                value.map(&mut |x| cast(x, kind, span))?
            }
            Expression::GlobalVariable(_) => {
                return Err(Fault::unsupported(span, "a variable outside functions")
                    .fix("use `const` outside functions, `let` and `var` inside"));
            }
            Expression::Override(_) => {
                return Err(Fault::unsupported(span, "`override`").fix("use `const`, or a member of Parameters"));
            }
            _ => return Err(Fault::unsupported(span, "this expression")),
        })
    }

    /// The value of a constant expression of the module.
    fn global(&mut self, handle: Handle<Expression>) -> Outcome<Value> {
        let all = &self.module().global_expressions;
        let span = all.get_span(handle);
        self.spend(0, 1, span)?;
        self.pure(&all[handle], span, &mut |machine, operand| machine.global(operand))
    }
}

/// Whether an expression only moves values.
fn is_move(expression: &Expression) -> bool {
    !matches!(
        expression,
        Expression::Unary { .. }
            | Expression::Binary { .. }
            | Expression::Math { .. }
            | Expression::Select { .. }
            | Expression::Relational { .. }
            | Expression::As { .. }
    )
}

fn literal(literal: Literal, span: Span) -> Outcome<Value> {
    Ok(match literal {
        Literal::AbstractFloat(x) => Value::Number(x.into()),
        Literal::F32(x) => Value::Number(decimal(x).into()),
        Literal::I32(n) => Value::Integer(n.into()),
        Literal::U32(n) => Value::Integer(n.into()),
        Literal::AbstractInt(n) => Value::Integer(n),
        Literal::Bool(b) => Truth::Known(b).into(),
        _ => return Err(Fault::unsupported(span, "a number of this type").fix("use f32, i32 or u32")),
    })
}

/// The shortest decimal that is this number in `f32`: `0.1` in a text is 0.1 in `f64` too.
fn decimal(x: f32) -> f64 {
    x.to_string().parse().unwrap_or_else(|_| x.into())
}

/// A part of a value, or the place of a part.
fn part(base: &Value, index: u32, span: Span) -> Outcome<Value> {
    if let Value::Place(place) = base {
        let path = place.path.iter().copied().chain([index]).collect();
        return Ok(Value::Place(Place { slot: place.slot, path }.into()));
    }
    let count = base.parts().len();
    base.parts().get(index as usize).cloned().ok_or_else(|| {
        Fault::new(span, "an index is out of range")
            .found(index.to_string())
            .wanted(format!("0 to {}", count.max(1) - 1))
    })
}

fn select(condition: &Value, a: &Value, b: &Value, span: Span) -> Outcome<Value> {
    match condition {
        Value::Many(each) => {
            let parts = each.iter().zip(a.parts().iter().zip(b.parts()));
            Ok(Value::many(parts.map(|(c, (a, b))| select(c, a, b, span)).collect::<Outcome<Vec<_>>>()?))
        }
        _ => Ok(Value::choose(arithmetic::truth(condition, span)?, a, b)),
    }
}

/// A scalar as another kind of scalar.
#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss)]
fn cast(x: &Value, kind: ScalarKind, span: Span) -> Outcome<Value> {
    let whole = |n: i64| match kind {
        ScalarKind::Uint => i64::from(n as u32),
        _ => i64::from(n as i32),
    };
    match (x, kind) {
        (Value::Number(_), ScalarKind::Float) | (Value::Truth(_), ScalarKind::Bool) => Ok(x.clone()),
        (Value::Integer(n), ScalarKind::Float) => Ok(Scalar::from(*n as f64).into()),
        (Value::Truth(truth), ScalarKind::Float) => Ok(truth.number().into()),
        (Value::Integer(n), ScalarKind::Sint | ScalarKind::Uint) => Ok(Value::Integer(whole(*n))),
        (Value::Truth(Truth::Known(b)), ScalarKind::Sint | ScalarKind::Uint) => Ok(Value::Integer(i64::from(*b))),
        (Value::Integer(n), ScalarKind::Bool) => Ok(Truth::Known(*n != 0).into()),
        (Value::Number(x), ScalarKind::Bool) => Ok(Truth::from(x.eq(0.0)).not().into()),
        (Value::Number(x), ScalarKind::Sint | ScalarKind::Uint) => match x.constant() {
            Some(x) if kind == ScalarKind::Sint => Ok(Value::Integer(i64::from(x as i32))),
            Some(x) => Ok(Value::Integer(i64::from(x as u32))),
            None => Err(varies(span)),
        },
        _ => Err(varies(span)),
    }
}

/// An integer that would differ between particles.
pub(super) fn varies(span: Span) -> Box<Fault> {
    Fault::new(span, "an integer depends on numbers of a particle")
        .wanted("integers that are known when the law is read")
        .fix("compute with f32, and choose with `if` or `select`")
}
