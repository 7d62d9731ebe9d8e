//! The GPU against the CPU: every op with a kernel, forward and backward; sizes, non-finite numbers, faults, threads.
//!
//! Runs on any adapter, a software one included. Without one the tests say so and pass, unless `CI` is `true`.

use std::sync::OnceLock;

use gradreel::backend::gpu::{Gpu, Kernel, Work};
use gradreel::ops::{Case, Map, registry, uniform};
use gradreel::scalar::Program;
use gradreel::{DType, Device, ErrorKind, Key, Result, Shape, Spec, Tape, Tensor, Var};

/// The one GPU of all tests, which share it between their threads.
fn gpu() -> Option<Device> {
    static OPENED: OnceLock<Result<Device>> = OnceLock::new();
    match OPENED.get_or_init(Device::gpu) {
        Ok(device) => Some(device.clone()),
        Err(error) if std::env::var("CI").is_ok_and(|ci| ci == "true") => {
            panic!("the GPU tests must run here: {error}")
        }
        Err(error) => {
            eprintln!("skipped, because there is no GPU: {error}");
            None
        }
    }
}

/// Absolute and relative tolerance of an op's results and gradients in `f32`.
fn tolerance(op: &str) -> (f64, f64) {
    match op {
        // copies
        "broadcast_to" | "concat" | "flip" | "index_select" | "pad" | "permute" | "put" | "reshape" | "slice"
        | "take" => (1e-6, 1e-6),
        // drivers compute exp with a few units in the last place
        "exp" | "exp_m1" | "ln" | "ln_1p" | "logistic" | "softplus" | "tanh" => (2e-6, 5e-6),
        "erf" | "elu" | "gelu" | "gelu_sigmoid" | "gelu_tanh" | "silu" => (2e-6, 5e-6),
        "attention" | "depth_attention" | "softmax" | "log_softmax" => (5e-6, 1e-5),
        // sums over a run, divided by its deviation
        "group_norm" | "layer_norm" => (1e-5, 1e-5),
        // exp of a product that carries the error of a logarithm
        "pow" | "powf" => (5e-6, 2e-5),
        // WGSL allows 2.5 units in the last place in divisions and square roots
        _ => (2e-6, 2e-6),
    }
}

#[track_caller]
fn assert_close(name: &str, found: &Tensor, expected: &Tensor) {
    assert_eq!(found.spec(), expected.spec(), "{name}");
    let (absolute, relative) = tolerance(name);
    let expected = expected.to_vec().unwrap();
    for (at, (a, b)) in found.to_vec().unwrap().into_iter().zip(expected).enumerate() {
        let same = a == b || (a.is_nan() && b.is_nan()) || (a - b).abs() <= absolute + relative * b.abs();
        assert!(same, "{name}: element {at} is {a} on the GPU and {b} on the CPU");
    }
}

/// A case's operands in `f32` (indices as they are) on a device.
fn operands(case: &Case, device: &Device) -> Vec<Tensor> {
    let narrow = |x: &Tensor| if x.dtype() == DType::U32 { x.clone() } else { x.cast(DType::F32).unwrap() };
    case.inputs.iter().map(|x| narrow(x).to_device(device).unwrap()).collect()
}

fn apply(case: &Case, tape: &Tape, inputs: &[Var]) -> Result<Var> {
    tape.apply(case.op.clone(), &inputs.iter().collect::<Vec<_>>())
}

fn forward(case: &Case, inputs: Vec<Tensor>) -> Result<Tensor> {
    let tape = Tape::new();
    let inputs: Vec<Var> = inputs.into_iter().map(|x| tape.constant(x)).collect();
    Ok(apply(case, &tape, &inputs)?.value()?.clone())
}

/// The gradients of `sum(w · y)` with respect to every real operand.
fn gradients(case: &Case, device: &Device) -> Vec<Tensor> {
    let tape = Tape::new();
    let inputs: Vec<Var> = operands(case, device)
        .into_iter()
        .map(|x| if x.dtype() == DType::F32 { tape.leaf(x) } else { tape.constant(x) })
        .collect();
    let y = apply(case, &tape, &inputs).unwrap();
    if y.dtype() == DType::U32 {
        return Vec::new();
    }
    let w = uniform(9, y.shape(), 0.5..1.5).cast(DType::F32).unwrap().to_device(device).unwrap();
    let found = (&y * &tape.constant(w)).sum_all().backward().unwrap();
    inputs.iter().filter(|x| x.is_differentiable()).map(|x| found.wrt(x).unwrap().clone()).collect()
}

