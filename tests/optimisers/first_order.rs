//! SGD, Adam and AdamW with schedules and clipping, against PyTorch's updates.

use std::collections::BTreeMap;

use gradreel::io::TensorFile;
use gradreel::optim::{Adam, Clip, Ema, Params, Schedule, Sgd};
use gradreel::{DType, ErrorKind, Result, Tensor};

type Step<'a> = Box<dyn FnMut(&mut Params, &BTreeMap<String, Tensor>) -> Result<()> + 'a>;

fn sgd(mut sgd: Sgd) -> Step<'static> {
    Box::new(move |params, gradients| sgd.step(params, gradients).map(drop))
}

fn adam(mut adam: Adam) -> Step<'static> {
    Box::new(move |params, gradients| adam.step(params, gradients).map(drop))
}

fn one(value: Tensor) -> BTreeMap<String, Tensor> {
    BTreeMap::from([("x".to_owned(), value)])
}

#[test]
fn updates_are_those_of_pytorch() {
    let file = TensorFile::read("tests/vectors/optimisers.npz").unwrap();
    let (start, gradients) = (file.get("start").unwrap(), file.get("gradients").unwrap());
    let mut wide = Adam::new(0.05);
    (wide.beta1, wide.beta2, wide.epsilon) = (0.8, 0.95, 1e-6);
    let plain = || Sgd::new(0.05);
    let cases: Vec<(&str, DType, Step<'_>)> = vec![
        ("adam", DType::F64, adam(Adam::new(0.05))),
        ("adamw", DType::F64, adam(wide.with_weight_decay(0.1))),
        ("adamw_f32", DType::F32, adam(Adam::new(0.05).with_weight_decay(0.1))),
        ("sgd", DType::F64, sgd(plain().with_weight_decay(0.1))),
        ("momentum", DType::F64, sgd(plain().with_momentum(0.9).with_weight_decay(0.01))),
        ("nesterov", DType::F64, sgd(plain().with_nesterov_momentum(0.9))),
        ("cosine", DType::F64, sgd(plain().with_schedule(Schedule::cosine(15, 0.1)))),
        ("warmup", DType::F64, sgd(plain().with_schedule(Schedule::warmup(5, 0.2)))),
        ("step", DType::F64, sgd(plain().with_schedule(Schedule::step(4, 0.5)))),
        ("exponential", DType::F64, sgd(plain().with_schedule(Schedule::exponential(0.8)))),
        ("clip_norm", DType::F64, sgd(plain().with_clip(Clip::Norm(2.0)))),
        ("clip_value", DType::F64, sgd(plain().with_clip(Clip::Value(0.3)))),
    ];
    for (name, dtype, mut step) in cases {
        // PyTorch divides by the norm plus 1e-6 when it clips
        let tolerance = match (dtype, name) {
            (DType::F32, _) | (_, "clip_norm") => 2e-6,
            _ => 1e-13,
        };
        let mut params: Params = one(start.cast(dtype).unwrap()).into_iter().collect();
        let wanted = file.get(name).unwrap().to_vec().unwrap();
        let n = start.len();
        for (i, gradient) in gradients.slice::<f64>().chunks(n).enumerate() {
            let gradient = Tensor::from_vec(gradient.to_vec(), [n]).cast(dtype).unwrap();
            step(&mut params, &one(gradient)).unwrap();
            let found = params.get("x").unwrap().to_vec().unwrap();
            for (found, wanted) in found.iter().zip(&wanted[i * n..]) {
                assert!((found - wanted).abs() < tolerance, "{name}, update {i}: {found}, not {wanted}");
            }
        }
    }
}

#[test]
fn a_gradient_that_is_not_finite_changes_nothing_and_is_named() {
    for (bad, clip) in [(f32::NAN, Clip::Norm(1.0)), (f32::INFINITY, Clip::Value(1.0)), (f32::NEG_INFINITY, Clip::None)]
    {
        let names = ["a", "b.weight"];
        let mut params: Params =
            names.map(|n| (n.to_owned(), Tensor::full(1.0, [40_000], DType::F32))).into_iter().collect();
        let mut values = vec![1.0f32; 40_000];
        values[39_999] = bad;
        let gradients = BTreeMap::from([
            ("a".to_owned(), Tensor::full(1.0, [40_000], DType::F32)),
            ("b.weight".to_owned(), Tensor::from_vec(values, [40_000])),
        ]);
        let mut adam = Adam::new(0.1).with_clip(clip);
        let error = adam.step(&mut params, &gradients).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NonFinite);
        assert!(error.to_string().contains("b.weight"), "{error}");
        assert_eq!(adam.steps(), 0);
        assert!(params.iter().all(|(_, x)| x.slice::<f32>().iter().all(|v| *v == 1.0)));
    }
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let mut params: Params = [("net.w".to_owned(), Tensor::full(1.0, [2], DType::F32))].into_iter().collect();
    let gradient = |path: &str, len: usize, dtype| BTreeMap::from([(path.to_owned(), Tensor::full(1.0, [len], dtype))]);
    let mut refused = |adam: Adam, gradients, wanted: &str| {
        let error = { adam }.step(&mut params, &gradients).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    };
    let good = || gradient("net.w", 2, DType::F32);
    refused(Adam::new(0.1).with_rate("nets", 0.2), good(), "nets");
    refused(Adam::new(0.1).with_weight_decay_of("net.b", 0.2), good(), "net.b");
    refused(Adam::new(f64::NAN), good(), "NaN");
    refused(Adam::new(0.1).with_clip(Clip::Norm(0.0)), good(), "Norm(0.0)");
    refused(Adam::new(0.1), gradient("net.v", 2, DType::F32), "net.v");
    refused(Adam::new(0.1), gradient("net.w", 3, DType::F32), "f32[3]");
    refused(Adam::new(0.1), gradient("net.w", 2, DType::F64), "f64[2]");
    params.cast("net", DType::F16).unwrap();
    let error = Adam::new(0.1).step(&mut params, &gradient("net.w", 2, DType::F32)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Unsupported);
}

