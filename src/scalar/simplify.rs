//! Simplification of one node against the nodes before it: constants, neutral elements, signs.
//!
//! `x · 0` becomes 0 even though `x` could be infinite at run time: the adjoint of a branch that does not depend on an
//! input has to vanish from the program. Differences `x − x` and quotients `x / x` are left alone, so that a NaN
//! in `x` stays visible. `ln eˣ` becomes `x`, also where the exponential would overflow. Constants are folded in `f64`, and only where the result is finite.

use super::graph::{Graph, Id, Node};
use super::instruction::{Binary, Unary};

impl Graph {
    /// The existing node that `node` equals, or the simplest form of `node` to add.
    pub(super) fn simplify(&mut self, node: Node) -> Result<Id, Node> {
        if let Some(value) = self.fold(node).filter(|value| value.is_finite()) {
            return Ok(self.intern(Node::constant(value)));
        }
        match node {
            Node::Input(_) | Node::Const(_) | Node::Svd(_) | Node::Compose(..) | Node::Part(..) => Err(node),
            Node::Unary(op, a) => self.simplify_unary(op, a),
            Node::Binary(op, a, b) => self.simplify_binary(op, a, b),
            Node::Select(c, a, b) => match self.constant(c) {
                _ if a == b => Ok(a),
                Some(c) => Ok(if c == 0.0 { b } else { a }),
                None => Err(node),
            },
        }
    }

    /// The value of a node all of whose operands are constants.
    fn fold(&self, node: Node) -> Option<f64> {
        match node {
            Node::Unary(op, a) => Some(op.eval(self.constant(a)?)),
            Node::Binary(op, a, b) => Some(op.eval(self.constant(a)?, self.constant(b)?)),
            _ => None,
        }
    }

    /// `a` if the node is `−a`.
    fn negated(&self, id: Id) -> Option<Id> {
        match self.node(id) {
            Node::Unary(Unary::Neg, a) => Some(a),
            _ => None,
        }
    }

    fn simplify_unary(&mut self, op: Unary, a: Id) -> Result<Id, Node> {
        match (op, self.node(a)) {
            (Unary::Neg, Node::Unary(Unary::Neg, x)) => Ok(x),
            (Unary::Neg, Node::Binary(Binary::Sub, x, y)) => Ok(self.push(Node::Binary(Binary::Sub, y, x))),
            (Unary::Abs, Node::Unary(Unary::Abs, _)) | (Unary::Floor, Node::Unary(Unary::Floor, _)) => Ok(a),
            (Unary::Ln, Node::Unary(Unary::Exp, x)) => Ok(x),
            (Unary::Abs, Node::Unary(Unary::Neg, x)) => Ok(self.push(Node::Unary(Unary::Abs, x))),
            _ => Err(Node::Unary(op, a)),
        }
    }

    fn simplify_binary(&mut self, op: Binary, a: Id, b: Id) -> Result<Id, Node> {
        let (constant_a, constant_b) = (self.constant(a), self.constant(b));
        let (negated_a, negated_b) = (self.negated(a), self.negated(b));
        match op {
            Binary::Add => match (constant_a, constant_b, negated_a, negated_b) {
                (Some(0.0), ..) => Ok(b),
                (_, Some(0.0), ..) => Ok(a),
                (.., Some(b)) => Ok(self.push(Node::Binary(Binary::Sub, a, b))),
                (.., Some(a), None) => Ok(self.push(Node::Binary(Binary::Sub, b, a))),
                _ => Err(Node::Binary(op, a.min(b), a.max(b))),
            },
            Binary::Sub => match (constant_a, constant_b, negated_b) {
                (_, Some(0.0), _) => Ok(a),
                (Some(0.0), ..) => Ok(self.push(Node::Unary(Unary::Neg, b))),
                (.., Some(b)) => Ok(self.push(Node::Binary(Binary::Add, a, b))),
                _ => Err(Node::Binary(op, a, b)),
            },
            Binary::Mul => self.simplify_product(a, b),
            Binary::Div => match (constant_a, constant_b) {
                (Some(0.0), _) => Ok(a),
                (Some(1.0), _) => Ok(self.push(Node::Unary(Unary::Recip, b))),
                (_, Some(1.0)) => Ok(a),
                (_, Some(c)) if is_power_of_two(c) => {
                    let factor = self.intern(Node::constant(1.0 / c));
                    Ok(self.push(Node::Binary(Binary::Mul, a, factor)))
                }
                _ => Err(Node::Binary(op, a, b)),
            },
            Binary::Min | Binary::Max if a == b => Ok(a),
            _ => Err(Node::Binary(op, a, b)),
        }
    }

    fn simplify_product(&mut self, a: Id, b: Id) -> Result<Id, Node> {
        match (self.constant(a), self.constant(b), self.negated(a), self.negated(b)) {
            (Some(0.0), ..) => Ok(a),
            (_, Some(0.0), ..) => Ok(b),
            (Some(1.0), ..) => Ok(b),
            (_, Some(1.0), ..) => Ok(a),
            (Some(-1.0), ..) => Ok(self.push(Node::Unary(Unary::Neg, b))),
            (_, Some(-1.0), ..) => Ok(self.push(Node::Unary(Unary::Neg, a))),
            (.., Some(a), Some(b)) => Ok(self.push(Node::Binary(Binary::Mul, a, b))),
            (Some(c), _, _, Some(x)) | (_, Some(c), Some(x), _) => {
                let factor = self.intern(Node::constant(-c));
                Ok(self.push(Node::Binary(Binary::Mul, factor, x)))
            }
            (.., Some(a), None) => {
                let product = self.push(Node::Binary(Binary::Mul, a, b));
                Ok(self.push(Node::Unary(Unary::Neg, product)))
            }
            (.., None, Some(b)) => {
                let product = self.push(Node::Binary(Binary::Mul, a, b));
                Ok(self.push(Node::Unary(Unary::Neg, product)))
            }
            _ => Err(Node::Binary(Binary::Mul, a.min(b), a.max(b))),
        }
    }
}

/// Whether dividing by `c` and multiplying by `1/c` give the same number, in `f32` too.
fn is_power_of_two(c: f64) -> bool {
    c.is_normal() && c.to_bits() & ((1 << 52) - 1) == 0 && (-100.0..=100.0).contains(&c.abs().log2())
}
