//! Convolutions, pooling and resizing against PyTorch in values, gradients and gradients of gradients; on any number of
//! threads; and at their edges.

use std::panic::{AssertUnwindSafe, catch_unwind};

use gradreel::io::safetensors::TensorFile;
use gradreel::ops::{Conv, Pool, Resampling, uniform};
use gradreel::{DType, Tape, Tensor, Var};

fn file() -> TensorFile {
    TensorFile::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors/convolution.safetensors")).unwrap()
}

#[track_caller]
fn assert_close(what: &str, found: &Tensor, expected: &Tensor, tolerance: f64) {
    assert_eq!(found.shape(), expected.shape(), "{what}");
    let (found, expected) = (found.to_vec().unwrap(), expected.to_vec().unwrap());
    let scale = expected.iter().fold(1e-300f64, |m, v| m.max(v.abs()));
    for (a, b) in found.iter().zip(&expected) {
        assert!((a - b).abs() <= tolerance * scale, "{what}: {a}, not {b}");
    }
}

/// A case with the settings that its script has.
fn convolutions() -> Vec<(&'static str, Conv, bool)> {
    let conv = Conv::new;
    vec![
        ("conv1d", conv().stride(2).padding(1), false),
        ("conv2d", conv().padding(1), false),
        ("conv2d_dilated", conv().stride([2, 1]).padding([3, 1]).dilation([2, 3]), false),
        ("conv2d_groups", conv().stride(2).padding(1).groups(2), false),
        ("conv2d_depthwise", conv().padding(1).groups(5), false),
        ("conv2d_point", conv(), false),
        ("conv2d_wide", conv().padding(1), false),
        ("conv3d", conv().stride([1, 2, 1]).padding([1, 0, 1]), false),
        ("transposed1d", conv().stride(3).padding(1).output_padding(2), true),
        ("transposed2d", conv().stride(2).padding([1, 2]).output_padding(1), true),
        ("transposed2d_dilated", conv().stride([2, 1]).output_padding([2, 1]).dilation([3, 2]), true),
        ("transposed2d_groups", conv().stride(2).padding(1).groups(2), true),
        ("transposed3d", conv().stride(2).padding(1).output_padding(1), true),
    ]
}

#[test]
fn convolutions_are_those_of_pytorch() {
    let file = file();
    for (dtype, tolerance) in [(DType::F64, 1e-12), (DType::F32, 5e-6)] {
        for (name, settings, transposed) in convolutions() {
            let get = |what: &str| file.get(&format!("{name}.{what}")).map(|x| x.cast(dtype).unwrap());
            let tape = Tape::new();
            let (x, w) = (tape.leaf(get("x").unwrap()), tape.leaf(get("w").unwrap()));
            let b = get("b").ok().map(|b| tape.leaf(b));
            let y = match transposed {
                true => x.conv_transpose(&w, b.as_ref(), &settings),
                false => x.conv(&w, b.as_ref(), &settings),
            };
            assert_close(name, y.value().unwrap(), &get("y").unwrap(), tolerance);
            let loss = (&y * &tape.constant(get("g").unwrap())).sum_all();
            let first = loss.gradients_of(&[&x, &w]).unwrap();
            for (key, slope) in ["grad.x", "grad.w"].into_iter().zip(&first) {
                assert_close(&format!("{name}.{key}"), slope.value().unwrap(), &get(key).unwrap(), tolerance);
            }
            if let Some(b) = b {
                let slope = loss.gradients_of(&[&b]).unwrap().remove(0);
                assert_close(&format!("{name}.grad.b"), slope.value().unwrap(), &get("grad.b").unwrap(), tolerance);
            }
            let squares = &first[0].square().sum_all() + &first[1].square().sum_all();
            for (key, slope) in ["second.x", "second.w"].into_iter().zip(squares.gradients_of(&[&x, &w]).unwrap()) {
                assert_close(&format!("{name}.{key}"), slope.value().unwrap(), &get(key).unwrap(), tolerance);
            }
        }
    }
}

type Function = fn(&Var) -> Var;

