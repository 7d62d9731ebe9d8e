//! Attention among tokens and over depth samples.

use gradreel::{Tape, Tensor, Var};

use crate::harness::{Case, numbers};

pub fn cases() -> Vec<Case> {
    let tokens = |name, count: usize, heads: usize, channels: usize| {
        let operands = [1, 2, 3].map(|seed| numbers(seed, [1, heads, count, channels]));
        let scale = (channels as f64).powf(-0.5);
        let flop = (4 * heads * count * count * channels) as f64;
        let bytes = (16 * heads * count * channels) as f64;
        case(name, flop, bytes, operands, move |[q, k, v]| q.attention(k, v, scale, None))
    };
    let depths = |name, channels: usize, depths: usize, side: usize| {
        let volume = |seed| numbers(seed, [1, 4, channels, depths, side, side]);
        let operands = [numbers(1, [1, 4, channels, side, side]), volume(2), volume(3)];
        let scale = (channels as f64).powf(-0.5);
        let flop = (4 * 4 * channels * depths * side * side) as f64;
        let bytes = (4 * 2 * 4 * channels * (depths + 1) * side * side) as f64;
        case(name, flop, bytes, operands, move |[q, k, v]| q.depth_attention(k, v, scale))
    };
    vec![
        tokens("attention 1024x8x40", 1024, 8, 40),
        tokens("attention 256x8x80", 256, 8, 80),
        tokens("attention 1024x4x64", 1024, 4, 64),
        tokens("attention 256x8x160", 256, 8, 160),
        depths("depth attention 32^2 x 48", 32, 48, 32),
        depths("depth attention 16^2 x 24", 64, 24, 16),
        depths("depth attention 8^2 x 12", 128, 12, 8),
    ]
}

fn case(
    name: &'static str,
    flop: f64,
    bytes: f64,
    operands: [Tensor; 3],
    attend: impl Fn([&Var; 3]) -> Var + Send + Sync + 'static,
) -> Case {
    let run = move |both: bool| {
        let tape = Tape::new();
        let operands = operands.each_ref().map(|x| tape.leaf(x.clone()));
        let y = attend(operands.each_ref());
        if both {
            y.sum_all().backward().expect("a gradient");
        }
    };
    Case { name, flop, bytes, run: Box::new(run) }
}