fn random(seed: u64, shape: impl Into<Shape>) -> Tensor {
    uniform(seed, shape, -1.0..1.0).cast(DType::F32).unwrap()
}

/// Runs a function on the CPU and on the GPU and compares.
#[track_caller]
fn compare(gpu: &Device, name: &str, inputs: &[Tensor], function: impl Fn(&[Var]) -> Var) {
    let on = |device: &Device| {
        let tape = Tape::new();
        let vars: Vec<Var> = inputs.iter().map(|x| tape.constant(x.to_device(device).unwrap())).collect();
        let y = function(&vars);
        assert!(y.device() == *device, "{name}: the result is on {}", y.device());
        y.value().unwrap().to_device(&Device::Cpu).unwrap()
    };
    assert_close(name, &on(gpu), &on(&Device::Cpu));
}

#[test]
fn every_kernel_agrees_with_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for entry in registry().iter().filter(|entry| entry.gpu) {
        for case in (entry.cases)() {
            let found = forward(&case, operands(&case, &gpu)).unwrap_or_else(|error| panic!("{}: {error}", entry.name));
            assert!(found.device() == gpu, "{}", entry.name);
            let expected = forward(&case, operands(&case, &Device::Cpu)).unwrap();
            assert_close(entry.name, &found.to_device(&Device::Cpu).unwrap(), &expected);
        }
    }
}

#[test]
fn every_derivative_agrees_with_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for entry in registry().iter().filter(|entry| entry.gpu) {
        for case in (entry.cases)() {
            for (found, expected) in gradients(&case, &gpu).iter().zip(gradients(&case, &Device::Cpu)) {
                assert!(found.device() == gpu, "{}: a gradient is on {}", entry.name, found.device());
                assert_close(entry.name, &found.to_device(&Device::Cpu).unwrap(), &expected);
            }
        }
    }
}

