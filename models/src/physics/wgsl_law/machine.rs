//! Runs a function of a module on symbolic values: statements, calls, and what they may cost.
//!
//! A condition that differs between particles runs both branches, each on its own copy of the variables, and then chooses
//! value by value. Loops and calls are unrolled.

use naga::{
    Arena, Block, Expression, Function, Handle, LocalVariable, Module, Span, Statement, SwitchValue, TypeInner,
};

use super::exit::{Exit, Exits, join};
use super::fault::{Fault, Outcome};
use super::intrinsics;
use super::module::Parsed;
use super::value::{Place, Truth, Value};

/// Most operations of one function of a law, with all that it calls.
const MOST_OPERATIONS: usize = 10_000;
/// Most values that one function may compute while it is unrolled, known ones too.
const MOST_STEPS: usize = 1_000_000;
/// Most turns of a loop.
const MOST_TURNS: usize = 4096;
/// Most functions that call one another.
const MOST_CALLS: usize = 64;
/// Most variables at one time.
const MOST_VARIABLES: usize = 1024;
/// Most scalars of one type.
const MOST_SCALARS: usize = 1024;

/// All variables, of all functions that are being run.
#[derive(Debug, Clone, Default)]
pub(super) struct Variables(pub Vec<Value>);

/// One run of one function.
pub(super) struct Machine<'m> {
    pub parsed: &'m Parsed,
    operations: usize,
    steps: usize,
    calls: usize,
    /// The last place in the user's file.
    last: Span,
}

/// A function that is being run.
pub(super) struct Frame<'m> {
    pub function: &'m Function,
    pub info: &'m naga::valid::FunctionInfo,
    pub arguments: Vec<Value>,
    /// The slot of its first variable.
    pub first: usize,
    /// The values of its expressions so far.
    pub known: Vec<Option<Value>>,
}

impl<'m> Machine<'m> {
    pub fn new(parsed: &'m Parsed) -> Self {
        Self { parsed, operations: 0, steps: 0, calls: 0, last: Span::default() }
    }

