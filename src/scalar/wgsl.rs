//! A program as a WGSL function in `f32`.
//!
//! Built-in functions of WGSL may be inaccurate (`log` near 1, `tanh` near 0, `sin` and `cos` near their zeros) or drop NaN (`min`, `max`, on some
//! drivers `exp`); for these the text brings functions of its own, from `kernels/shared/`. A literal cannot be infinite
//! or NaN: such constants are made from bits that are only known when the shader runs.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::graph::Node;
use super::instruction::{Binary, Unary};
use super::program::Program;

/// A function that the emitted code may call, with the positions of those it calls itself.
struct Fragment {
    source: &'static str,
    needs: &'static [usize],
}

macro_rules! fragments {
    ($($index:ident = $position:literal, $file:literal, needs $needs:expr;)*) => {
        $(const $index: usize = $position;)*
        /// In an order in which each comes after those it needs.
        const FRAGMENTS: &[Fragment] =
            &[$(Fragment { source: include_str!(concat!("../../kernels/shared/", $file)), needs: $needs }),*];
    };
}

fragments! {
    IS_NAN = 0, "is_nan.wgsl", needs &[];
    MIN = 1, "min.wgsl", needs &[IS_NAN];
    MAX = 2, "max.wgsl", needs &[IS_NAN];
    SIGN = 3, "sign.wgsl", needs &[];
    LN = 4, "ln.wgsl", needs &[];
    LN_1P = 5, "ln_1p.wgsl", needs &[LN];
    EXP_M1 = 6, "exp_m1.wgsl", needs &[EXP];
    TANH = 7, "tanh.wgsl", needs &[EXP_M1, IS_NAN];
    EXP = 8, "exp.wgsl", needs &[IS_NAN];
    LOGISTIC = 9, "logistic.wgsl", needs &[EXP];
    SOFTPLUS = 10, "softplus.wgsl", needs &[LN_1P, IS_NAN];
    POWF = 11, "powf.wgsl", needs &[LN, EXP];
    ERF = 12, "erf.wgsl", needs &[EXP, IS_NAN];
    SIN_COS = 13, "sin_cos.wgsl", needs &[];
    SIN = 14, "sin.wgsl", needs &[SIN_COS];
    COS = 15, "cos.wgsl", needs &[SIN_COS];
    SVD = 16, "svd.wgsl", needs &[];
}

/// Built-in functions that emitted code calls, which a program's own name must not hide.
const BUILT_IN: [&str; 8] = ["abs", "floor", "sqrt", "exp", "sin", "cos", "select", "bitcast"];

impl Program {
    /// The program as a WGSL function, preceded by the functions it calls.
    ///
    /// `fn <name>(in_<input>: f32, …) -> f32` for one output; for more, the function returns `struct <name>_out` with
    /// one `f32` member per output. See [`Program::wgsl_name`] and [`Program::wgsl_members`] for names that WGSL
    /// reserves. To put several programs into one shader, use [`wgsl_module`].
    ///
    /// ```
    /// use gradreel::scalar::Program;
    ///
    /// let program = Program::trace("mirror", &["x", "y"], &["u", "v"], |v| {
    ///     vec![v[0] * v[1].abs(), v[0] * v[1].sqrt()]
    /// });
    /// assert_eq!(program.wgsl(), "\
    /// struct mirror_out {
    ///     u: f32,
    ///     v: f32,
    /// }
    ///
    /// fn mirror(in_x: f32, in_y: f32) -> mirror_out {
    ///     let v2 = abs(in_y);
    ///     let v3 = in_x * v2;
    ///     let v4 = sqrt(in_y);
    ///     let v5 = in_x * v4;
    ///     return mirror_out(v3, v5);
    /// }
    /// ");
    /// ```
    pub fn wgsl(&self) -> String {
        wgsl_module(&[self])
    }

