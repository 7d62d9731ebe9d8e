//! Pointwise maps, reductions and copies: bound by memory, but for exponentials.

use gradreel::{Tape, Var};

use crate::harness::{Case, numbers};

/// A function of tensors of these shapes; `flop` and `bytes` of its forward pass.
fn case(
    name: &'static str,
    flop: usize,
    bytes: usize,
    shapes: &[&[usize]],
    function: impl Fn(&[Var]) -> Var + Send + Sync + 'static,
) -> Case {
    let operands: Vec<_> = (1..).zip(shapes).map(|(seed, &shape)| numbers(seed, shape)).collect();
    let run = move |both: bool| {
        let tape = Tape::new();
        let leaves: Vec<Var> = operands.iter().map(|x| tape.leaf(x.clone())).collect();
        let y = function(&leaves);
        if both {
            y.sum_all().into_gradients().expect("a gradient");
        }
    };
    Case { name, flop: flop as f64, bytes: bytes as f64, run: Box::new(run) }
}

pub fn cases() -> Vec<Case> {
    let (mega, wide) = (1 << 20, 16 << 20);
    let map = 4 * mega;
    let image: &[usize] = &[4, 320, 32, 32];
    let image_bytes = 8 * 4 * 320 * 32 * 32;
    vec![
        case("add 16M", wide, 12 * wide, &[&[wide], &[wide]], |x| &x[0] + &x[1]),
        case("mul 1M", mega, 3 * map, &[&[mega], &[mega]], |x| &x[0] * &x[1]),
        case("exp 1M", 20 * mega, 2 * map, &[&[mega]], |x| x[0].exp()),
        case("softplus 1M", 50 * mega, 2 * map, &[&[mega]], |x| x[0].softplus()),
        case("gelu 1M", 40 * mega, 2 * map, &[&[mega]], |x| x[0].gelu()),
        case("silu 1M", 30 * mega, 2 * map, &[&[mega]], |x| x[0].silu()),
        case("bias add 65536x128", 8 * mega, 64 * mega, &[&[65_536, 128], &[128]], |x| &x[0] + &x[1]),
        case("channel scale 4x320x32^2", 1 << 20, image_bytes, &[image, &[320, 1, 1]], |x| &x[0] * &x[1]),
        case("sum all 16M", wide, 4 * wide, &[&[wide]], |x| x[0].sum_all()),
        case("sum rows 4096x4096", wide, 4 * wide, &[&[4096, 4096]], |x| x[0].sum(&[1])),
        case("sum columns 4096x4096", wide, 4 * wide, &[&[4096, 4096]], |x| x[0].sum(&[0])),
        case("sum channels 4x320x32^2", mega, image_bytes / 2, &[image], |x| x[0].sum(&[0, 2, 3])),
        case("max rows 4096x4096", wide, 4 * wide, &[&[4096, 4096]], |x| x[0].max(&[1])),
        case("cumsum 4096x1024", 4 * mega, 32 * mega, &[&[4096, 1024]], |x| x[0].cumsum(1)),
        case("permute NCHW to NHWC 4x320x32^2", 0, image_bytes, &[image], |x| x[0].permute(&[0, 2, 3, 1])),
        case("permute heads 8x1024x8x40", 0, 8 * 8 * 1024 * 320, &[&[8, 1024, 8, 40]], |x| x[0].permute(&[0, 2, 1, 3])),
        case("concat channels 4x320x32^2", 0, 2 * image_bytes, &[image, image], |x| x[0].concat(&[&x[1]], 1)),
        case("pad 4x320x32^2", 0, image_bytes, &[image], |x| x[0].pad(3, 1, 1).pad(2, 1, 1)),
    ]
}
