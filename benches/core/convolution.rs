//! Convolutions of a denoising network and of a volume network.

use gradreel::Tape;
use gradreel::ops::Conv;

use crate::harness::{Case, numbers};

/// `transposed` says that `x` is enlarged: its channels come first in the weight.
fn case(name: &'static str, x: &[usize], weight: &[usize], settings: Conv, transposed: bool) -> Case {
    let (x, w) = (numbers(1, x), numbers(2, weight));
    let outputs = weight[if transposed { 1 } else { 0 }];
    let bias = numbers(3, [outputs]);
    let places: usize = x.dims()[2..].iter().product();
    let size = if transposed { places << (x.dims().len() - 2) } else { places };
    // every tap meets as many pixels as the smaller image has
    let flop = 2.0 * w.len() as f64 * (x.dims()[0] * places) as f64;
    let bytes = 4 * (x.len() + w.len() + x.dims()[0] * outputs * size);
    let run = move |both: bool| {
        let tape = Tape::new();
        let (x, w, bias) = (tape.leaf(x.clone()), tape.leaf(w.clone()), tape.leaf(bias.clone()));
        let y =
            if transposed { x.conv_transpose(&w, Some(&bias), &settings) } else { x.conv(&w, Some(&bias), &settings) };
        if both {
            y.sum_all().backward().expect("a gradient");
        }
    };
    Case { name, flop, bytes: bytes as f64, run: Box::new(run) }
}

pub fn cases() -> Vec<Case> {
    let same = || Conv::new().padding(1);
    let doubled = Conv::new().stride(2).padding(1).output_padding(1);
    vec![
        case("conv2d 3x3 320->320 @32^2", &[1, 320, 32, 32], &[320, 320, 3, 3], same(), false),
        case("conv2d 3x3 1280->1280 @8^2", &[1, 1280, 8, 8], &[1280, 1280, 3, 3], same(), false),
        case("conv2d 1x1 320->640 @32^2", &[1, 320, 32, 32], &[640, 320, 1, 1], Conv::new(), false),
        case("conv2d 3x3 depth-wise 256 @64^2", &[1, 256, 64, 64], &[256, 1, 3, 3], same().groups(256), false),
        case("conv3d 3^3 64->64 @32^3", &[1, 64, 32, 32, 32], &[64, 64, 3, 3, 3], same(), false),
        case("conv_transpose3d 128->64 16^3->32^3", &[1, 128, 16, 16, 16], &[128, 64, 3, 3, 3], doubled, true),
    ]
}
