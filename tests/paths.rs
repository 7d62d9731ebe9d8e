//! CPU kernels on every instruction set that the processor has: each against the portable one in `f64`, in values and
//! gradients, on the cases of the registry and on sizes that reach the loops over whole vectors and leave a rest.

use std::sync::{Mutex, PoisonError};

use gradreel::ops::{Activation, Case, Conv, GridSampling, Padding, Pool, Resampling, registry, uniform};
use gradreel::optim::{Adam, Params};
use gradreel::scalar::Path;
use gradreel::{DType, ErrorKind, Result, Tape, Tensor, Var};

/// Runs a function with all kernels held to a path. Tests of this file take turns, and run kernels nowhere else.
fn on<T>(path: Path, run: impl FnOnce() -> T) -> T {
    static TURN: Mutex<()> = Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    // SAFETY: whoever runs kernels in this process has its turn.
    unsafe { Path::hold(Some(path)) };
    assert_eq!(Path::best(), path);
    run()
}

/// A result and the gradients of a weighted sum of it, for those operands that have one.
fn values_and_gradients(inputs: &[Tensor], function: impl Fn(&Tape, &[Var]) -> Result<Var>) -> Vec<Tensor> {
    let tape = Tape::new();
    let leaf = |x: &Tensor| if x.dtype().is_real() { tape.leaf(x.clone()) } else { tape.constant(x.clone()) };
    let leaves: Vec<Var> = inputs.iter().map(leaf).collect();
    let y = function(&tape, &leaves).unwrap();
    let mut found = vec![y.value().unwrap().clone()];
    if !y.dtype().is_real() {
        return found;
    }
    let weights = uniform(99, y.shape(), 0.5..1.5).cast(y.dtype()).unwrap();
    let gradients = match (&y * &tape.constant(weights)).sum_all().backward() {
        Ok(gradients) => gradients,
        Err(error) if error.kind() == ErrorKind::NoGradient => return found,
        Err(error) => panic!("{error}"),
    };
    found.extend(leaves.iter().filter(|x| x.is_differentiable()).filter_map(|x| gradients.wrt(x).ok().cloned()));
    found
}

fn of_type(inputs: &[Tensor], dtype: DType) -> Vec<Tensor> {
    inputs.iter().map(|x| if x.dtype().is_real() { x.cast(dtype).unwrap() } else { x.clone() }).collect()
}

/// Compares all paths, in both types, with the portable one in `f64`; differences are relative to the typical number.
fn compare(name: &str, inputs: &[Tensor], single: f64, function: impl Fn(&Tape, &[Var]) -> Result<Var>) {
    let run = |path: Path, dtype: DType| on(path, || values_and_gradients(&of_type(inputs, dtype), &function));
    let wanted = run(Path::Portable, DType::F64);
    for path in Path::available() {
        for (dtype, tolerance) in [(DType::F64, 1e-11), (DType::F32, single)] {
            let found = run(path, dtype);
            assert_eq!(found.len(), wanted.len(), "{name} on {path:?} in {dtype}");
            for (n, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
                assert_eq!(found.shape(), wanted.shape(), "{name}");
                let (found, wanted) = (found.to_vec().unwrap(), wanted.to_vec().unwrap());
                let typical = wanted.iter().filter(|y| y.is_finite()).map(|y| y * y).sum::<f64>() / wanted.len() as f64;
                for (i, (a, b)) in found.iter().zip(&wanted).enumerate() {
                    let close = (a - b).abs() <= tolerance * (typical.sqrt() + b.abs());
                    assert!(
                        close || a == b || (a.is_nan() && b.is_nan()),
                        "{name} on {path:?} in {dtype}, array {n}, element {i}: {a:e}, not {b:e}"
                    );
                }
            }
        }
    }
}