    /// The name of the WGSL function: the program's, with `_` appended where WGSL has that name for itself.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// assert_eq!(f.wgsl_name(), "area");
    /// ```
    pub fn wgsl_name(&self) -> String {
        let name = self.name();
        if is_reserved(name) || BUILT_IN.contains(&name) || name.starts_with("scalar_") {
            format!("{name}_")
        } else {
            name.to_owned()
        }
    }

    /// The names of the members of the result struct: the outputs', with `_` appended where WGSL reserves the word.
    ///
    /// ```
    /// use gradreel::scalar::Program;
    /// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
    /// assert_eq!(f.wgsl_members(), ["ab"]);
    /// ```
    pub fn wgsl_members(&self) -> Vec<String> {
        let member = |name: &String| if is_reserved(name) { format!("{name}_") } else { name.clone() };
        self.outputs().iter().map(member).collect()
    }

    fn write_function(&self, text: &mut String) -> std::fmt::Result {
        let (name, members) = (self.wgsl_name(), self.wgsl_members());
        let result = match &members[..] {
            [] => String::new(),
            [_] => " -> f32".to_owned(),
            _ => {
                writeln!(text, "struct {name}_out {{")?;
                members.iter().try_for_each(|member| writeln!(text, "    {member}: f32,"))?;
                writeln!(text, "}}\n")?;
                format!(" -> {name}_out")
            }
        };
        let parameters: Vec<String> = self.inputs().iter().map(|input| format!("in_{input}: f32")).collect();
        writeln!(text, "fn {name}({}){result} {{", parameters.join(", "))?;
        if self.plain().0.iter().any(|node| matches!(node, Node::Const(bits) if !single(*bits).is_finite())) {
            writeln!(text, "    var infinite = 0x7f800000u;")?;
        }
        let (nodes, results) = self.plain();
        let mut values: Vec<String> = Vec::with_capacity(nodes.len());
        for (id, &node) in nodes.iter().enumerate() {
            let value = match node {
                Node::Input(n) => format!("in_{}", self.inputs()[n as usize]),
                Node::Const(bits) => constant(single(bits)),
                Node::Part(of, n) => part(&values[of as usize], usize::from(n)),
                _ => {
                    writeln!(text, "    let v{id} = {};", expression(node, &values))?;
                    format!("v{id}")
                }
            };
            values.push(value);
        }
        let results: Vec<&str> = results.iter().map(|&id| values[id as usize].as_str()).collect();
        match &results[..] {
            [] => {}
            [one] => writeln!(text, "    return {one};")?,
            all => writeln!(text, "    return {name}_out({});", all.join(", "))?,
        }
        writeln!(text, "}}")
    }
}

/// The WGSL functions of several programs, with the functions they call written once.
///
/// ```
/// use gradreel::scalar::Program;
/// let f = Program::trace("area", &["a", "b"], &["ab"], |x| vec![x[0] * x[1]]);
/// assert!(gradreel::scalar::wgsl_module(&[&f, &f.vjp()]).contains("fn area_vjp"));
/// ```
///
/// # Panics
/// If two of the programs have the same name.
#[track_caller]
pub fn wgsl_module(programs: &[&Program]) -> String {
    let mut needed = BTreeSet::new();
    for (i, program) in programs.iter().enumerate() {
        let name = program.wgsl_name();
        assert!(programs[..i].iter().all(|other| other.wgsl_name() != name), "two scalar programs are named {name}");
        program.plain().0.iter().filter_map(|&node| fragment(node)).for_each(|at| require(at, &mut needed));
    }
    let mut text = String::new();
    for at in needed {
        text.push_str(FRAGMENTS[at].source);
        text.push('\n');
    }
    for (i, program) in programs.iter().enumerate() {
        text.push_str(if i > 0 { "\n" } else { "" });
        program.write_function(&mut text).expect("writing to a string succeeds");
    }
    text
}

fn require(at: usize, needed: &mut BTreeSet<usize>) {
    needed.insert(at);
    FRAGMENTS[at].needs.iter().for_each(|&at| require(at, needed));
}

