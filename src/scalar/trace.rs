//! The arena a function's operations are written into while it is being traced.
//!
//! One per [`Program::trace`](super::Program::trace) call, kept on a thread-local stack so that a trace may start
//! another.

use std::cell::RefCell;
use std::sync::atomic::{AtomicU64, Ordering};

use super::graph::{Form, Graph, Id, Node};
use super::handle::{Repr, Scalar};
use super::instruction::{Binary, Unary};

/// Names a trace for good, so that a stale handle is noticed instead of being read from the wrong graph.
static NEXT_SERIAL: AtomicU64 = AtomicU64::new(0);

thread_local! {
    static OPEN: RefCell<Vec<(u64, Graph)>> = const { RefCell::new(Vec::new()) };
}

/// An open trace; closes when dropped, also when the traced function panics.
pub(super) struct Trace {
    serial: u64,
}

impl Trace {
    /// Opens a trace on this thread.
    pub fn open() -> Self {
        let serial = NEXT_SERIAL.fetch_add(1, Ordering::Relaxed);
        OPEN.with_borrow_mut(|open| open.push((serial, Graph::default())));
        Self { serial }
    }

    /// The handle of the n-th input.
    pub fn input(&self, n: usize) -> Scalar {
        let n = u32::try_from(n).expect("a scalar program has fewer than 2^32 inputs");
        Scalar(Repr::Node { trace: self.serial, id: with_innermost(|_, graph| graph.push(Node::Input(n))) })
    }

    /// The nodes the outputs depend on, and the outputs' positions among them.
    #[track_caller]
    pub fn close(self, outputs: &[Scalar]) -> (Vec<Node>, Vec<Id>) {
        let mut ids = Vec::with_capacity(outputs.len());
        for &output in outputs {
            ids.push(id_of(output));
        }
        with_innermost(|_, graph| graph.reachable(&ids))
    }
}

impl Drop for Trace {
    fn drop(&mut self) {
        OPEN.with_borrow_mut(|open| open.retain(|(serial, _)| *serial != self.serial));
    }
}

/// Panics outside the borrow, so that the message names the caller's line.
#[track_caller]
fn with_innermost<R>(f: impl FnOnce(u64, &mut Graph) -> R) -> R {
    let done = OPEN.with_borrow_mut(|open| open.last_mut().map(|(serial, graph)| f(*serial, graph)));
    match done {
        Some(result) => result,
        None => panic!("scalar: a traced value is used outside Program::trace; return it from the traced function"),
    }
}

/// The node of a handle in the innermost trace.
#[track_caller]
fn id_of(x: Scalar) -> Id {
    match x.0 {
        Repr::Const(value) => with_innermost(|_, graph| graph.push(Node::constant(value))),
        Repr::Node { trace, id } => {
            assert!(
                with_innermost(|serial, _| serial == trace),
                "scalar: a value of another trace is used here; a traced value lives only inside the call of \
                 Program::trace that made it (to use a program inside another, call Program::apply)"
            );
            id
        }
    }
}

#[track_caller]
fn push(node: Node) -> Scalar {
    with_innermost(|trace, graph| Scalar(Repr::Node { trace, id: graph.push(node) }).known(graph))
}

impl Scalar {
    /// The same value as a plain number if it simplified to a constant.
    fn known(self, graph: &Graph) -> Self {
        match self.0 {
            Repr::Node { id, .. } => graph.constant(id).map_or(self, Self::from),
            Repr::Const(_) => self,
        }
    }
}

/// Records (or, for a plain number, computes) an instruction of one operand.
#[track_caller]
pub(super) fn unary(op: Unary, a: Scalar) -> Scalar {
    match a.0 {
        Repr::Const(a) => Scalar::from(op.eval(a)),
        Repr::Node { .. } => push(Node::Unary(op, id_of(a))),
    }
}

/// Records (or, for plain numbers, computes) an instruction of two operands.
#[track_caller]
pub(super) fn binary(op: Binary, a: Scalar, b: Scalar) -> Scalar {
    match (a.0, b.0) {
        (Repr::Const(a), Repr::Const(b)) => Scalar::from(op.eval(a, b)),
        _ => push(Node::Binary(op, id_of(a), id_of(b))),
    }
}

/// Records the singular value decomposition of a matrix, row by row.
#[track_caller]
pub(super) fn svd(entries: [Scalar; 9]) -> Scalar {
    push(Node::Svd(entries.map(id_of)))
}

/// Records the matrix of a form with the values `d` in the frames of `svd`.
#[track_caller]
pub(super) fn compose(form: Form, svd: Scalar, d: [Scalar; 3]) -> Scalar {
    push(Node::Compose(form, [svd, d[0], d[1], d[2]].map(id_of)))
}

/// The n-th result of a node that has several.
#[track_caller]
pub(super) fn part(of: Scalar, n: u8) -> Scalar {
    push(Node::Part(id_of(of), n))
}

/// If the nine entries are those of `U diag(d) Vᵀ`, in order: the decomposition, and `d`.
#[track_caller]
pub(super) fn two_point(entries: [Scalar; 9]) -> Option<(Scalar, [Scalar; 3])> {
    let mut of = None;
    for (n, entry) in entries.into_iter().enumerate() {
        let Repr::Node { .. } = entry.0 else { return None };
        let id = id_of(entry);
        match with_innermost(|_, graph| graph.node(id)) {
            Node::Part(composed, part) if usize::from(part) == n && of.is_none_or(|known| known == composed) => {
                of = Some(composed);
            }
            _ => return None,
        }
    }
    with_innermost(|trace, graph| match graph.node(of?) {
        Node::Compose(Form::TwoPoint, operands) => {
            let [svd, a, b, c] = operands.map(|id| Scalar(Repr::Node { trace, id }).known(graph));
            Some((svd, [a, b, c]))
        }
        _ => None,
    })
}

/// Records (or, for a known condition, makes) a choice.
#[track_caller]
pub(super) fn select(condition: Scalar, a: Scalar, b: Scalar) -> Scalar {
    match condition.0 {
        Repr::Const(condition) => {
            if condition == 0.0 {
                b
            } else {
                a
            }
        }
        Repr::Node { .. } => push(Node::Select(id_of(condition), id_of(a), id_of(b))),
    }
}