#[test]
fn rates_and_decays_follow_the_longest_prefix() {
    let paths = ["net.bias", "net.out.bias", "net.out.weight", "other"];
    let mut params: Params = paths.map(|p| (p.to_owned(), Tensor::full(1.0, [1], DType::F64))).into_iter().collect();
    let gradients: BTreeMap<_, _> = paths.map(|p| (p.to_owned(), Tensor::full(1.0, [1], DType::F64))).into();
    let mut sgd = Sgd::new(0.5).with_rate("net", 0.1).with_rate("net.out", 0.2).with_rate("net.out.bias", 0.0);
    sgd = sgd.with_weight_decay(1.0).with_weight_decay_of("other", 0.0);
    let update = sgd.step(&mut params, &gradients).unwrap();
    assert_eq!((update.step, update.rate, update.gradient_norm), (1, 0.5, 2.0));
    let found = paths.map(|p| params.get(p).unwrap().item().unwrap());
    assert_eq!(found, [1.0 - 0.1 * 2.0, 1.0, 1.0 - 0.2 * 2.0, 0.5]);
}

/// Numbers that fill several chunks, and a rest.
fn many(seed: u64) -> Tensor {
    gradreel::ops::uniform(seed, [100_003], -1.0..1.0).cast(DType::F32).unwrap()
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut params: Params = one(many(1)).into_iter().collect();
            let mut adam = Adam::new(0.01).with_weight_decay(0.1).with_clip(Clip::Norm(3.0));
            let norms: Vec<u64> =
                (0..3).map(|i| adam.step(&mut params, &one(many(2 + i))).unwrap().gradient_norm.to_bits()).collect();
            let bits: Vec<u32> = params.get("x").unwrap().slice::<f32>().iter().map(|v| v.to_bits()).collect();
            (norms, bits)
        })
    };
    assert!(run(1) == run(3));
}

#[test]
fn updates_happen_in_place_unless_somebody_else_looks() {
    let mut params: Params = one(many(1)).into_iter().collect();
    let place = |params: &Params| params.get("x").unwrap().slice::<f32>().as_ptr();
    let mut adam = Adam::new(0.01);
    adam.step(&mut params, &one(many(2))).unwrap();
    let before = place(&params);
    adam.step(&mut params, &one(many(3))).unwrap();
    assert_eq!(place(&params), before);
    let kept = params.get("x").unwrap().clone();
    let values = kept.slice::<f32>().to_vec();
    adam.step(&mut params, &one(many(4))).unwrap();
    assert_eq!(kept.slice::<f32>(), values);
    assert_ne!(params.get("x").unwrap().slice::<f32>(), values);
}

#[test]
fn an_average_forgets_by_its_decay() {
    let mut params = Params::new();
    let mut ema = Ema::new(0.75);
    for (i, x) in [8.0, 4.0, 0.0].into_iter().enumerate() {
        params.set("x", Tensor::full(x, [3], DType::F32));
        params.set("index", Tensor::from_vec(vec![i as u32], [1]));
        params.set("fixed", Tensor::full(x, [1], DType::F32));
        params.freeze("fixed").unwrap();
        ema.update(&params).unwrap();
    }
    let averaged = ema.averaged(&params);
    assert_eq!(averaged.get("x").unwrap().slice::<f32>(), [0.75 * (0.75 * 8.0 + 0.25 * 4.0); 3]);
    assert_eq!(averaged.get("fixed").unwrap().item().unwrap(), 0.0);
    assert_eq!(averaged.get("index").unwrap().item().unwrap(), 2.0);
    assert_eq!(params.get("x").unwrap().slice::<f32>(), [0.0; 3]);
}