#[test]
fn every_op_agrees_on_every_path() {
    for entry in registry() {
        for (number, Case { op, inputs, .. }) in (entry.cases)().into_iter().enumerate() {
            compare(&format!("{} case {number}", entry.name), &inputs, 3e-5, |tape, operands| {
                tape.apply(op.clone(), &operands.iter().collect::<Vec<_>>())
            });
        }
    }
}

type Function = fn(&[Var]) -> Var;

/// As [`compare`], for operands of these shapes.
fn check(name: &str, shapes: &[&[usize]], function: Function) {
    let inputs: Vec<Tensor> = shapes.iter().zip(1..).map(|(shape, seed)| uniform(seed, *shape, -1.0..1.0)).collect();
    compare(name, &inputs, 5e-5, |_, v| Ok(function(v)));
}

#[test]
fn pointwise_functions_agree_over_whole_vectors_and_rests() {
    for (name, function) in [
        ("functions", (|v| v[0].tanh() + v[0].erf() * v[1].exp() + v[0].logistic() * v[1].softplus()) as Function),
        ("angles", |v| (&v[0] * 7.0).sin() + (&v[1] * 9.0).cos() * v[0].abs().sqrt()),
        ("logarithms", |v| (v[0].square() + 0.1).ln() + v[1].abs().ln_1p() - v[0].exp_m1()),
        ("choices", |v| v[0].lt(&v[1]).choose(&v[0].silu(), &v[1].gelu()) + v[0].maximum(&v[1]).floor()),
        ("activations", |v| v[0].relu() + v[1].leaky_relu(0.1) + v[0].elu(1.0) + v[1].clamp(-0.5, 0.5)),
    ] {
        for len in [1, 15, 1037] {
            check(name, &[&[len], &[len]], function);
        }
    }
}

#[test]
fn products_agree() {
    check("matmul", &[&[67, 45], &[45, 39]], |v| v[0].matmul(&v[1]));
    check("matmul of many terms", &[&[19, 700], &[700, 41]], |v| v[0].matmul(&v[1]));
    check("transposed products", &[&[2, 45, 30], &[2, 45, 17]], |v| v[0].transposed_matmul(&v[1]));
    check("thin products", &[&[1, 301], &[7, 301]], |v| v[0].matmul_transposed(&v[1]));
    check("linear", &[&[37, 20], &[33, 20], &[33]], |v| v[0].linear(&v[1], Some(&v[2])));
    check("mlp", &[&[300, 13], &[20, 13], &[20], &[19, 20], &[19], &[3, 19], &[3]], |v| {
        v[0].mlp(&[(&v[1], &v[2]), (&v[3], &v[4]), (&v[5], &v[6])], Activation::Softplus)
    });
}

#[test]
fn convolutions_agree() {
    let plain: [(&str, &[&[usize]], Function); 9] = [
        ("3x3", &[&[2, 17, 9, 14], &[18, 17, 3, 3], &[18]], |v| v[0].conv(&v[1], Some(&v[2]), &Conv::new().padding(1))),
        ("3x3 of many channels", &[&[1, 40, 12, 12], &[36, 40, 3, 3]], |v| {
            v[0].conv(&v[1], None, &Conv::new().padding(1))
        }),
        ("few channels", &[&[1, 2, 5, 70], &[3, 2, 3, 3]], |v| v[0].conv(&v[1], None, &Conv::new().padding(1))),
        ("strided", &[&[1, 5, 19, 23], &[7, 5, 3, 2]], |v| v[0].conv(&v[1], None, &Conv::new().stride(2))),
        ("dilated", &[&[1, 5, 19, 23], &[7, 5, 3, 2]], |v| v[0].conv(&v[1], None, &Conv::new().dilation([2, 3]))),
        ("1x1", &[&[2, 35, 5, 9], &[21, 35, 1, 1]], |v| v[0].conv(&v[1], None, &Conv::new())),
        ("depth-wise", &[&[2, 9, 11, 37], &[9, 1, 3, 3]], |v| {
            v[0].conv(&v[1], None, &Conv::new().groups(9).padding(1))
        }),
        ("in three dimensions", &[&[1, 6, 5, 7, 18], &[9, 6, 3, 3, 3]], |v| {
            v[0].conv(&v[1], None, &Conv::new().padding(1))
        }),
        ("transposed", &[&[1, 8, 4, 5, 9], &[8, 5, 3, 3, 3], &[5]], |v| {
            v[0].conv_transpose(&v[1], Some(&v[2]), &Conv::new().stride(2).padding(1).output_padding(1))
        }),
    ];
    for (name, shapes, function) in plain {
        check(name, shapes, function);
    }
    check("resized", &[&[1, 3, 7, 9, 11]], |v| v[0].resize([11, 13, 18], Resampling::Linear));
    check("means of windows", &[&[2, 3, 19, 37]], |v| v[0].average_pool(&Pool::new(3).stride(2).padding(1)));
    check("largest of windows", &[&[2, 3, 19, 37]], |v| v[0].max_pool(&Pool::new(3).stride(2).padding(1)));
}