fn is_reserved(name: &str) -> bool {
    naga::keywords::wgsl::RESERVED.contains(&name)
}

#[allow(clippy::cast_possible_truncation)]
fn single(bits: u64) -> f32 {
    f64::from_bits(bits) as f32
}

/// A constant as an operand.
fn constant(value: f32) -> String {
    if value.is_nan() {
        "bitcast<f32>(infinite | 0x400000u)".to_owned()
    } else if value.is_infinite() {
        format!("({}bitcast<f32>(infinite))", if value < 0.0 { "-" } else { "" })
    } else if value.is_sign_negative() {
        format!("({value:?}f)")
    } else {
        format!("{value:?}f")
    }
}

/// The function that an instruction calls, if WGSL's own is not good enough.
fn fragment(node: Node) -> Option<usize> {
    match node {
        Node::Unary(Unary::Erf, _) => Some(ERF),
        Node::Unary(Unary::Exp, _) => Some(EXP),
        Node::Unary(Unary::Sign, _) => Some(SIGN),
        Node::Unary(Unary::Sin, _) => Some(SIN),
        Node::Unary(Unary::Cos, _) => Some(COS),
        Node::Unary(Unary::Ln, _) => Some(LN),
        Node::Unary(Unary::Tanh, _) => Some(TANH),
        Node::Unary(Unary::Logistic, _) => Some(LOGISTIC),
        Node::Unary(Unary::Softplus, _) => Some(SOFTPLUS),
        Node::Unary(Unary::Ln1p, _) => Some(LN_1P),
        Node::Unary(Unary::ExpM1, _) => Some(EXP_M1),
        Node::Binary(Binary::Min, ..) => Some(MIN),
        Node::Binary(Binary::Max, ..) => Some(MAX),
        Node::Binary(Binary::Powf, ..) => Some(POWF),
        Node::Svd(_) => Some(SVD),
        _ => None,
    }
}

/// A result of a decomposition; WGSL indexes matrices by column, then row.
fn part(of: &str, n: usize) -> String {
    match n {
        0..9 => format!("{of}.u[{}][{}]", n % 3, n / 3),
        9..12 => format!("{of}.sigma[{}]", n - 9),
        _ => format!("{of}.v[{}][{}]", n % 3, n / 3 - 4),
    }
}

fn expression(node: Node, values: &[String]) -> String {
    let at = |id: u32| values[id as usize].as_str();
    match node {
        Node::Input(_) | Node::Const(_) | Node::Part(..) => unreachable!("operands are not expressions"),
        Node::Compose(..) => unreachable!("composed matrices have been written out"),
        Node::Svd(entries) => format!("scalar_svd({})", entries.map(at).join(", ")),
        Node::Select(c, a, b) => format!("select({}, {}, {} != 0f)", at(b), at(a), at(c)),
        Node::Unary(Unary::Neg, a) => format!("-{}", at(a)),
        Node::Unary(Unary::Recip, a) => format!("1f / {}", at(a)),
        Node::Unary(op @ (Unary::Abs | Unary::Floor | Unary::Sqrt), a) => {
            format!("{}({})", op.name(), at(a))
        }
        Node::Unary(op, a) => format!("scalar_{}({})", op.name(), at(a)),
        Node::Binary(op, a, b) => {
            let (a, b) = (at(a), at(b));
            match op {
                Binary::Add => format!("{a} + {b}"),
                Binary::Sub => format!("{a} - {b}"),
                Binary::Mul => format!("{a} * {b}"),
                Binary::Div => format!("{a} / {b}"),
                Binary::Lt => format!("select(0f, 1f, {a} < {b})"),
                Binary::Le => format!("select(0f, 1f, {a} <= {b})"),
                Binary::Min | Binary::Max | Binary::Powf => format!("scalar_{}({a}, {b})", op.name()),
            }
        }
    }
}
