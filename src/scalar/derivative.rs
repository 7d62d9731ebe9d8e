//! Reverse and forward derivatives of a program, themselves programs.
//!
//! Both replay the program into a new trace and write the rules with the same [`Scalar`] operators that users have, so
//! that derivatives are simplified, shared and differentiable again like everything else.
//!
//! At a kink the derivative is that of the branch taken; on a tie `min` and `max` take their first argument and
//! `abs` takes 0. `floor`, `sign` and comparisons have derivative 0.

use std::collections::HashMap;

use super::frames::{Frames, compose_jvp, compose_vjp, svd_jvp, svd_vjp};
use super::graph::{Id, Node};
use super::handle::{Condition, Scalar};
use super::instruction::{Binary, Unary};
use super::program::Program;
use super::slope::Slopes;
use super::{Mat3, Vec3};

impl Program {
    /// The reverse derivative (adjoint, vector-Jacobian product) with respect to every input.
    ///
    /// Inputs: this program's, then one cotangent `g_<output>` per output. Outputs: one `g_<input>` per input,
    /// `g_xᵢ = Σⱼ g_yⱼ ∂yⱼ/∂xᵢ`.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    ///
    /// let program = Program::trace("f", &["x", "y"], &["z"], |x| vec![x[0].sin() * x[1]]);
    /// let vjp = program.vjp();
    /// assert_eq!(vjp.inputs(), ["x", "y", "g_z"]);
    /// assert_eq!(vjp.outputs(), ["g_x", "g_y"]);
    /// assert_eq!(vjp.eval(&[0.0_f64, 3.0, 1.0]), [3.0, 0.0]);
    /// ```
    pub fn vjp(&self) -> Self {
        let every: Vec<usize> = (0..self.inputs().len()).collect();
        self.vjp_wrt(&every)
    }

    /// The reverse derivative with respect to the inputs `which` only, in that order; what only the others need is left
    /// out. The inputs are those of [`Program::vjp`].
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("f", &["x", "y"], &["z"], |x| vec![x[0] * x[1]]);
    /// // inputs, then the cotangent of z
    /// assert_eq!(f.vjp_wrt(&[1]).eval(&[2.0, 3.0, 1.0]), [2.0]);
    /// ```
    ///
    /// # Panics
    /// If an index is out of range or occurs twice.
    #[track_caller]
    pub fn vjp_wrt(&self, which: &[usize]) -> Self {
        let count = self.inputs().len();
        for (i, &n) in which.iter().enumerate() {
            assert!(n < count, "scalar program {}: there is no input {n} among {count}", self.name());
            assert!(!which[..i].contains(&n), "scalar program {}: input {n} is asked for twice", self.name());
        }
        let inputs = extend_names(self.inputs(), "g_", self.outputs());
        let outputs = which.iter().map(|&n| format!("g_{}", self.inputs()[n])).collect();
        Self::record(format!("{}_vjp", self.name()), inputs, outputs, |x| {
            let adjoints = self.reverse(&x[..count], &x[count..]);
            which.iter().map(|&n| adjoints[n]).collect()
        })
    }

    /// The forward derivative (Jacobian-vector product).
    ///
    /// Inputs: this program's, then one tangent `t_<input>` per input. Outputs: one `t_<output>` per output,
    /// `t_yⱼ = Σᵢ ∂yⱼ/∂xᵢ t_xᵢ`.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    ///
    /// let program = Program::trace("f", &["x"], &["y", "z"], |x| vec![x[0].square(), x[0].exp()]);
    /// assert_eq!(program.jvp().eval(&[0.0_f64, 1.0]), [0.0, 1.0]);
    /// ```
    pub fn jvp(&self) -> Self {
        let count = self.inputs().len();
        let inputs = extend_names(self.inputs(), "t_", self.inputs());
        let outputs = self.outputs().iter().map(|name| format!("t_{name}")).collect();
        Self::record(format!("{}_jvp", self.name()), inputs, outputs, |x| {
            let tangents = self.forward(&x[..count], &x[count..]);
            self.results().iter().map(|&id| tangents[id as usize].unwrap_or(0.0.into())).collect()
        })
    }

    /// Where the results of nodes that have several are.
    fn parts(&self) -> HashMap<(Id, u8), Id> {
        let nodes = self.nodes().iter().enumerate();
        nodes
            .filter_map(|(id, node)| if let Node::Part(of, n) = *node { Some(((of, n), id as Id)) } else { None })
            .collect()
    }

