//! Matrix products: square ones, long thin ones, and those that weight gradients are made of.

use gradreel::{Tape, Var};

use crate::harness::{Case, numbers};

pub fn cases() -> Vec<Case> {
    vec![
        product("gemm 64^3", [64, 64], [64, 64], Var::matmul),
        product("gemm 1024^3", [1024, 1024], [1024, 1024], Var::matmul),
        product("gemm 1024^3 transposed", [1024, 1024], [1024, 1024], Var::matmul_transposed),
        product("gemm 256x2304x1024", [256, 2304], [2304, 1024], Var::matmul),
        product("gemm 65536x128x128", [65536, 128], [128, 128], Var::matmul),
        product("gemm 65536x39x128", [65536, 39], [39, 128], Var::matmul),
        product("gemm 65536x128x3", [65536, 128], [128, 3], Var::matmul),
        product("gemm 128x65536x128", [65536, 128], [65536, 128], Var::transposed_matmul),
        product("gemm 128x65536x39", [65536, 128], [65536, 39], Var::transposed_matmul),
    ]
}

fn product(name: &'static str, a: [usize; 2], b: [usize; 2], multiply: fn(&Var, &Var) -> Var) -> Case {
    let (left, right) = (numbers(1, a), numbers(2, b));
    let apply = move || {
        let tape = Tape::new();
        let (a, b) = (tape.leaf(left.clone()), tape.leaf(right.clone()));
        multiply(&a, &b)
    };
    let elements = apply().len();
    // the depth is what the elements of both operands and of the result have in common
    let terms = ((a[0] * a[1] * b[0] * b[1]) as f64 * elements as f64).sqrt();
    let run = move |both: bool| {
        let y = apply();
        if both {
            y.sum_all().backward().expect("a gradient");
        }
    };
    let bytes = 4 * (a[0] * a[1] + b[0] * b[1] + elements);
    Case { name, flop: 2.0 * terms, bytes: bytes as f64, run: Box::new(run) }
}
