//! Normalisation and softmax: one pass over memory, in the best case.

use gradreel::{Tape, Tensor, Var};

use crate::harness::{Case, numbers};

pub fn cases() -> Vec<Case> {
    let image = || numbers(1, [4, 320, 32, 32]);
    let channels = || [numbers(2, [320]), numbers(3, [320])];
    vec![
        case("group norm 4x320x32^2", image(), channels(), |x, affine| x.group_norm(32, 1e-5, Some(affine))),
        case("group norm + SiLU 4x320x32^2", image(), channels(), |x, affine| {
            x.group_norm_silu(32, 1e-5, Some(affine))
        }),
        case("layer norm 4096x320", numbers(1, [4096, 320]), channels(), |x, affine| {
            x.layer_norm(1, 1e-5, Some(affine))
        }),
        case("softmax 8192x1024", numbers(1, [8192, 1024]), channels(), |x, _| x.softmax(1)),
        case("softmax columns 8x1024x1024", numbers(1, [8, 1024, 1024]), channels(), |x, _| x.softmax(1)),
    ]
}

fn case(
    name: &'static str,
    x: Tensor,
    affine: [Tensor; 2],
    normalise: impl Fn(&Var, (&Var, &Var)) -> Var + Send + Sync + 'static,
) -> Case {
    let bytes = (8 * x.len()) as f64;
    let run = move |both: bool| {
        let tape = Tape::new();
        let x = tape.leaf(x.clone());
        let [scale, shift] = affine.each_ref().map(|p| tape.leaf(p.clone()));
        let y = normalise(&x, (&scale, &shift));
        if both {
            y.sum_all().backward().expect("a gradient");
        }
    };
    Case { name, flop: 0.0, bytes, run: Box::new(run) }
}