    pub fn module(&self) -> &'m Module {
        &self.parsed.module
    }

    /// Counts what has been computed.
    pub fn spend(&mut self, operations: usize, steps: usize, span: Span) -> Outcome<()> {
        if self.parsed.source.is_user(span) {
            self.last = span;
        }
        self.operations += operations;
        self.steps += steps.max(1);
        if self.operations > MOST_OPERATIONS {
            return Err(Fault::new(span, "the law has too many operations")
                .wanted(format!("{MOST_OPERATIONS} operations at most, loops unrolled and calls inlined"))
                .fix("shorten its loops, or name what is computed twice with `let`"));
        }
        if self.steps > MOST_STEPS {
            return Err(Fault::new(span, "the law computes too much before it depends on a particle")
                .wanted(format!("{MOST_STEPS} values at most, loops unrolled"))
                .fix("shorten its loops"));
        }
        Ok(())
    }

    /// A fault without a place in the user's file, at the last place before it.
    pub fn placed(&self, mut fault: Box<Fault>) -> Box<Fault> {
        if !self.parsed.source.is_user(fault.span) {
            fault.span = self.last;
        }
        fault
    }

    /// Calls a function of the module.
    pub fn call(
        &mut self,
        handle: Handle<Function>,
        arguments: Vec<Value>,
        mut variables: Variables,
        span: Span,
    ) -> Outcome<(Variables, Option<Value>)> {
        let module = self.module();
        let function = &module.functions[handle];
        if let Some(found) = intrinsics::call(function.name.as_deref().unwrap_or_default(), &arguments) {
            let (value, cost) = found.ok_or_else(|| Fault::unsupported(span, "an argument of this kind"))?;
            self.spend(if value.is_known() { 0 } else { cost }, cost, span)?;
            return Ok((variables, Some(value)));
        }
        self.calls += 1;
        if self.calls > MOST_CALLS {
            return Err(Fault::new(span, "too many functions call one another")
                .wanted(format!("{MOST_CALLS} at most"))
                .fix("put some of them together"));
        }
        let first = variables.0.len();
        if first + function.local_variables.len() > MOST_VARIABLES {
            return Err(Fault::new(span, "the law has too many variables").wanted(format!("{MOST_VARIABLES} at most")));
        }
        let mut frame = Frame {
            function,
            info: &self.parsed.info[handle],
            arguments,
            first,
            known: vec![None; function.expressions.len()],
        };
        self.spend(0, function.expressions.len(), span)?;
        for (local, variable) in function.local_variables.iter() {
            let value = match variable.init {
                Some(init) => self.value(&mut frame, init, &variables)?,
                None => self.zero(variable.ty, function.local_variables.get_span(local))?,
            };
            variables.0.push(value);
        }
        let exits = self.block(&mut frame, &function.body, variables)?;
        let Some(end) = join(exits.done, exits.on) else {
            return Err(Fault::new(span, "this function never returns").fix("end its loops"));
        };
        let mut variables = end.variables;
        variables.0.truncate(first);
        self.calls -= 1;
        Ok((variables, end.value))
    }

    fn block(&mut self, frame: &mut Frame<'m>, block: &'m Block, variables: Variables) -> Outcome<Exits> {
        let mut all = Exits::default();
        let mut here = Exit::at(variables);
        for (statement, span) in block.span_iter() {
            let reached = here.condition;
            let found = self.statement(frame, statement, *span, here.variables)?;
            let on = all.and_then(reached, found);
            match on {
                Some(next) => here = next,
                None => return Ok(all),
            }
        }
        all.on = Some(here);
        Ok(all)
    }

    fn statement(
        &mut self,
        frame: &mut Frame<'m>,
        statement: &'m Statement,
        span: Span,
        mut variables: Variables,
    ) -> Outcome<Exits> {
        match statement {
            Statement::Emit(range) => {
                for handle in range.clone() {
                    let value = self.evaluate(frame, handle, &variables)?;
                    frame.known[handle.index()] = Some(value);
                }
            }
            Statement::Block(block) => return self.block(frame, block, variables),
            Statement::If { condition, accept, reject } => {
                let condition = self.truth(frame, *condition, &variables)?;
                return match condition {
                    Truth::Known(holds) => self.block(frame, if holds { accept } else { reject }, variables),
                    Truth::Varies(_) => {
                        self.spend(0, variables.0.iter().map(Value::len).sum(), span)?;
                        let yes = self.block(frame, accept, variables.clone())?;
                        let no = self.block(frame, reject, variables)?;
                        Ok(Exits::choose(condition, yes, no))
                    }
                };
            }
            Statement::Switch { selector, cases } => {
                let selector = self.integer(frame, *selector, &variables)?;
                let wanted = |value: &SwitchValue| match *value {
                    SwitchValue::I32(value) => i64::from(value) == selector,
                    SwitchValue::U32(value) => i64::from(value) == selector,
                    SwitchValue::Default => false,
                };
                let chosen = cases.iter().position(|case| wanted(&case.value));
                let default = || cases.iter().position(|case| case.value == SwitchValue::Default);
                let Some(first) = chosen.or_else(default) else { return Ok(Exits::on(variables)) };
                let case = cases[first..].iter().find(|case| !case.fall_through).unwrap_or(&cases[first]);
                let mut exits = self.block(frame, &case.body, variables)?;
                exits.on = join(exits.on.take(), exits.broken.take());
                return Ok(exits);
            }
            Statement::Loop { body, continuing, break_if } => {
                return self.turns(frame, (body, continuing, *break_if), span, variables);
            }
            Statement::Break => return Ok(Exits { broken: Some(Exit::at(variables)), ..Exits::default() }),
            Statement::Continue => return Ok(Exits { again: Some(Exit::at(variables)), ..Exits::default() }),
            Statement::Return { value } => {
                let value = value.map(|value| self.value(frame, value, &variables)).transpose()?;
                return Ok(Exits { done: Some(Exit { value, ..Exit::at(variables) }), ..Exits::default() });
            }
            Statement::Store { pointer, value } => {
                let new = self.value(frame, *value, &variables)?;
                let place = self.place(frame, *pointer, &variables)?;
                let whole = variables.0.get_mut(place.slot);
                whole.and_then(|whole| whole.put(&place.path, new)).ok_or_else(|| {
                    Fault::new(span, "an index is out of range").fix("check the bounds of the loop around it")
                })?;
            }
            Statement::Call { function, arguments, result } => {
                let arguments: Vec<Value> =
                    arguments.iter().map(|&a| self.value(frame, a, &variables)).collect::<Outcome<_>>()?;
                let (after, value) = self.call(*function, arguments, variables, span)?;
                if let (Some(result), Some(value)) = (result, value) {
                    frame.known[result.index()] = Some(value);
                }
                variables = after;
            }
            Statement::Kill => return Err(Fault::unsupported(span, "`discard`")),
            _ => return Err(Fault::unsupported(span, "this statement")),
        }
        Ok(Exits::on(variables))
    }

    fn turns(
        &mut self,
        frame: &mut Frame<'m>,
        (body, continuing, break_if): (&'m Block, &'m Block, Option<Handle<Expression>>),
        span: Span,
        variables: Variables,
    ) -> Outcome<Exits> {
        let mut all = Exits::default();
        let mut here = Exit::at(variables);
        for _ in 0..MOST_TURNS {
            self.spend(0, 1, span)?;
            let reached = here.condition;
            let mut found = self.block(frame, body, here.variables)?;
            found.on = join(found.on.take(), found.again.take());
            let Some(next) = all.and_then(reached, found) else { return Ok(all.after_loop()) };
            let reached = next.condition;
            let found = self.block(frame, continuing, next.variables)?;
            let Some(mut next) = all.and_then(reached, found) else { return Ok(all.after_loop()) };
            if let Some(end) = break_if {
                let end = self.truth(frame, end, &next.variables)?;
                let leaves = Exits { broken: Some(Exit::at(next.variables.clone())), ..Exits::default() };
                let found = match end {
                    Truth::Known(true) => leaves,
                    Truth::Known(false) => Exits::on(next.variables),
                    Truth::Varies(_) => Exits::choose(end, leaves, Exits::on(next.variables)),
                };
                match all.and_then(next.condition, found) {
                    Some(on) => next = on,
                    None => return Ok(all.after_loop()),
                }
            }
            here = next;
        }
        Err(Fault::new(span, "this loop has no constant bound")
            .wanted(format!("a loop whose number of turns is known, {MOST_TURNS} at most"))
            .fix("count its turns: `for (var i = 0; i < 10; i++)`; a `break` inside may depend on a particle"))
    }

    /// A value of zeros.
    pub fn zero(&mut self, ty: Handle<naga::Type>, span: Span) -> Outcome<Value> {
        let mut left = MOST_SCALARS;
        let value = zero(self.module(), ty, &mut left, span)?;
        self.spend(0, MOST_SCALARS - left, span)?;
        Ok(value)
    }
}

