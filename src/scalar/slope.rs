//! Divided differences `(x − y)/(σᵢ − σⱼ)` of two values that are computed from two singular values in the same way.
//!
//! The two expressions are walked side by side. Where they hold the same value the difference is 0; where they end at
//! the two singular values it is 1; in between, every instruction has a rule that is exact and does not cancel, however
//! close the two arguments are: `x y − x′ y′ = x (y − y′) + y′ (x − x′)`, `ln x − ln x′ = 2 artanh((x − x′)/(x + x′))`,
//! and so on. Where the two expressions differ in shape the quotient itself is taken, and the derivative where the two
//! singular values are close.

use std::collections::HashMap;

use super::Vec3;
use super::derivative::{Rule, rule};
use super::graph::{Id, Node};
use super::handle::{Condition, Scalar};
use super::instruction::{Binary, Unary};

/// Where a quotient of differences gives way to a series: half the difference of exponents, or `(x − x′)/(x + x′)`.
const NEAR: f64 = 0.05;

/// The relative distance of two singular values below which an expression without a rule is differentiated instead: a
/// compromise of rounding (an error of `ε/distance`) and curvature (of `distance²`).
const CLOSE: f64 = 3e-3;

/// Divided differences in the program with these nodes, whose values are recorded.
pub(super) struct Slopes<'a> {
    nodes: &'a [Node],
    values: &'a [Scalar],
    known: HashMap<[Id; 2], Option<Scalar>>,
    /// The decomposition and the indices of the singular values.
    pair: Option<(Id, u8, u8)>,
}

impl<'a> Slopes<'a> {
    /// For a program and the values of its nodes.
    pub fn new(nodes: &'a [Node], values: &'a [Scalar]) -> Self {
        Self { nodes, values, known: HashMap::new(), pair: None }
    }

    /// The value of a node.
    pub fn value(&self, id: Id) -> Scalar {
        self.values[id as usize]
    }

    /// `(dᵢ − dⱼ)/(σᵢ − σⱼ)`
    pub fn divided(&mut self, svd: Id, d: [Id; 3], i: usize, j: usize, sigma: &Vec3) -> Scalar {
        self.known.clear();
        self.pair = Some((svd, i as u8, j as u8));
        if let Some(slope) = self.slope(d[i], d[j]) {
            return slope;
        }
        let gap = sigma[i] - sigma[j];
        let close = gap.abs().le(CLOSE * (sigma[i].abs() + sigma[j].abs()));
        let tangent = (self.tangent(d[i]) - self.tangent(d[j])) * 0.5;
        quotient(close, self.value(d[i]) - self.value(d[j]), gap, tangent)
    }

    /// `(x − y)/(σᵢ − σⱼ)`, or nothing where `x` and `y` are not computed alike.
    fn slope(&mut self, x: Id, y: Id) -> Option<Scalar> {
        if x == y {
            return Some(0.0.into());
        }
        if let Some(&known) = self.known.get(&[x, y]) {
            return known;
        }
        let slope = self.slope_of(x, y);
        self.known.insert([x, y], slope);
        slope
    }

    fn slope_of(&mut self, x: Id, y: Id) -> Option<Scalar> {
        let (svd, i, j) = self.pair?;
        match (self.nodes[x as usize], self.nodes[y as usize]) {
            (Node::Part(a, m), Node::Part(b, n)) if a == svd && b == svd => match (m, n) {
                _ if [m, n] == [9 + i, 9 + j] => Some(1.0.into()),
                _ if [m, n] == [9 + j, 9 + i] => Some((-1.0).into()),
                _ => None,
            },
            (Node::Unary(op, a), Node::Unary(same, b)) if op == same => {
                let inner = self.slope(a, b)?;
                let arguments = [self.value(a), self.value(b)];
                Some(inner * of_unary(op, arguments, [self.value(x), self.value(y)])?)
            }
            (Node::Binary(op, a, b), Node::Binary(same, c, d)) if op == same => {
                let aligned = self.of_binary(op, [a, b], [c, d], y);
                let swappable = matches!(op, Binary::Add | Binary::Mul | Binary::Min | Binary::Max);
                aligned.or_else(|| if swappable { self.of_binary(op, [a, b], [d, c], y) } else { None })
            }
            (Node::Select(condition, a, b), Node::Select(same, c, d)) if condition == same => {
                let (then, otherwise) = (self.slope(a, c)?, self.slope(b, d)?);
                Some(Condition::from_mask(self.value(condition)).select(then, otherwise))
            }
            _ => None,
        }
    }