    /// The cotangent of every input.
    fn reverse(&self, inputs: &[Scalar], cotangents: &[Scalar]) -> Vec<Scalar> {
        let values = self.replay(inputs);
        let mut slopes = Slopes::new(self.nodes(), &values);
        let parts = self.parts();
        let mut seen: HashMap<Id, Mat3> = HashMap::new();
        let mut adjoints: Vec<Option<Scalar>> = vec![None; values.len()];
        for (&id, &cotangent) in self.results().iter().zip(cotangents) {
            accumulate(&mut adjoints, id, cotangent);
        }
        let mut of_inputs = vec![Scalar::from(0.0); inputs.len()];
        for (id, &node) in self.nodes().iter().enumerate().rev() {
            let gathered = |adjoints: &[Option<Scalar>], first: u8| -> Option<Mat3> {
                let of = |n: u8| *adjoints.get(*parts.get(&(id as Id, n))? as usize)?;
                let entries: Vec<Option<Scalar>> = (first..first + 9).map(of).collect();
                entries.iter().any(Option::is_some).then(|| {
                    let entries: Vec<Scalar> = entries.iter().map(|entry| entry.unwrap_or(0.0.into())).collect();
                    Mat3::from_slice(&entries)
                })
            };
            match node {
                Node::Compose(form, operands) => {
                    let Some(cotangent) = gathered(&adjoints, 0) else { continue };
                    let [svd, d @ ..] = operands;
                    let frames = Frames::of(values[svd as usize]);
                    let (on_values, on_p) = compose_vjp(form, &frames, operands, &mut slopes, cotangent);
                    (0..3).for_each(|k| accumulate(&mut adjoints, d[k], on_values[k]));
                    let sum = seen.entry(svd).or_insert_with(Mat3::zero);
                    *sum = *sum + on_p;
                    continue;
                }
                Node::Svd(entries) => {
                    let mut on_p = seen.remove(&(id as Id));
                    let frames = Frames::of(values[id]);
                    let mut add = |term: Mat3| on_p = Some(on_p.map_or(term, |sum| sum + term));
                    let (on_u, on_v) = (gathered(&adjoints, 0), gathered(&adjoints, 12));
                    if on_u.is_some() || on_v.is_some() {
                        let [on_u, on_v] = [on_u, on_v].map(|frame| frame.unwrap_or_else(Mat3::zero));
                        add(svd_vjp(&frames, on_u, on_v));
                    }
                    let of = |n: u8| adjoints[*parts.get(&(id as Id, n))? as usize];
                    let on_sigma = [9, 10, 11].map(of);
                    if on_sigma.iter().any(Option::is_some) {
                        add(Mat3::diag(Vec3(on_sigma.map(|g| g.unwrap_or(0.0.into())))));
                    }
                    let Some(on_p) = on_p else { continue };
                    let cotangent = frames.turned_back(on_p).to_vec();
                    (0..9).for_each(|n| accumulate(&mut adjoints, entries[n], cotangent[n]));
                    continue;
                }
                _ => {}
            }
            let Some(g) = adjoints[id] else { continue };
            if let Node::Binary(Binary::Mul, a, b) = node
                && a == b
            {
                // the squares of a sum share this double
                accumulate(&mut adjoints, a, (g * 2.0) * values[a as usize]);
                continue;
            }
            match rule(node, &values, values[id]) {
                Rule::Leaf => {
                    if let Node::Input(n) = node {
                        of_inputs[n as usize] = g;
                    }
                }
                Rule::Product(factors) => {
                    for (operand, factor) in factors.into_iter().flatten() {
                        accumulate(&mut adjoints, operand, g * factor);
                    }
                }
                Rule::Choice { condition, a, b } => {
                    accumulate(&mut adjoints, a, condition.select(g, 0.0));
                    accumulate(&mut adjoints, b, condition.select(0.0, g));
                }
            }
        }
        of_inputs
    }

    /// The tangent of every node; `None` where it is 0.
    fn forward(&self, inputs: &[Scalar], tangents: &[Scalar]) -> Vec<Option<Scalar>> {
        let values = self.replay(inputs);
        let mut slopes = Slopes::new(self.nodes(), &values);
        // The changes of decompositions, seen from their frames, and of the results of nodes that have several.
        let mut seen: HashMap<Id, Mat3> = HashMap::new();
        let mut results: HashMap<(Id, u8), Scalar> = HashMap::new();
        let mut of_nodes: Vec<Option<Scalar>> = Vec::with_capacity(values.len());
        for (id, &node) in self.nodes().iter().enumerate() {
            let mut give = |first: u8, values: &[Scalar]| {
                for (n, &value) in (first..).zip(values) {
                    results.insert((id as Id, n), value);
                }
            };
            let or_zero = |of: Option<Scalar>| of.unwrap_or(0.0.into());
            match node {
                Node::Svd(entries) if entries.iter().any(|&at| of_nodes[at as usize].is_some()) => {
                    let change = entries.map(|at| or_zero(of_nodes[at as usize]));
                    let frames = Frames::of(values[id]);
                    let p = frames.seen(Mat3::from_slice(&change));
                    let [on_u, on_v] = svd_jvp(&frames, p);
                    give(0, &on_u.to_vec());
                    give(9, &[0, 1, 2].map(|k| p.0[k][k]));
                    give(12, &on_v.to_vec());
                    seen.insert(id as Id, p);
                }
                Node::Compose(form, operands)
                    if operands.iter().any(|at| of_nodes[*at as usize].is_some() || seen.contains_key(at)) =>
                {
                    let [svd, d @ ..] = operands;
                    let change = Vec3(d.map(|at| or_zero(of_nodes[at as usize])));
                    let p = seen.get(&svd).copied().unwrap_or_else(Mat3::zero);
                    let frames = Frames::of(values[svd as usize]);
                    give(0, &compose_jvp(form, &frames, operands, &mut slopes, change, p).to_vec());
                }
                _ => {}
            }
            let tangent = match rule(node, &values, values[id]) {
                Rule::Leaf => match node {
                    Node::Part(of, n) => results.get(&(of, n)).copied(),
                    Node::Input(n) => Some(tangents[n as usize]),
                    _ => None,
                },
                Rule::Product(factors) => factors
                    .into_iter()
                    .flatten()
                    .filter_map(|(operand, factor)| Some(of_nodes[operand as usize]? * factor))
                    .reduce(|sum, term| sum + term),
                Rule::Choice { condition, a, b } => match (of_nodes[a as usize], of_nodes[b as usize]) {
                    (None, None) => None,
                    (a, b) => Some(condition.select(a.unwrap_or(0.0.into()), b.unwrap_or(0.0.into()))),
                },
            };
            of_nodes.push(tangent);
        }
        of_nodes
    }
}

