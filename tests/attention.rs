//! Normalisation, softmax and attention against PyTorch in values and gradients, at their edges, and on any number of
//! threads.

#[path = "vectors/find.rs"]
mod find;

use std::path::Path;

use gradreel::io::safetensors::TensorFile;
use gradreel::ops::uniform;
use gradreel::{DType, ErrorKind, Tape, Tensor, Var};

/// A function of a case's operands in the order in which they are named.
type Function = Box<dyn Fn(&[Var]) -> Var + Sync + Send>;

struct Check {
    case: String,
    operands: &'static [&'static str],
    function: Function,
}

fn check(
    case: impl Into<String>,
    operands: &'static [&'static str],
    function: impl Fn(&[Var]) -> Var + Sync + Send + 'static,
) -> Check {
    Check { case: case.into(), operands, function: Box::new(function) }
}

fn file(name: &str) -> TensorFile {
    TensorFile::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors").join(name)).unwrap()
}

/// The largest difference to the expected numbers, relative to the largest of them.
fn distance(found: &Tensor, expected: &Tensor) -> f64 {
    assert_eq!(found.shape(), expected.shape());
    let (found, expected) = (found.to_vec().unwrap(), expected.to_vec().unwrap());
    let finite = |v: f64| if v.is_finite() { v.abs() } else { 0.0 };
    let scale = expected.iter().fold(1e-300f64, |m, v| m.max(finite(*v)));
    let differences = found.iter().zip(&expected).map(|(a, b)| if a == b { 0.0 } else { (a - b).abs() / scale });
    differences.fold(0.0, |m, d| if d > m || d.is_nan() { d } else { m })
}

/// Compares result and gradients in a dtype; `name` gives the file's names of operands and of results.
fn compare(file: &TensorFile, checks: Vec<Check>, dtype: DType, tolerances: [f64; 2], names: [&str; 3]) {
    let [result, cotangent, gradient] = names;
    for Check { case, operands, function } in checks {
        let get = |what: &str| file.get(&format!("{case}.{what}")).unwrap().cast(dtype).unwrap();
        let tape = Tape::new();
        let inputs: Vec<Var> = operands.iter().map(|name| tape.leaf(get(name))).collect();
        let y = function(&inputs);
        let off = distance(y.value().unwrap(), &get(result));
        assert!(off <= tolerances[0], "{case} in {dtype}: the result is off by {off:e}");
        let gradients = (&y * &tape.constant(get(cotangent))).sum_all().backward().unwrap();
        for (name, input) in operands.iter().zip(&inputs) {
            let off = distance(gradients.wrt(input).unwrap(), &get(&format!("{gradient}.{name}")));
            assert!(off <= tolerances[1], "{case} in {dtype}: the gradient of {name} is off by {off:e}");
        }
    }
}

fn pytorch_checks() -> Vec<Check> {
    const AFFINE: &[&str] = &["x", "scale", "shift"];
    let mut checks = vec![
        check("group_norm", AFFINE, |v| v[0].group_norm(3, 1e-5, Some((&v[1], &v[2])))),
        check("group_norm_plain", &["x"], |v| v[0].group_norm(2, 1e-6, None)),
        check("group_norm_silu", AFFINE, |v| v[0].group_norm_silu(2, 1e-5, Some((&v[1], &v[2])))),
        check("layer_norm", AFFINE, |v| v[0].layer_norm(1, 1e-5, Some((&v[1], &v[2])))),
        check("layer_norm_two_axes", AFFINE, |v| v[0].layer_norm(2, 1e-5, Some((&v[1], &v[2])))),
        check("attention", &["q", "k", "v"], |v| v[0].attention(&v[1], &v[2], 0.5, None)),
        check("attention_blocks", &["q", "k", "v"], |v| v[0].attention(&v[1], &v[2], 8f64.powf(-0.5), None)),
        check("attention_masked", &["q", "k", "v", "mask"], |v| v[0].attention(&v[1], &v[2], 0.5, Some(&v[3]))),
        check("attention_shared_mask", &["q", "k", "v", "mask"], |v| v[0].attention(&v[1], &v[2], 0.5, Some(&v[3]))),
        check("depth_attention", &["q", "k", "v"], |v| v[0].depth_attention(&v[1], &v[2], 5f64.powf(-0.5))),
    ];
    for axis in 0..3 {
        checks.push(check(format!("softmax_{axis}"), &["x"], move |v| v[0].softmax(axis)));
        checks.push(check(format!("log_softmax_{axis}"), &["x"], move |v| v[0].log_softmax(axis)));
    }
    checks
}