    fn of_binary(&mut self, op: Binary, [a, b]: [Id; 2], [c, d]: [Id; 2], y: Id) -> Option<Scalar> {
        let (first, second) = (self.slope(a, c)?, self.slope(b, d)?);
        let constant = |slope: Scalar| slope.constant() == Some(0.0);
        match op {
            Binary::Add => Some(first + second),
            Binary::Sub => Some(first - second),
            Binary::Mul => Some(self.value(a) * second + self.value(d) * first),
            Binary::Div => Some((first - self.value(y) * second) / self.value(b)),
            Binary::Min | Binary::Max if constant(second) => {
                let (limit, u, v) = (self.value(b), self.value(a), self.value(c));
                let inside = |x: Scalar| if op == Binary::Max { x.ge(limit) } else { x.le(limit) };
                let cut = |x: Scalar| if op == Binary::Max { x.max(limit) } else { x.min(limit) };
                Some(first * quotient(equal(u, v), cut(u) - cut(v), u - v, inside(u).to_scalar()))
            }
            Binary::Powf if constant(second) => {
                let ([u, v], exponent) = ([self.value(a), self.value(c)], self.value(b));
                let logarithms = [u.ln(), v.ln()];
                let outer = exponential(logarithms.map(|x| exponent * x), [u.powf(exponent), v.powf(exponent)]);
                Some(first * outer * exponent * logarithm([u, v], logarithms))
            }
            _ => None,
        }
    }

    /// The change of a node when `σᵢ` grows and `σⱼ` shrinks alike.
    fn tangent(&mut self, id: Id) -> Scalar {
        let Some((svd, i, j)) = self.pair else { return 0.0.into() };
        let mut changes: Vec<Scalar> = Vec::with_capacity(id as usize + 1);
        for (at, &node) in self.nodes[..=id as usize].iter().enumerate() {
            let change = match node {
                Node::Part(of, n) if of == svd && n == 9 + i => 1.0.into(),
                Node::Part(of, n) if of == svd && n == 9 + j => (-1.0).into(),
                Node::Svd(_) | Node::Compose(..) | Node::Part(..) => 0.0.into(),
                _ => match rule(node, self.values, self.values[at]) {
                    Rule::Leaf => 0.0.into(),
                    Rule::Product(factors) => {
                        factors.into_iter().flatten().map(|(operand, factor)| changes[operand as usize] * factor).sum()
                    }
                    Rule::Choice { condition, a, b } => condition.select(changes[a as usize], changes[b as usize]),
                },
            };
            changes.push(change);
        }
        changes[id as usize]
    }
}

/// `(f(a) − f(b))/(a − b)` for the instruction `f`, with `f(a)` and `f(b)` known.
fn of_unary(op: Unary, [a, b]: [Scalar; 2], [x, y]: [Scalar; 2]) -> Option<Scalar> {
    match op {
        Unary::Neg => Some((-1.0).into()),
        Unary::Recip => Some(-(x * y)),
        Unary::Sqrt => Some((x + y).recip()),
        Unary::Exp => Some(exponential([a, b], [x, y])),
        Unary::ExpM1 => Some(exponential([a, b], [x + 1.0, y + 1.0])),
        Unary::Ln => Some(logarithm([a, b], [x, y])),
        Unary::Ln1p => Some(logarithm([a + 1.0, b + 1.0], [x, y])),
        Unary::Abs => Some(quotient(equal(a, b), x - y, a - b, a.sign())),
        _ => None,
    }
}

/// `(eᵃ − eᵇ)/(a − b) = ½ (eᵃ + eᵇ) tanh(h)/h` with `h = ½ (a − b)`
fn exponential([a, b]: [Scalar; 2], [x, y]: [Scalar; 2]) -> Scalar {
    let gap = a - b;
    let half = gap * 0.5;
    let series = power_series(half.square(), &[1.0, -1.0 / 3.0, 2.0 / 15.0, -17.0 / 315.0, 62.0 / 2835.0]);
    quotient(half.abs().lt(NEAR), x - y, gap, (x + y) * 0.5 * series)
}

/// `(ln a − ln b)/(a − b) = 2/(a + b) · artanh(z)/z` with `z = (a − b)/(a + b)`
fn logarithm([a, b]: [Scalar; 2], [x, y]: [Scalar; 2]) -> Scalar {
    let gap = a - b;
    let per_sum = (a + b).recip();
    let z = gap * per_sum;
    let series = power_series(z.square(), &[2.0, 2.0 / 3.0, 2.0 / 5.0, 2.0 / 7.0, 2.0 / 9.0]);
    quotient(z.abs().lt(NEAR), x - y, gap, per_sum * series)
}

/// `c₀ + c₁ x + c₂ x² + …`
fn power_series(x: Scalar, coefficients: &[f64]) -> Scalar {
    coefficients.iter().rev().fold(Scalar::from(0.0), |sum, &c| sum * x + c)
}

/// `limit` where `close`, else `difference/gap`.
fn quotient(close: Condition, difference: Scalar, gap: Scalar, limit: Scalar) -> Scalar {
    close.select(limit, difference / close.select(1.0, gap))
}

/// `a = b`
fn equal(a: Scalar, b: Scalar) -> Condition {
    a.le(b).and(b.le(a))
}