#[test]
fn nan_and_infinity_go_the_same_way_on_both() {
    let Some(gpu) = gpu() else { return };
    let mut wrong = std::collections::BTreeSet::new();
    for entry in registry().iter().filter(|entry| entry.gpu) {
        for case in (entry.cases)() {
            for poisoned in 0..case.inputs.len() {
                let mut inputs = operands(&case, &Device::Cpu);
                if inputs[poisoned].dtype() != DType::F32 {
                    continue;
                }
                for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                    if matches!(entry.name, "pow" | "powf") && poison < 0.0 {
                        continue; // the power of a negative number is not defined
                    }
                    inputs[poisoned] = Tensor::full(poison, case.inputs[poisoned].shape(), DType::F32);
                    let expected = forward(&case, inputs.clone()).unwrap();
                    let moved = inputs.iter().map(|x| x.to_device(&gpu).unwrap()).collect();
                    let found = forward(&case, moved).unwrap().to_device(&Device::Cpu).unwrap();
                    if found.dtype() == DType::U32 {
                        assert_eq!(found.slice::<u32>(), expected.slice::<u32>(), "{} of {poison}", entry.name);
                        continue;
                    }
                    let pairs = found.slice::<f32>().iter().zip(expected.slice::<f32>());
                    for (a, b) in pairs {
                        let nan = a.to_bits() & 0x7fff_ffff > 0x7f80_0000;
                        if nan != b.is_nan() || (!nan && a.is_finite() != b.is_finite()) {
                            wrong.insert(format!("{} of {poison} in operand {poisoned}: {a}, not {b}", entry.name));
                        }
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn ops_without_a_kernel_say_so() {
    let Some(gpu) = gpu() else { return };
    for entry in registry().iter().filter(|entry| !entry.gpu) {
        for case in (entry.cases)() {
            let error = forward(&case, operands(&case, &gpu)).err().unwrap();
            assert_eq!(error.kind(), ErrorKind::Unsupported, "{error}");
            assert!(error.to_string().contains(entry.name), "{} is not in: {error}", entry.name);
        }
    }
}

#[test]
fn a_model_may_go_to_the_gpu_and_back() {
    let Some(gpu) = gpu() else { return };
    let tape = Tape::new();
    let x = tape.leaf(Tensor::from_vec(vec![0.5f32, -2.0, 3.0], [3]));
    let there = x.to_device(&gpu).square();
    assert_eq!((there.device(), x.to_device(&Device::Cpu).device()), (gpu.clone(), Device::Cpu));
    let loss = (there.to_device(&Device::Cpu) * &x).sum_all();
    let gradients = loss.backward().unwrap();
    let found = gradients.wrt(&x).unwrap();
    assert_eq!((found.device(), found.slice::<f32>()), (Device::Cpu, &[0.75f32, 12.0, 27.0][..]));
}

#[test]
fn any_number_of_elements() {
    let Some(gpu) = gpu() else { return };
    for len in [0, 1, 3, 255, 257, 70_000] {
        let [x, y, one] = [random(1, [len]), random(2, [len]), random(3, [])];
        compare(&gpu, "mul", &[x.clone(), y.clone()], |v| &(&v[0] * &v[1]) + &v[0]);
        compare(&gpu, "tanh", &[x.clone(), one], |v| (&v[0] * &v[1]).tanh());
        compare(&gpu, "pad", std::slice::from_ref(&x), |v| v[0].pad(0, 3, 2));
        compare(&gpu, "slice", std::slice::from_ref(&x), |v| v[0].slice(0, len / 3..len - len / 4));
        compare(&gpu, "concat", &[x.clone(), y], |v| v[0].concat(&[&v[1], &v[0]], 0));
        compare(&gpu, "broadcast_to", std::slice::from_ref(&x), |v| {
            v[0].reshape([1, len, 1]).broadcast_to([2, len, 3])
        });
        let wide = random(4, [len, 3]);
        compare(&gpu, "permute", std::slice::from_ref(&wide), |v| v[0].permute(&[1, 0]));
    }
}

#[test]
fn sums_of_any_shape() {
    let Some(gpu) = gpu() else { return };
    // numbers that add up without rounding, so that any order gives the same sum
    let whole = |shape: Vec<usize>| {
        let len = shape.iter().product::<usize>();
        Tensor::from_vec((0..len).map(|i| (i * 7 % 11) as f32 - 5.0).collect(), shape)
    };
    let sum = |shape: &[usize], axes: &'static [usize]| {
        compare(&gpu, "sum", &[whole(shape.to_vec())], |v| v[0].sum(axes));
    };
    for len in [0, 1, 3, 255, 257, 4097, 70_000] {
        sum(&[len], &[0]);
        sum(&[len, 3], &[0]);
        sum(&[len, 3], &[1]);
        sum(&[3, len], &[1]);
        sum(&[2, len, 3], &[0, 2]);
    }
    sum(&[20_000, 300], &[1]);
    sum(&[300, 20_000], &[0]);
    sum(&[2, 3, 4, 2, 3, 4, 2, 2], &[1, 3, 5]);
    sum(&[], &[]);
}

#[test]
fn sums_keep_their_digits() {
    let Some(gpu) = gpu() else { return };
    let x = uniform(1, [100_000], 0.0..1.0);
    let exact: f64 = x.cast(DType::F32).unwrap().to_vec().unwrap().iter().sum();
    let tape = Tape::new();
    let x = tape.constant(x.cast(DType::F32).unwrap().to_device(&gpu).unwrap());
    let found = x.sum_all().item().unwrap();
    assert!((found / exact - 1.0).abs() < 1e-6, "{found} instead of {exact}");
    assert_eq!(found.to_bits(), x.sum_all().item().unwrap().to_bits(), "the same bits every time");
}

#[test]
fn matmul_of_any_size() {
    let Some(gpu) = gpu() else { return };
    let sizes = [
        [1, 1, 1, 1],
        [1, 3, 5, 7],
        [1, 65, 17, 63],
        [1, 64, 64, 64],
        [1, 129, 1, 2],
        [1, 2, 130, 70],
        [3, 5, 33, 66],
        [1, 4, 0, 3],
        [1, 0, 3, 2],
        [0, 3, 3, 3],
    ];
    for [batch, m, k, n] in sizes {
        // whole numbers: every order of additions is exact
        let whole = |seed, shape: [usize; 3]| {
            let values = random(seed, shape).to_vec().unwrap();
            Tensor::from_vec(values.into_iter().map(|v| (v * 8.0).round() as f32).collect(), shape)
        };
        let pair = [whole(1, [batch, m, k]), whole(2, [batch, k, n])];
        compare(&gpu, "matmul", &pair, |v| v[0].matmul(&v[1]));
        // gradients multiply by transposed operands
        let slopes = |device: &Device| {
            let tape = Tape::new();
            let vars: Vec<Var> = pair.iter().map(|x| tape.leaf(x.to_device(device).unwrap())).collect();
            let loss = vars[0].matmul(&vars[1]).square().sum_all();
            let found = loss.backward().unwrap();
            vars.iter().map(|x| found.wrt(x).unwrap().to_device(&Device::Cpu).unwrap()).collect::<Vec<_>>()
        };
        slopes(&gpu).iter().zip(slopes(&Device::Cpu)).for_each(|(a, b)| assert_close("matmul", a, &b));
    }
}

#[test]
fn attention_over_more_than_one_block_of_partners() {
    let Some(gpu) = gpu() else { return };
    for [queries, keys, channels, values] in [[3, 300, 2, 5], [300, 3, 5, 2], [2, 3, 4, 260], [2, 0, 3, 3]] {
        let operands =
            [random(1, [2, queries, channels]), random(2, [2, keys, channels]), random(3, [2, keys, values])];
        compare(&gpu, "attention", &operands, |v| v[0].attention(&v[1], &v[2], 0.8, None));
        let slopes = |device: &Device| {
            let tape = Tape::new();
            let vars: Vec<Var> = operands.iter().map(|x| tape.leaf(x.to_device(device).unwrap())).collect();
            let loss = vars[0].attention(&vars[1], &vars[2], 0.8, None).square().sum_all();
            let found = loss.backward().unwrap();
            vars.iter().map(|x| found.wrt(x).unwrap().to_device(&Device::Cpu).unwrap()).collect::<Vec<_>>()
        };
        // sums of hundreds of terms of both signs: compared with the largest element
        for (found, expected) in slopes(&gpu).iter().zip(slopes(&Device::Cpu)) {
            let (found, expected) = (found.to_vec().unwrap(), expected.to_vec().unwrap());
            let scale = expected.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            for (a, b) in found.iter().zip(&expected) {
                assert!((a - b).abs() <= 5e-5 * scale, "{queries}x{keys}: {a} on the GPU and {b} on the CPU");
            }
        }
    }
    // masks that leave a query some keys, or none
    let inf = f32::INFINITY;
    let mask = Tensor::from_vec(vec![0.0, -inf, -inf, -inf, -inf, -inf, 1.0, 2.0, -inf], [3, 3]);
    let operands = [random(1, [2, 3, 4]), random(2, [2, 3, 4]), random(3, [2, 3, 4]), mask.clone()];
    compare(&gpu, "attention", &operands, |v| v[0].attention(&v[1], &v[2], 0.8, Some(&v[3])));
    compare(&gpu, "softmax", std::slice::from_ref(&mask), |v| v[0].softmax(1));
    compare(&gpu, "log_softmax", &[random(1, [3, 700])], |v| v[0].log_softmax(1));
    let far = uniform(1, [2, 2, 300], 3000.0..3001.0).cast(DType::F32).unwrap();
    compare(&gpu, "group_norm", &[far], |v| v[0].group_norm(1, 1e-5, None));
}

#[test]
fn more_workgroups_than_one_axis_may_have() {
    let Some(gpu) = gpu() else { return };
    let len = 65_535 * 256 + 1000;
    let tape = Tape::new();
    let one = tape.constant(Tensor::full(1.0, [1], DType::F32).to_device(&gpu).unwrap());
    let ones = one.broadcast_to([len]);
    assert_eq!(ones.sum_all().item().unwrap(), len as f64);
    assert_eq!((&ones + &ones).slice(0, len - 3..len).value().unwrap().to_vec().unwrap(), [2.0; 3]);
}

#[test]
fn rows_by_their_numbers() {
    let Some(gpu) = gpu() else { return };
    let index = |device: &Device, rows: Vec<u32>| {
        let len = rows.len();
        Tensor::from_vec(rows, [len]).to_device(device).unwrap()
    };
    let rows: Vec<u32> = (0..1000u32).map(|i| i * i % 77).collect();
    let slopes = |device: &Device| {
        let tape = Tape::new();
        let x = tape.leaf(random(1, [77, 5]).to_device(device).unwrap());
        let picked = x.index_select(&tape.constant(index(device, rows.clone()))).unwrap();
        let found = picked.square().sum_all().backward().unwrap();
        found.wrt(&x).unwrap().to_device(&Device::Cpu).unwrap()
    };
    assert_close("index_add", &slopes(&gpu), &slopes(&Device::Cpu));

    let tape = Tape::new();
    let x = tape.constant(random(1, [3, 2]).to_device(&gpu).unwrap());
    let outside = tape.constant(index(&gpu, vec![0, 3, 1]));
    for error in [x.index_select(&outside).err().unwrap(), x.index_add(&outside, 3).err().unwrap()] {
        assert_eq!(error.kind(), ErrorKind::Input);
        assert!(error.to_string().contains("index[1]"), "{error}");
    }
}

#[test]
fn what_a_kernel_cannot_do_is_an_error() {
    let Some(gpu) = gpu() else { return };
    let names: Vec<String> = (0..8).map(|n| format!("x{n}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let product = Program::trace("octet", &names, &["y"], |x| vec![x.iter().copied().reduce(|a, b| a * b).unwrap()]);
    let tape = Tape::new();
    let x = tape.constant(random(1, [3]).to_device(&gpu).unwrap());
    let error = x.apply(Map::new(product), &[&x; 7]).err().unwrap();
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("octet"), "{error}");

    let counts = tape.constant(Tensor::from_vec(vec![1u32, 2], [2]).to_device(&gpu).unwrap());
    let refused = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| counts.sum_all())).unwrap_err();
    let message = refused.downcast_ref::<String>().unwrap();
    assert!(message.contains("sum does not compute in u32"), "{message}");
}

#[test]
fn operands_on_two_devices_are_refused() {
    let Some(gpu) = gpu() else { return };
    let tape = Tape::new();
    let (x, y) = (tape.constant(random(1, [3]).to_device(&gpu).unwrap()), tape.constant(random(2, [3])));
    assert_eq!((&x + &y).value().unwrap_err().kind(), ErrorKind::Device);
}

#[test]
fn threads_share_buffers_and_queue() {
    let Some(gpu) = gpu() else { return };
    // results are dropped at once, so that their buffers serve again while work on them is still only recorded
    let walk = |device: &Device, seed: u64| {
        let tape = Tape::new();
        let mut x = tape.constant(random(seed, [257]).to_device(device).unwrap());
        for step in 0..200 {
            let turned = &(&x * 0.5) + f64::from(step % 7);
            x = &turned - &x.square().slice(0, 0..1);
            x = &x * 0.125;
        }
        x.value().unwrap().to_device(&Device::Cpu).unwrap()
    };
    std::thread::scope(|scope| {
        for seed in 0..4 {
            let (gpu, walk) = (&gpu, &walk);
            scope.spawn(move || assert_close("mul", &walk(gpu, seed), &walk(&Device::Cpu, seed)));
        }
    });
}

/// A kernel of a user's own.
static TWICE: Kernel = Kernel::new(
    "twice",
    "main",
    "@group(0) @binding(0) var<storage, read_write> y: array<f32>;
     @group(0) @binding(1) var<storage, read> x: array<f32>;
     @compute @workgroup_size(64)
     fn main(@builtin(global_invocation_id) id: vec3<u32>) {
         if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
     }",
    &["y", "x"],
);

#[test]
fn a_kernel_of_ones_own() {
    let Some(Device::Gpu(gpu)) = gpu() else { return };
    let run = |gpu: &Gpu, x: &Tensor| gpu.launch(&TWICE, &[x], &[], x.spec(), Work::Invocations(x.len()));
    let x = random(1, [130]);
    let found = run(&gpu, &x.to_device(&Device::Gpu(gpu.clone())).unwrap()).unwrap().to_vec().unwrap();
    assert!(found.iter().zip(x.to_vec().unwrap()).all(|(a, b)| *a == 2.0 * b));
    let none = gpu.empty(Spec::new([0], DType::F32)).unwrap();
    assert!(run(&gpu, &none).unwrap().is_empty());
}

#[test]
fn random_numbers_are_the_same_on_both() {
    let Some(gpu) = gpu() else { return };
    let key = Key::new(17);
    let on = |device: &Device, make: fn(&Device, Key, [usize; 1], DType) -> Result<Tensor>| {
        make(device, key, [70_001], DType::F32).unwrap().to_vec().unwrap()
    };
    assert!(on(&gpu, Tensor::uniform_on) == on(&Device::Cpu, Tensor::uniform_on));
    let pairs = on(&gpu, Tensor::normal_on).into_iter().zip(on(&Device::Cpu, Tensor::normal_on));
    for (at, (a, b)) in pairs.enumerate() {
        assert!((a - b).abs() <= 5e-6 * b.abs().max(1.0), "number {at} is {a} on the GPU and {b} on the CPU");
    }
}

#[test]
fn composed_functions_agree() {
    let Some(gpu) = gpu() else { return };
    let x = random(1, [3, 4, 5]);
    let index = |v: &Var, list: Vec<u32>, shape: &[usize]| {
        let index = Tensor::from_vec(list, shape).to_device(&v.device()).unwrap();
        v.tape().constant(index)
    };
    let one = std::slice::from_ref(&x);
    compare(&gpu, "exp", one, |v| v[0].logsumexp(&[0, 2]));
    compare(&gpu, "variance", one, |v| v[0].variance(&[1], 1));
    compare(&gpu, "cumprod", one, |v| v[0].cumprod_from_end(1));
    compare(&gpu, "slice", one, |v| v[0].roll(2, 3).flip(0).repeat(&[1, 2, 1]));
    compare(&gpu, "slice", one, |v| v[0].gather(1, &index(&v[0], vec![3, 0, 1, 1], &[2, 1, 2])).unwrap());
    compare(&gpu, "slice", one, |v| v[0].select_along(2, &index(&v[0], vec![4, 0, 4], &[3])).unwrap());
    compare(&gpu, "slice", one, |v| index(&v[0], vec![2, 0], &[2]).one_hot(3, DType::F32).unwrap());
    compare(&gpu, "add", one, |v| {
        let values = v[0].slice(0, 0..1).slice(1, 0..2).slice(2, 0..2);
        v[0].scatter_add(2, &index(&v[0], vec![3, 0, 0, 0], &[1, 2, 2]), &values).unwrap()
    });
    compare(&gpu, "sin", one, |v| v[0].positional_encoding(8));
    compare(&gpu, "sin", &[Tensor::from_vec(vec![0.0f32, 1.0, 981.0], [3])], |v| v[0].sinusoid(7));
    compare(&gpu, "mul", &[x.clone(), random(2, [4, 1]), random(3, [5])], |v| &v[0] * &v[1] + &v[2]);
    let mask = Tensor::from_vec(vec![1.0f32, 0.0, f32::NAN, -2.0], [4, 1]);
    compare(&gpu, "choose", &[mask, x.clone(), random(2, [5])], |v| v[0].choose(&v[1], &v[2]));
    let long = random(4, [2, 5000]);
    compare(&gpu, "max", std::slice::from_ref(&long), |v| v[0].max(&[1]));
    let places = |device: &Device| {
        let x = Tape::new().constant(long.to_device(device).unwrap());
        [x.argmax(1), x.argmin(1), x.argmax(0)].map(|y| y.value().unwrap().to_vec().unwrap())
    };
    assert_eq!(places(&gpu), places(&Device::Cpu));
}