#[test]
fn results_and_gradients_are_those_of_pytorch() {
    let file = file("normalisation_and_attention.safetensors");
    compare(&file, pytorch_checks(), DType::F64, [1e-12, 1e-11], ["y", "g", "grad"]);
    compare(&file, pytorch_checks(), DType::F32, [2e-6, 2e-5], ["y", "g", "grad"]);
}

#[test]
fn a_large_mean_costs_no_digits() {
    let file = file("normalisation_and_attention.safetensors");
    let large = || {
        vec![check("group_norm_large_mean", &["x", "scale", "shift"], |v| {
            v[0].group_norm(2, 1e-5, Some((&v[1], &v[2])))
        })]
    };
    compare(&file, large(), DType::F64, [1e-11, 1e-11], ["y", "g", "grad"]);
    // in f32 the operand itself is rounded to 1e-4 of its spread: compare with f64 on the rounded numbers
    let rounded = file.get("group_norm_large_mean.x").unwrap().cast(DType::F32).unwrap();
    let normalise = |x: Tensor| Tape::new().constant(x).group_norm(2, 1e-5, None).value().unwrap().clone();
    let off = distance(&normalise(rounded.clone()), &normalise(rounded.cast(DType::F64).unwrap()));
    assert!(off < 1e-6, "{off:e}");
}

#[test]
fn a_constant_run_becomes_the_shift() {
    let tape = Tape::new();
    let x = tape.leaf(Tensor::full(7.3e5, [1, 2, 5000], DType::F32));
    let y = x.group_norm(1, 1e-5, None);
    assert!(y.value().unwrap().slice::<f32>().iter().all(|v| v.abs() < 1e-6));
    assert!(y.sum_all().backward().unwrap().wrt(&x).unwrap().all_finite().unwrap());
}

#[test]
fn layers_agree_with_independent_vectors() {
    const NORM: &[&str] = &["in.x", "w.weight", "w.bias"];
    let path = find::path(Path::new("models/tests/vectors/views"), find::VIEWS, "primitives.safetensors");
    let file = TensorFile::read(path).unwrap();
    let mut checks = Vec::new();
    for name in file.tensors.keys().filter_map(|name| name.strip_suffix(".out")) {
        // as in `group_norm_g8_eps1e-6_smallinput`
        let part = |start: &str| name.split('_').find_map(|part| part.strip_prefix(start)?.parse::<f64>().ok());
        let (groups, least) = (part("g").map(|g| g as usize), part("eps"));
        if name.starts_with("group_norm") {
            let (groups, least) = (groups.unwrap(), least.unwrap());
            checks.push(check(name, NORM, move |v| v[0].group_norm(groups, least, Some((&v[1], &v[2])))));
        } else if name.starts_with("layer_norm") {
            let least = least.unwrap();
            checks.push(check(name, NORM, move |v| v[0].layer_norm(1, least, Some((&v[1], &v[2])))));
        } else if name.starts_with("attention_scaled") {
            let scale = (file.get(&format!("{name}.in.q")).unwrap().dims()[3] as f64).powf(-0.5);
            checks.push(check(name, &["in.q", "in.k", "in.v"], move |v| v[0].attention(&v[1], &v[2], scale, None)));
        }
    }
    assert!(checks.len() >= 4, "{}", checks.len());
    compare(&file, checks, DType::F32, [1e-5, 1e-4], ["out", "cot", "grad"]);
}