#[test]
fn pooling_and_resizing_are_those_of_pytorch() {
    let file = file();
    let cases: [(&str, Function); 16] = [
        ("max_pool1d", |x| x.max_pool(&Pool::new(3).stride(2).padding(1))),
        ("max_pool2d", |x| x.max_pool(&Pool::new([2, 3]).stride([2, 1]).padding(1))),
        ("max_pool3d", |x| x.max_pool(&Pool::new(2))),
        ("average_pool1d", |x| x.average_pool(&Pool::new(3).stride(2).padding(1))),
        ("average_pool2d", |x| x.average_pool(&Pool::new([2, 3]).stride([2, 1]).padding(1))),
        ("average_pool2d_pixels", |x| x.average_pool(&Pool::new(3).stride(2).padding(1).without_padding())),
        ("average_pool3d", |x| x.average_pool(&Pool::new(2))),
        ("nearest", |x| x.resize([7, 4], Resampling::Nearest)),
        ("nearest_doubled", |x| x.scale_by(2.0, Resampling::Nearest)),
        ("nearest_scaled", |x| x.scale_by(1.7, Resampling::Nearest)),
        ("linear", |x| x.resize(9, Resampling::Linear)),
        ("bilinear", |x| x.resize([3, 9], Resampling::Linear)),
        ("bilinear_corners", |x| x.resize([3, 9], Resampling::LinearCorners)),
        ("bilinear_scaled", |x| x.scale_by(1.6, Resampling::Linear)),
        ("trilinear", |x| x.scale_by(2.0, Resampling::Linear)),
        ("trilinear_corners", |x| x.resize([1, 5, 4], Resampling::LinearCorners)),
    ];
    for (dtype, tolerance) in [(DType::F64, 1e-14), (DType::F32, 1e-6)] {
        for (name, function) in cases {
            let get = |what: &str| file.get(&format!("{name}.{what}")).unwrap().cast(dtype).unwrap();
            let tape = Tape::new();
            let x = tape.leaf(get("x"));
            let y = function(&x);
            assert_close(name, y.value().unwrap(), &get("y"), tolerance);
            let found = (&y * &tape.constant(get("g"))).sum_all().backward().unwrap();
            assert_close(name, found.wrt(&x).unwrap(), &get("grad.x"), tolerance);
        }
    }
}

#[test]
fn the_first_maximum_counts_and_nan_passes() {
    let tape = Tape::new();
    let x = tape.leaf(Tensor::from_vec(vec![1.0f64, 3.0, 3.0, f64::NAN, 2.0, f64::NAN], [1, 1, 6]));
    let y = x.max_pool(&Pool::new(3));
    assert_eq!(y.value().unwrap().slice::<f64>()[0], 3.0);
    assert!(y.value().unwrap().slice::<f64>()[1].is_nan());
    let found = y.sum_all().backward().unwrap();
    assert_eq!(found.wrt(&x).unwrap().slice::<f64>(), [0.0, 1.0, 0.0, 1.0, 0.0, 0.0]);
}

/// The bits of a result and its gradients on a pool of so many threads.
fn bits(threads: usize, x: &[usize], w: &[usize], settings: &Conv, transposed: bool) -> Vec<u32> {
    let number = |seed, shape: &[usize]| uniform(seed, shape, -1.0..1.0).cast(DType::F32).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let tape = Tape::new();
        let (x, w) = (tape.leaf(number(1, x)), tape.leaf(number(2, w)));
        let y = if transposed { x.conv_transpose(&w, None, settings) } else { x.conv(&w, None, settings) };
        let found = y.square().sum_all().backward().unwrap();
        let all = [y.value().unwrap(), found.wrt(&x).unwrap(), found.wrt(&w).unwrap()];
        all.iter().flat_map(|x| x.slice::<f32>().iter().map(|v| v.to_bits())).collect()
    })
}

#[test]
fn results_do_not_depend_on_the_thread_count() {
    let cases: [(&[usize], &[usize], Conv, bool); 6] = [
        (&[2, 40, 19, 21], &[48, 40, 3, 3], Conv::new().padding(1), false),
        (&[1, 18, 7, 14, 16], &[33, 18, 3, 3, 3], Conv::new().padding(1), false),
        (&[3, 70, 6, 7], &[90, 70, 3, 3], Conv::new().stride(2).padding(1), false),
        (&[1, 64, 40, 41], &[96, 64, 1, 1], Conv::new(), false),
        (&[1, 32, 9, 50], &[32, 1, 3, 3], Conv::new().padding(1).groups(32), false),
        (&[1, 48, 5, 6, 7], &[48, 24, 3, 3, 3], Conv::new().stride(2).padding(1).output_padding(1), true),
    ];
    for (x, w, settings, transposed) in cases {
        let one = bits(1, x, w, &settings, transposed);
        assert!(one == bits(3, x, w, &settings, transposed), "image {x:?}, weight {w:?}");
    }
}