/// How a change of a node's operands changes the node.
pub(super) enum Rule {
    /// An input, a constant, something flat, or a node with several results, which `frames.rs` differentiates.
    Leaf,
    /// Operands with the partial derivative of the node to each.
    Product([Option<(Id, Scalar)>; 2]),
    /// The change of `a` where the condition holds, of `b` elsewhere.
    Choice { condition: Condition, a: Id, b: Id },
}

/// The derivative rule of every instruction; `y` is the value of the node itself.
pub(super) fn rule(node: Node, values: &[Scalar], y: Scalar) -> Rule {
    let at = |id: Id| values[id as usize];
    let one = Scalar::from(1.0);
    match node {
        Node::Input(_) | Node::Const(_) | Node::Svd(_) | Node::Compose(..) | Node::Part(..) => Rule::Leaf,
        Node::Unary(op, a) => {
            let x = at(a);
            let factor = match op {
                Unary::Neg => -one,
                Unary::Abs => x.sign(),
                Unary::Sign | Unary::Floor => return Rule::Leaf,
                Unary::Recip => -y.square(),
                Unary::Sqrt => 0.5 / y,
                Unary::Exp => y,
                Unary::Ln => x.recip(),
                Unary::Sin => x.cos(),
                Unary::Cos => -x.sin(),
                Unary::Tanh => 1.0 - y.square(),
                // Not y (1 − y): 1 − y has no digits left where y is nearly 1.
                Unary::Logistic => y * (-x).logistic(),
                Unary::Softplus => x.logistic(),
                Unary::Ln1p => (1.0 + x).recip(),
                // Not y + 1, for the same reason near y = −1.
                Unary::ExpM1 => x.exp(),
                Unary::Erf => std::f64::consts::FRAC_2_SQRT_PI * (-x.square()).exp(),
            };
            Rule::Product([Some((a, factor)), None])
        }
        Node::Binary(op, a, b) => {
            let (to_a, to_b) = match op {
                Binary::Add => (one, one),
                Binary::Sub => (one, -one),
                Binary::Mul => (at(b), at(a)),
                Binary::Div => {
                    let scale = at(b).recip();
                    (scale, -(y * scale))
                }
                Binary::Min => return Rule::Choice { condition: at(a).le(at(b)), a, b },
                Binary::Max => return Rule::Choice { condition: at(a).ge(at(b)), a, b },
                Binary::Powf => {
                    let (base, exponent) = (at(a), at(b));
                    // a⁰ is 1 for all a, and 0ᵇ is flat for b ≥ 0: a base of 1 stands in there, whose power and
                    // logarithm are finite, so that derivatives of these are finite, too
                    let power = exponent.eq(0.0).select(1.0, base).powf(exponent - 1.0);
                    let flat = base.eq(0.0).and(exponent.ge(0.0));
                    (exponent * power, y * flat.select(1.0, base).ln())
                }
                Binary::Lt | Binary::Le => return Rule::Leaf,
            };
            Rule::Product([Some((a, to_a)), Some((b, to_b))])
        }
        Node::Select(c, a, b) => Rule::Choice { condition: Condition::from_mask(at(c)), a, b },
    }
}

fn accumulate(adjoints: &mut [Option<Scalar>], id: Id, term: Scalar) {
    let slot = &mut adjoints[id as usize];
    *slot = Some(slot.map_or(term, |sum| sum + term));
}

/// `names`, then the prefixed `more`, each made unique by trailing underscores.
fn extend_names(names: &[String], prefix: &str, more: &[String]) -> Vec<String> {
    let mut all = names.to_vec();
    for name in more {
        let mut name = format!("{prefix}{name}");
        while all.contains(&name) {
            name.push('_');
        }
        all.push(name);
    }
    all
}