#[test]
fn rows_without_anything_that_counts() {
    let tape = Tape::new();
    let inf = f64::INFINITY;
    for axis in 0..2 {
        let values = vec![-inf, -inf, -inf, 0.0, -inf, inf, 1.0, f64::NAN, 2.0];
        let x = tape.leaf(Tensor::from_vec(values, [3, 3]));
        let rows = |y: &Var| y.permute(if axis == 1 { &[0, 1] } else { &[1, 0] }).value().unwrap().to_vec().unwrap();
        let x = if axis == 1 { x } else { x.permute(&[1, 0]) };
        let (y, log) = (rows(&x.softmax(axis)), rows(&x.log_softmax(axis)));
        assert_eq!(y[..3], [0.0; 3]);
        assert_eq!(log[..3], [-inf; 3]);
        assert!(y[3..].iter().chain(&log[3..]).all(|v| v.is_nan()), "{y:?} {log:?}");
    }
    // a query whose keys are all masked, and no keys at all
    let random = |seed, shape: [usize; 2]| tape.leaf(uniform(seed, shape, -1.0..1.0));
    let (q, k, v) = (random(1, [2, 3]), random(2, [4, 3]), random(3, [4, 2]));
    let mask = tape.constant(Tensor::from_vec([[-inf; 4], [0.0, -inf, 0.0, -inf]].concat(), [2, 4]));
    let y = q.attention(&k, &v, 1.0, Some(&mask));
    assert_eq!(y.value().unwrap().slice::<f64>()[..2], [0.0; 2]);
    let gradients = y.square().sum_all().backward().unwrap();
    let for_k = gradients.wrt(&k).unwrap().slice::<f64>();
    assert!(for_k[3..6].iter().chain(&for_k[9..]).all(|g| *g == 0.0), "masked keys: {for_k:?}");
    assert!(gradients.wrt(&q).unwrap().slice::<f64>()[..3].iter().all(|g| *g == 0.0));
    let none = q.attention(&random(4, [0, 3]), &random(5, [0, 2]), 1.0, None);
    assert_eq!(none.value().unwrap().slice::<f64>(), &[0.0; 4]);
    assert_eq!(none.sum_all().backward().unwrap().wrt(&q).unwrap().slice::<f64>(), &[0.0; 6]);
}

#[test]
fn attention_is_a_softmax_between_two_products() {
    // more blocks of queries and keys than one, and enough queries for several work items
    let tape = Tape::new();
    let random = |seed, shape: [usize; 3]| tape.leaf(uniform(seed, shape, -1.5..1.5));
    let (q, k, v) = (random(1, [2, 300, 13]), random(2, [2, 211, 13]), random(3, [2, 211, 21]));
    let fused = q.attention(&k, &v, 0.3, None);
    let composed = (&q.matmul(&k.permute(&[0, 2, 1])) * 0.3).softmax(2).matmul(&v);
    assert!(distance(fused.value().unwrap(), composed.value().unwrap()) < 1e-13);
    let of = |y: &Var| y.square().sum_all().backward().unwrap();
    let (a, b) = (of(&fused), of(&composed));
    for x in [&q, &k, &v] {
        assert!(distance(a.wrt(x).unwrap(), b.wrt(x).unwrap()) < 1e-12);
    }
}

#[test]
fn depth_attention_is_a_softmax_of_sums_of_products() {
    // more pixels than one strip, and a last vector that is not full
    let tape = Tape::new();
    let q = tape.leaf(uniform(1, [1, 2, 5, 1, 23, 31], -1.5..1.5));
    let [k, v] = [2, 3].map(|seed| tape.leaf(uniform(seed, [1, 2, 5, 6, 23, 31], -1.5..1.5)));
    let fused = q.reshape([1, 2, 5, 23, 31]).depth_attention(&k, &v, 0.4);
    let weights = (&(&q * &k).sum(&[2]) * 0.4).softmax(2);
    let composed = (&weights.reshape([1, 2, 1, 6, 23, 31]) * &v).sum(&[3]);
    assert!(distance(fused.value().unwrap(), composed.value().unwrap()) < 1e-13);
    let of = |y: &Var| y.square().sum_all().backward().unwrap();
    let (a, b) = (of(&fused), of(&composed));
    for x in [&q, &k, &v] {
        assert!(distance(a.wrt(x).unwrap(), b.wrt(x).unwrap()) < 1e-12);
    }
}

