//! A traced function: named inputs, named outputs, and the instructions between them.

use std::fmt;
use std::sync::{Arc, OnceLock};

use super::graph::{Form, Id, Node};
use super::handle::{Condition, Scalar};
use super::lower::Code;
use super::principal::write_out;
use super::trace::{self, Trace};

/// A pointwise function, recorded once, that can be differentiated, run over lanes and printed as WGSL.
///
/// Cheap to clone (one reference count), `Send` and `Sync`. Its `Display` is a readable listing:
///
/// ```
/// use gradreel::scalar::Program;
///
/// let program = Program::trace("kinetic", &["mass", "speed"], &["energy"], |x| vec![0.5 * x[0] * x[1].square()]);
/// assert_eq!(program.to_string(), "\
/// kinetic(mass, speed) -> energy
///   %0 = input mass
///   %1 = input speed
///   %2 = const 0.5
///   %3 = mul %0 %2
///   %4 = mul %1 %1
///   %5 = mul %3 %4
///   energy = %5
/// ");
/// ```
#[derive(Clone)]
pub struct Program(Arc<Body>);

struct Body {
    name: String,
    inputs: Vec<String>,
    outputs: Vec<String>,
    nodes: Vec<Node>,
    results: Vec<Id>,
    plain: OnceLock<(Vec<Node>, Vec<Id>)>,
    code: OnceLock<Code>,
}

impl Program {
    /// Calls `f` once with symbolic inputs and keeps what it computes.
    ///
    /// Equal subexpressions are stored once, constants are folded and whatever no output depends on is dropped.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// assert_eq!(f.eval(&[2.0, 3.0]), [6.0]);
    /// ```
    ///
    /// # Panics
    /// If `f` returns another number of values than there are output names; if a name is not an identifier or
    /// occurs twice in its list.
    #[track_caller]
    pub fn trace(name: &str, inputs: &[&str], outputs: &[&str], f: impl FnOnce(&[Scalar]) -> Vec<Scalar>) -> Self {
        let owned = |names: &[&str]| names.iter().map(ToString::to_string).collect();
        Self::record(name.to_owned(), owned(inputs), owned(outputs), f)
    }

    #[track_caller]
    pub(super) fn record(
        name: String,
        inputs: Vec<String>,
        outputs: Vec<String>,
        f: impl FnOnce(&[Scalar]) -> Vec<Scalar>,
    ) -> Self {
        check_names(&name, std::slice::from_ref(&name));
        check_names(&name, &inputs);
        check_names(&name, &outputs);
        let trace = Trace::open();
        let handles: Vec<Scalar> = (0..inputs.len()).map(|n| trace.input(n)).collect();
        let values = f(&handles);
        assert!(
            values.len() == outputs.len(),
            "scalar program {name}: the traced function returned {} values, {} outputs are named",
            values.len(),
            outputs.len()
        );
        let (nodes, results) = trace.close(&values);
        Self(Arc::new(Body { name, inputs, outputs, nodes, results, plain: OnceLock::new(), code: OnceLock::new() }))
    }

    /// The name given to [`Program::trace`]; derivatives append `_vjp` or `_jvp`.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// assert_eq!(f.vjp().name(), "area_vjp");
    /// ```
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// The names of the inputs, in calling order.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// assert_eq!(f.inputs(), ["a", "b"]);
    /// ```
    pub fn inputs(&self) -> &[String] {
        &self.0.inputs
    }

    /// The names of the outputs, in order.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// assert_eq!(f.outputs(), ["ab"]);
    /// ```
    pub fn outputs(&self) -> &[String] {
        &self.0.outputs
    }

    /// The number of instructions: inputs and constants do not count, a singular value decomposition counts as one.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// assert_eq!(f.len(), 1);
    /// ```
    pub fn len(&self) -> usize {
        self.plain().0.iter().filter(|node| !matches!(node, Node::Input(_) | Node::Const(_) | Node::Part(..))).count()
    }

    /// Whether every output is an input or a constant.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// assert!(!f.is_empty());
    /// ```
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether the value of output `output` depends on input `input`.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// assert!(f.depends(0, 1));
    /// ```
    ///
    /// # Panics
    /// If either index is out of range.
    #[track_caller]
    pub fn depends(&self, output: usize, input: usize) -> bool {
        assert!(input < self.inputs().len(), "scalar program {}: there is no input {input}", self.name());
        let mut reached = vec![false; self.0.nodes.len()];
        reached[self.0.results[output] as usize] = true;
        for id in (0..self.0.nodes.len()).rev().filter(|&id| id <= self.0.results[output] as usize) {
            if reached[id] {
                if self.0.nodes[id] == Node::Input(input as u32) {
                    return true;
                }
                self.0.nodes[id].operands().for_each(|a| reached[a as usize] = true);
            }
        }
        false
    }

