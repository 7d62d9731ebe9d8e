//! Tests that need the inside of the module: single instructions, forced instruction sets, register code.

mod accuracy;
mod derivatives;
mod neo_hookean;
mod paths;
mod principal;
mod structure;
mod wgsl;

use super::instruction::{Binary, Unary};
use super::{Program, Scalar, trace};

/// A program of one instruction of one operand, `y = op(x)`.
fn of_unary(op: Unary) -> Program {
    Program::trace(op.name(), &["x"], &["y"], |x| vec![trace::unary(op, x[0])])
}

/// A program of one instruction of two operands, `y = op(a, b)`.
fn of_binary(op: Binary) -> Program {
    Program::trace(op.name(), &["a", "b"], &["y"], |x| vec![trace::binary(op, x[0], x[1])])
}

/// `c < 0 ? a : b`
fn of_select() -> Program {
    Program::trace("choose", &["c", "a", "b"], &["y"], |x| vec![x[0].lt(0.0).select(x[1], x[2])])
}

/// One program of each instruction.
fn every_instruction() -> Vec<Program> {
    let unary = Unary::ALL.into_iter().map(of_unary);
    unary.chain(Binary::ALL.into_iter().map(of_binary)).chain([of_select()]).collect()
}

/// A long program with all instructions in it, finite for all inputs.
fn everything() -> Program {
    Program::trace("everything", &["x", "y", "z"], &["sum", "copy", "five", "product", "again"], |v| {
        let [x, y, z] = [v[0], v[1], v[2]];
        let positive = x.square() + 0.5;
        let terms = [
            positive.ln() - positive.sqrt(),
            positive.powf(y.tanh()),
            (x * y).sin() * (y + z).cos(),
            x.min(y).exp_m1() * -x.abs().exp().recip(),
            z.max(x).softplus() / positive,
            z.logistic() + positive.ln_1p(),
            x.floor() * y.sign() - x.abs() + z.erf(),
            x.gt(y).and(y.le(z)).or(z.lt(-1.0).not()).select(x * z, y - z),
            -(x - y),
        ];
        let sum: Scalar = terms.into_iter().sum();
        let product = terms[0] * terms[4] + terms[2];
        vec![sum, y, 5.0.into(), product, product]
    })
}