#[test]
fn what_does_not_fit_is_refused_with_reasons() {
    let refused = |run: &dyn Fn(&Tape)| {
        let panic = catch_unwind(AssertUnwindSafe(|| run(&Tape::new()))).unwrap_err();
        panic.downcast_ref::<String>().cloned().unwrap()
    };
    let ones = |tape: &Tape, shape: &[usize]| tape.leaf(Tensor::full(1.0, shape, DType::F32));
    let conv = |x: &'static [usize], w: &'static [usize], settings: Conv| {
        refused(&move |tape| drop(ones(tape, x).conv(&ones(tape, w), None, &settings)))
    };
    let up = |x: &'static [usize], w: &'static [usize], settings: Conv| {
        refused(&move |tape| drop(ones(tape, x).conv_transpose(&ones(tape, w), None, &settings)))
    };
    let (x, w): (&[usize], &[usize]) = (&[1, 3, 5, 5], &[4, 3, 3, 3]);
    let cases = [
        (conv(x, &[4, 2, 3, 3], Conv::new()), "weight of [4, 3, kernel"),
        (conv(x, &[4, 3, 7, 7], Conv::new()), "kernel that fits"),
        (conv(x, &[4, 3, 0, 3], Conv::new()), "kernel that fits"),
        (conv(x, w, Conv::new().dilation(3)), "kernel that fits"),
        (conv(x, w, Conv::new().dilation(usize::MAX)), "kernel that fits"),
        (conv(x, w, Conv::new().stride([1, 1, 1])), "settings for as many"),
        (conv(x, w, Conv::new().padding([1])), "settings for as many"),
        (conv(x, w, Conv::new().stride(0)), "at least 1"),
        (conv(x, w, Conv::new().dilation([1, 0])), "at least 1"),
        (conv(&[3, 5, 5], w, Conv::new()), "as many for the image as for the weight"),
        (conv(x, &[4, 3], Conv::new()), "one to three spatial axes"),
        (conv(&[1, 3, 2, 2, 2, 2], &[4, 3, 1, 1, 1, 1], Conv::new()), "one to three spatial axes"),
        (conv(&[1, 4, 5, 5], &[4, 1, 3, 3], Conv::new().groups(3)), "multiples of 3 groups"),
        (conv(&[1, 4, 5, 5], &[5, 2, 3, 3], Conv::new().groups(2)), "multiples of 2 groups"),
        (conv(x, w, Conv::new().groups(0)), "divides both numbers of channels"),
        (refused(&|tape| drop(ones(tape, x).conv(&ones(tape, w), Some(&ones(tape, &[3])), &Conv::new()))), "f32[4]"),
        (up(&[1, 2, 4], &[2, 2, 3], Conv::new().stride(2).output_padding(2)), "output padding below"),
        (up(&[1, 2, 4], &[2, 2, 3], Conv::new().stride(2).output_padding([1, 1])), "output padding for as many"),
        (up(&[1, 2, 4], &[2, 2, 3], Conv::new().stride(0)), "at least 1"),
        (up(&[1, 2, 4], &[2, 2, 3], Conv::new().dilation(0)), "at least 1"),
        (up(&[1, 2, 4], &[2, 2, 3], Conv::new().padding(3)), "at least one place"),
        (up(&[1, 2, 0], &[2, 2, 3], Conv::new()), "at least one place"),
        (up(&[1, 3, 4], &[2, 2, 3], Conv::new()), "weight of [3, 2, kernel"),
        (up(&[1, 2, 4], &[2, 2, 3], Conv::new().groups(0)), "divides both numbers of channels"),
        (refused(&|tape| drop(ones(tape, &[1, 2, 4]).max_pool(&Pool::new(3).padding(2)))), "half of one"),
        (refused(&|tape| drop(ones(tape, &[1, 2, 4]).max_pool(&Pool::new(3).stride(0)))), "strides of at least 1"),
        (refused(&|tape| drop(ones(tape, &[1, 2, 4]).average_pool(&Pool::new(5)))), "windows that fit"),
        (refused(&|tape| drop(ones(tape, &[1, 2, 4]).resize([0], Resampling::Linear))), "at least 1"),
    ];
    for (message, expected) in cases {
        for part in [expected, "found", "wanted", "fix"] {
            assert!(message.contains(part), "{part} is not in: {message}");
        }
    }
}