    /// Uses this program inside another traced function, as if its code stood there.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// let twice = Program::trace("twice", &["a"], &["y"], |x| vec![f.apply(&[x[0], x[0]])[0] * 2.0]);
    /// assert_eq!(twice.eval(&[3.0]), [18.0]);
    /// ```
    ///
    /// # Panics
    /// If the number of inputs differs.
    #[track_caller]
    pub fn apply(&self, inputs: &[Scalar]) -> Vec<Scalar> {
        assert!(
            inputs.len() == self.inputs().len(),
            "scalar program {}: {} inputs given, {} wanted",
            self.name(),
            inputs.len(),
            self.inputs().len()
        );
        let values = self.replay(inputs);
        self.0.results.iter().map(|&id| values[id as usize]).collect()
    }

    /// The value of every node, recorded into the open trace.
    pub(super) fn replay(&self, inputs: &[Scalar]) -> Vec<Scalar> {
        let mut values: Vec<Scalar> = Vec::with_capacity(self.0.nodes.len());
        for &node in &self.0.nodes {
            let at = |id: Id| values[id as usize];
            values.push(match node {
                Node::Input(n) => inputs[n as usize],
                Node::Const(bits) => f64::from_bits(bits).into(),
                Node::Unary(op, a) => trace::unary(op, at(a)),
                Node::Binary(op, a, b) => trace::binary(op, at(a), at(b)),
                Node::Select(c, a, b) => Condition::from_mask(at(c)).select(at(a), at(b)),
                Node::Svd(entries) => trace::svd(entries.map(at)),
                Node::Compose(form, [svd, a, b, c]) => trace::compose(form, at(svd), [a, b, c].map(at)),
                Node::Part(of, n) => trace::part(at(of), n),
            });
        }
        values
    }

    pub(super) fn nodes(&self) -> &[Node] {
        &self.0.nodes
    }

    pub(super) fn results(&self) -> &[Id] {
        &self.0.results
    }

    /// Nodes and results with the matrices composed in principal frames written out, made on first use.
    pub(super) fn plain(&self) -> &(Vec<Node>, Vec<Id>) {
        self.0.plain.get_or_init(|| write_out(&self.0.nodes, &self.0.results))
    }

    /// The register code, made on first use.
    pub(super) fn code(&self) -> &Code {
        let (nodes, results) = self.plain();
        self.0.code.get_or_init(|| Code::lower(nodes, results, self.0.inputs.len()))
    }
}

#[track_caller]
fn check_names(program: &str, names: &[String]) {
    for (i, name) in names.iter().enumerate() {
        let mut letters = name.chars();
        let identifier = letters.next().is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
            && letters.all(|c| c.is_ascii_alphanumeric() || c == '_')
            && !name.starts_with("__")
            && name != "_";
        assert!(
            identifier,
            "scalar program {program}: {name:?} is not a name; use ASCII letters, digits and _, \
             beginning with a letter or one _"
        );
        assert!(!names[..i].contains(name), "scalar program {program}: the name {name:?} occurs twice");
    }
}

impl fmt::Display for Program {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}({}) -> {}", self.name(), self.inputs().join(", "), self.outputs().join(", "))?;
        for (id, node) in self.0.nodes.iter().enumerate() {
            match *node {
                Node::Input(n) => writeln!(f, "  %{id} = input {}", self.inputs()[n as usize]),
                Node::Const(bits) => writeln!(f, "  %{id} = const {}", f64::from_bits(bits)),
                Node::Unary(op, a) => writeln!(f, "  %{id} = {} %{a}", op.name()),
                Node::Binary(op, a, b) => writeln!(f, "  %{id} = {} %{a} %{b}", op.name()),
                Node::Select(c, a, b) => writeln!(f, "  %{id} = select %{c} %{a} %{b}"),
                Node::Part(of, n) => writeln!(f, "  %{id} = part %{of} {n}"),
                Node::Svd(_) | Node::Compose(..) => {
                    let name = match *node {
                        Node::Compose(Form::TwoPoint, _) => "compose_two_point",
                        Node::Compose(Form::Left, _) => "compose_left",
                        Node::Compose(Form::Right, _) => "compose_right",
                        _ => "svd",
                    };
                    let operands: Vec<String> = node.operands().map(|operand| format!("%{operand}")).collect();
                    writeln!(f, "  %{id} = {name} {}", operands.join(" "))
                }
            }?;
        }
        for (name, id) in self.outputs().iter().zip(&self.0.results) {
            writeln!(f, "  {name} = %{id}")?;
        }
        Ok(())
    }
}

impl fmt::Debug for Program {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}
