//! What the tape itself costs: bookkeeping per op, and buffers.

use gradreel::{DType, Tape, Tensor};

use crate::harness::{Case, numbers};

/// Ops per run of the chain; its times divided by this are those of one op.
const CHAIN: usize = 2000;

pub fn cases() -> Vec<Case> {
    let chain = |both: bool| {
        let tape = Tape::new();
        let x = tape.leaf(Tensor::scalar(1.0, DType::F32));
        let mut y = x.clone();
        for _ in 0..CHAIN {
            y = &y * 1.0001;
        }
        if both {
            y.into_gradients().expect("a gradient");
        }
    };
    let large = numbers(1, [25 << 20]);
    let add = move |both: bool| {
        let tape = Tape::new();
        let (a, b) = (tape.leaf(large.clone()), tape.leaf(large.clone()));
        let y = &a + &b;
        if both {
            y.sum_all().into_gradients().expect("a gradient");
        }
    };
    vec![
        Case { name: "2000 scalar ops", flop: CHAIN as f64, bytes: 0.0, run: Box::new(chain) },
        Case { name: "add 100 MB", flop: 0.0, bytes: (12 * (25 << 20)) as f64, run: Box::new(add) },
    ]
}