#[test]
fn softmax_can_be_differentiated_twice() {
    let start = uniform(1, [3, 4], -1.0..1.0).slice::<f64>().to_vec();
    for log in [false, true] {
        // the squared length of the gradient of Σ y², and its own gradient
        let squared = |x: &[f64]| {
            let tape = Tape::new();
            let x = tape.leaf(Tensor::from_vec(x.to_vec(), [3, 4]));
            let y = if log { x.log_softmax(1) } else { x.softmax(1) };
            let slope = y.square().sum_all().gradients_of(&[&x]).unwrap().remove(0);
            let length = slope.square().sum_all();
            let gradient = length.backward().unwrap().wrt(&x).unwrap().slice::<f64>().to_vec();
            (length.item().unwrap(), gradient)
        };
        let gradient = squared(&start).1;
        for i in 0..start.len() {
            let moved = |step: f64| {
                let mut x = start.clone();
                x[i] += step;
                squared(&x).0
            };
            let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!(
                (difference - gradient[i]).abs() < 1e-6 * difference.abs().max(1.0),
                "{difference} {}",
                gradient[i]
            );
        }
    }
}

#[test]
fn fused_derivatives_refuse_to_be_differentiated() {
    let tape = Tape::new();
    let x = tape.leaf(uniform(1, [2, 4, 3], -1.0..1.0));
    for y in [x.group_norm(2, 1e-5, None), x.layer_norm(1, 1e-5, None), x.attention(&x, &x, 1.0, None)] {
        let error = y.square().sum_all().gradients_of(&[&x]).err().unwrap();
        assert_eq!(error.kind(), ErrorKind::Unsupported, "{error}");
    }
}

#[test]
fn results_do_not_depend_on_the_thread_count() {
    let random = |seed, shape: &[usize]| uniform(seed, shape, -1.0..1.0).cast(DType::F32).unwrap();
    let (a, b, c) = (random(1, &[3, 200, 20]), random(2, &[3, 230, 20]), random(3, &[3, 230, 20]));
    let (image, volume) = (random(4, &[1, 2, 3, 20, 40]), random(5, &[1, 2, 3, 5, 20, 40]));
    let bits = |threads: usize| -> Vec<u32> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let tape = Tape::new();
            let [a, b, c] = [&a, &b, &c].map(|x| tape.leaf(x.clone()));
            let [image, volume] = [&image, &volume].map(|x| tape.leaf(x.clone()));
            let [scale, shift] = [6, 7].map(|seed| tape.leaf(random(seed, &[20])));
            let attended = a.attention(&b, &c, 0.2, None).layer_norm(1, 1e-5, Some((&scale, &shift))).softmax(1);
            let seen = image.depth_attention(&volume, &volume, 0.5).group_norm_silu(2, 1e-5, None);
            let gradients = (&attended.square().sum_all() + &seen.square().sum_all()).backward().unwrap();
            let found = [&a, &b, &c, &image, &volume, &scale, &shift].map(|x| gradients.wrt(x).unwrap().clone());
            let results = [attended, seen].map(|y| y.value().unwrap().clone());
            results.iter().chain(&found).flat_map(|x| x.slice::<f32>().to_vec()).map(f32::to_bits).collect()
        })
    };
    assert_eq!(bits(1), bits(3));
}

#[test]
fn wrong_shapes_are_named() {
    let message = |run: fn(&Var)| {
        let x = Tape::new().constant(uniform(1, [2, 4, 3], -1.0..1.0));
        let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| run(&x))).unwrap_err();
        panic.downcast_ref::<String>().unwrap().clone()
    };
    assert!(message(|x| drop(x.group_norm(3, 1e-5, None))).contains("multiple of 3 groups"));
    assert!(message(|x| drop(x.layer_norm(4, 1e-5, None))).contains("at least 4 axes"));
    assert!(message(|x| drop(x.softmax(3))).contains("axis 3"));
    assert!(message(|x| drop(x.attention(&x.permute(&[0, 2, 1]), x, 1.0, None))).contains("[.., keys, channels]"));
    assert!(message(|x| drop(x.depth_attention(x, x, 1.0))).contains("depths"));
}
