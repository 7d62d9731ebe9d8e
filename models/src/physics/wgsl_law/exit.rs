//! The ways out of a piece of code, each with the condition under which it is taken.

use super::machine::Variables;
use super::value::{Truth, Value};

/// One way out: when it is taken, and the variables then.
#[derive(Debug)]
pub(super) struct Exit {
    pub condition: Truth,
    pub variables: Variables,
    /// The value that a function returns.
    pub value: Option<Value>,
}

/// All ways out. Their conditions exclude one another.
#[derive(Debug, Default)]
pub(super) struct Exits {
    /// To what follows.
    pub on: Option<Exit>,
    /// By `break`.
    pub broken: Option<Exit>,
    /// By `continue`.
    pub again: Option<Exit>,
    /// By `return`.
    pub done: Option<Exit>,
}

impl Exit {
    /// Always taken.
    pub fn at(variables: Variables) -> Self {
        Self { condition: Truth::Known(true), variables, value: None }
    }

    fn under(self, condition: Truth) -> Self {
        Self { condition: condition.and(self.condition), ..self }
    }
}

/// Two ways out as one.
pub(super) fn join(a: Option<Exit>, b: Option<Exit>) -> Option<Exit> {
    match (a, b) {
        (Some(a), Some(b)) => {
            let condition = a.condition.or(b.condition);
            Some(choose(a.condition, condition, a, b))
        }
        (one, other) => one.or(other),
    }
}

/// `a` where `which` holds, else `b`.
fn choose(which: Truth, condition: Truth, a: Exit, b: Exit) -> Exit {
    let pairs = a.variables.0.iter().zip(&b.variables.0);
    let variables = Variables(pairs.map(|(a, b)| Value::choose(which, a, b)).collect());
    let value = match (a.value, b.value) {
        (Some(a), Some(b)) => Some(Value::choose(which, &a, &b)),
        (one, other) => one.or(other),
    };
    Exit { condition, variables, value }
}

impl Exits {
    /// To what follows, always.
    pub fn on(variables: Variables) -> Self {
        Self { on: Some(Exit::at(variables)), ..Self::default() }
    }

    /// The ways out of two branches.
    pub fn choose(condition: Truth, yes: Self, no: Self) -> Self {
        let both = |a: Option<Exit>, b: Option<Exit>| match (a, b) {
            (Some(a), Some(b)) => {
                let reached = condition.choose(a.condition, b.condition);
                Some(choose(condition, reached, a, b))
            }
            (Some(a), None) => Some(a.under(condition)),
            (None, Some(b)) => Some(b.under(condition.not())),
            (None, None) => None,
        };
        Self {
            on: both(yes.on, no.on),
            broken: both(yes.broken, no.broken),
            again: both(yes.again, no.again),
            done: both(yes.done, no.done),
        }
    }

    /// Adds the ways out of what comes next, which is reached under a condition; returns the way on from there.
    pub fn and_then(&mut self, reached: Truth, next: Self) -> Option<Exit> {
        let lift = |exit: Option<Exit>| exit.map(|exit| exit.under(reached));
        self.broken = join(self.broken.take(), lift(next.broken));
        self.again = join(self.again.take(), lift(next.again));
        self.done = join(self.done.take(), lift(next.done));
        lift(next.on)
    }

    /// The ways out of a loop from those of its body.
    pub fn after_loop(self) -> Self {
        let mut on = self.broken;
        if let (None, Some(on)) = (&self.done, &mut on) {
            // nothing returns inside: every particle gets here
            on.condition = Truth::Known(true);
        }
        Self { on, done: self.done, ..Self::default() }
    }
}