#[test]
fn attention_and_normalisation_agree() {
    check("attention", &[&[2, 83, 20], &[2, 71, 20], &[2, 71, 13]], |v| v[0].attention(&v[1], &v[2], 0.25, None));
    check("attention with a mask", &[&[1, 35, 7], &[1, 90, 7], &[1, 90, 7], &[35, 90]], |v| {
        v[0].attention(&v[1], &v[2], 0.4, Some(&v[3]))
    });
    check("depth-wise attention", &[&[1, 2, 5, 6, 11], &[1, 2, 5, 4, 6, 11], &[1, 2, 5, 4, 6, 11]], |v| {
        v[0].depth_attention(&v[1], &v[2], 0.5)
    });
    check("softmax of rows", &[&[5, 1003]], |v| v[0].softmax(1));
    check("softmax of short rows", &[&[50, 11]], |v| v[0].softmax(1));
    check("softmax of columns", &[&[37, 71]], |v| v[0].log_softmax(0));
    check("group norm", &[&[2, 12, 9, 11], &[12], &[12]], |v| v[0].group_norm_silu(4, 1e-5, Some((&v[1], &v[2]))));
    check("layer norm", &[&[21, 77], &[77], &[77]], |v| v[0].layer_norm(1, 1e-5, Some((&v[1], &v[2]))));
    check("layer norm of short rows", &[&[71, 13], &[13], &[13]], |v| v[0].layer_norm(1, 1e-5, Some((&v[1], &v[2]))));
}

#[test]
fn reductions_scans_copies_and_lookups_agree() {
    let plain: [(&str, &[&[usize]], Function); 12] = [
        ("sum of rows", &[&[7, 1003]], |v| v[0].square().sum(&[1])),
        ("sum of columns", &[&[300, 37]], |v| v[0].square().sum(&[0])),
        ("sum of the middle", &[&[5, 33, 19]], |v| v[0].square().sum(&[1])),
        ("largest of rows", &[&[7, 1003]], |v| v[0].max(&[1])),
        ("largest of columns", &[&[300, 37]], |v| v[0].min(&[0])),
        ("product", &[&[21, 9]], |v| (&v[0] + 1.5).prod(&[1])),
        ("running sum", &[&[37, 70]], |v| v[0].cumsum(0) + v[0].cumsum_from_end(1)),
        ("recurrence", &[&[37, 70], &[37, 70]], |v| v[0].recurrence(&v[1], 1)),
        ("permute", &[&[13, 37, 19]], |v| v[0].permute(&[2, 0, 1]).square()),
        ("transpose", &[&[67, 45]], |v| v[0].permute(&[1, 0]).square()),
        ("logsumexp", &[&[9, 70]], |v| v[0].logsumexp(&[1])),
        ("broadcast", &[&[13, 1, 37], &[11, 1]], |v| &v[0] * &v[1]),
    ];
    for (name, shapes, function) in plain {
        check(name, shapes, function);
    }
    for padding in [Padding::Zeros, Padding::Border] {
        let settings = GridSampling { padding, ..GridSampling::default() };
        let flat = [uniform(1, [2, 19, 7, 9], -1.0..1.0), uniform(2, [2, 53, 2], -1.2..1.2)];
        compare("lookup in images", &flat, 5e-5, |_, v| Ok(v[0].grid_sample(&v[1], settings)));
        let solid = [uniform(1, [1, 37, 5, 6, 7], -1.0..1.0), uniform(2, [1, 53, 3], -1.2..1.2)];
        compare("lookup in volumes", &solid, 5e-5, |_, v| Ok(v[0].grid_sample(&v[1], settings)));
    }
    let index = Tensor::from_vec((0..41).map(|i| i * 7 % 13).collect::<Vec<u32>>(), [41]);
    compare("index_add", &[uniform(1, [41, 19], -1.0..1.0), index], 5e-5, |_, v| v[0].index_add(&v[1], 13));
    let rays = Tensor::from_vec(vec![0u32, 40, 40, 77, 140], [5]);
    compare("rays", &[uniform(1, [140], 0.0..0.3), rays], 5e-5, |_, v| v[0].ray_weights(&v[1], None));
}

