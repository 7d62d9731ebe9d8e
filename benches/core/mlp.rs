//! Multilayer perceptrons of the size of a radiance or deformation field's.

use gradreel::ops::Activation;
use gradreel::{Tape, Var};

use crate::harness::{Case, numbers};

pub fn cases() -> Vec<Case> {
    vec![perceptron("mlp 65536x(39-128-128-3)", 65536, &[39, 128, 128, 3])]
}

fn perceptron(name: &'static str, rows: usize, widths: &'static [usize]) -> Case {
    let terms: usize = widths.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let x = numbers(1, [rows, widths[0]]);
    let layers: Vec<_> = widths.windows(2).map(|w| (numbers(2, [w[1], w[0]]), numbers(3, [w[1]]))).collect();
    let run = move |both: bool| {
        let tape = Tape::new();
        let x = tape.leaf(x.clone());
        let layers: Vec<(Var, Var)> =
            layers.iter().map(|(w, b)| (tape.leaf(w.clone()), tape.leaf(b.clone()))).collect();
        let layers: Vec<(&Var, &Var)> = layers.iter().map(|(w, b)| (w, b)).collect();
        let y = x.mlp(&layers, Activation::Relu);
        if both {
            y.sum_all().backward().expect("a gradient");
        }
    };
    let bytes = 4 * rows * (widths[0] + widths[widths.len() - 1]);
    Case { name, flop: (2 * rows * terms) as f64, bytes: bytes as f64, run: Box::new(run) }
}