fn zero(module: &Module, ty: Handle<naga::Type>, left: &mut usize, span: Span) -> Outcome<Value> {
    let too_large =
        || Fault::new(span, "a type is too large for a law").wanted(format!("{MOST_SCALARS} numbers at most"));
    let mut scalars = |kind: naga::ScalarKind, count: usize| -> Outcome<Value> {
        *left = left.checked_sub(count).ok_or_else(too_large)?;
        Ok(match kind {
            naga::ScalarKind::Float | naga::ScalarKind::AbstractFloat => Value::Number(0.0.into()),
            naga::ScalarKind::Bool => Value::Truth(Truth::Known(false)),
            _ => Value::Integer(0),
        })
    };
    match &module.types[ty].inner {
        TypeInner::Scalar(scalar) => scalars(scalar.kind, 1),
        TypeInner::Vector { size, scalar } => {
            let count = *size as usize;
            Ok(Value::many(vec![scalars(scalar.kind, count)?; count]))
        }
        TypeInner::Matrix { columns, rows, scalar } => {
            let (columns, rows) = (*columns as usize, *rows as usize);
            let one = scalars(scalar.kind, columns * rows)?;
            Ok(Value::many(vec![Value::many(vec![one; rows]); columns]))
        }
        TypeInner::Array { base, size: naga::ArraySize::Constant(count), .. } => {
            let count = count.get() as usize;
            if count > *left {
                return Err(too_large());
            }
            Ok(Value::many((0..count).map(|_| zero(module, *base, left, span)).collect::<Outcome<Vec<_>>>()?))
        }
        TypeInner::Struct { members, .. } => Ok(Value::many(
            members.iter().map(|member| zero(module, member.ty, left, span)).collect::<Outcome<Vec<_>>>()?,
        )),
        _ => Err(Fault::unsupported(span, "a variable of this type")),
    }
}

impl Frame<'_> {
    /// The place of a variable.
    pub fn local(&self, variable: Handle<LocalVariable>) -> Place {
        Place { slot: self.first + variable.index(), path: Vec::new() }
    }

    pub fn span(&self, handle: Handle<Expression>) -> Span {
        let all: &Arena<Expression> = &self.function.expressions;
        all.get_span(handle)
    }
}