/// Updates are element by element: not a bit may depend on the vectors.
#[test]
fn an_optimiser_steps_to_the_same_bits_on_every_path() {
    let steps = |path| {
        on(path, || {
            let mut params = Params::new();
            params.set("x", uniform(1, [1037], -1.0..1.0).cast(DType::F32).unwrap());
            let mut adam = Adam::new(1e-2);
            for _ in 0..3 {
                let tape = Tape::new();
                let x = tape.leaf(params.get("x").unwrap().clone());
                let loss = x.square().sum_all();
                let mut gradients = std::collections::BTreeMap::new();
                gradients.insert("x".to_owned(), loss.backward().unwrap().wrt(&x).unwrap().clone());
                adam.step(&mut params, &gradients).unwrap();
            }
            params.get("x").unwrap().to_vec().unwrap()
        })
    };
    let wanted = steps(Path::Portable);
    for path in Path::available() {
        assert_eq!(steps(path), wanted, "{path:?}");
    }
}

#[test]
fn a_path_of_the_processor_is_found() {
    let all: Vec<Path> = Path::available().collect();
    assert_eq!(all[0], Path::Portable);
    #[cfg(target_arch = "x86_64")]
    assert_eq!(all.contains(&Path::Avx2), is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"));
    #[cfg(target_arch = "aarch64")]
    assert!(all.contains(&Path::Neon));
}

#[test]
fn paths_have_names_and_others_are_refused() {
    assert_eq!(Path::named("scalar").unwrap(), Path::Portable);
    for path in Path::available() {
        assert_eq!(Path::named(path.name()).unwrap(), path);
    }
    for name in ["sse9", "AVX2", "", " scalar"] {
        let error = Path::named(name).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
        let text = error.to_string();
        assert!(text.contains("GRADREEL_ISA") && text.contains("one of scalar"), "{text}");
    }
}

/// The name that a process of its own reports when the environment says so: this test runs itself again.
#[test]
fn the_environment_caps_the_path_of_a_run() {
    const CHILD: &str = "GRADREEL_TEST_CHILD";
    if std::env::var_os(CHILD).is_some() {
        println!("runs on {}", gradreel::isa());
        return;
    }
    let run = |name: &str| {
        let mut command = std::process::Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "the_environment_caps_the_path_of_a_run", "--nocapture", "--test-threads", "1"]);
        let output = command.env(CHILD, "1").env(Path::VARIABLE, name).output().unwrap();
        (
            output.status.success(),
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr),
        )
    };
    for path in Path::available() {
        let (done, text) = run(path.name());
        assert!(done && text.contains(&format!("runs on {path}")), "{text}");
    }
    let (done, text) = run("avx1024");
    assert!(!done && text.contains("GRADREEL_ISA") && text.contains("`avx1024`"), "{text}");
}
