//! Matrix products.

use gradreel::Tape;

use crate::harness::{Case, numbers};

pub fn cases() -> Vec<Case> {
    let product = |name, m: usize, k: usize, n: usize| {
        let (a, b) = (numbers(1, [m, k]), numbers(2, [k, n]));
        let run = move |both: bool| {
            let tape = Tape::new();
            let (a, b) = (tape.leaf(a.clone()), tape.leaf(b.clone()));
            let y = a.matmul(&b);
            if both {
                y.sum_all().backward().expect("a gradient");
            }
        };
        Case { name, flop: (2 * m * k * n) as f64, bytes: (4 * (m * k + k * n + m * n)) as f64, run: Box::new(run) }
    };
    vec![product("gemm 1024^3", 1024, 1024, 1024), product("gemm 256x2304x1024", 256, 2304, 1024)]
}
