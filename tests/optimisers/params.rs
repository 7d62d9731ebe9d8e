//! The store of parameters: scopes, freezing, casting, loading.

use gradreel::io::{Archive, TensorFile};
use gradreel::optim::{Load, Params};
use gradreel::{DType, Tape, Tensor};

fn store(paths: &[(&str, usize)]) -> Params {
    paths.iter().map(|(path, len)| ((*path).to_owned(), Tensor::zeros([*len], DType::F32))).collect()
}

#[test]
fn scopes_see_the_rest_of_the_path() {
    let params = store(&[("model.out.bias", 2), ("model.out.weight", 6), ("model.outer", 1), ("time", 4)]);
    let out = params.scope("model").scope("out");
    assert_eq!(out.iter().map(|(path, _)| path).collect::<Vec<_>>(), ["bias", "weight"]);
    assert_eq!((out.count(), params.scope("").count(), params.scope("nothing").count()), (8, 13, 0));
    assert_eq!(out.get("weight").unwrap().len(), 6);
    assert!(out.get("scale").unwrap_err().to_string().contains("model.out.scale"));
    let tape = Tape::new();
    let bound = params.bind(&tape);
    assert_eq!(bound.scope("model").scope("out").get("bias").unwrap().dims(), [2]);
}

#[test]
fn the_longest_prefix_decides_what_is_frozen() {
    let mut params = store(&[("net.a", 1), ("net.middle.b", 2), ("net.middle.c", 4), ("time", 8)]);
    params.freeze("net").unwrap();
    params.thaw("net.middle").unwrap();
    params.freeze("net.middle.c").unwrap();
    assert_eq!((params.count(), params.count_trainable()), (15, 10));
    assert!(params.freeze("net.mid").unwrap_err().to_string().contains("net.mid"));
    let tape = Tape::new();
    let bound = params.bind(&tape);
    let is_leaf = |path: &str| bound.get(path).unwrap().is_differentiable();
    assert_eq!(["net.a", "net.middle.b", "net.middle.c", "time"].map(is_leaf), [false, true, false, true]);
}

#[test]
fn weights_can_be_kept_in_half_precision() {
    let mut params: Params = [
        ("net.w".to_owned(), Tensor::from_vec(vec![0.1f32, 70000.0], [2])),
        ("net.index".to_owned(), Tensor::from_vec(vec![70000u32], [1])),
        ("time".to_owned(), Tensor::from_vec(vec![0.1f32], [1])),
    ]
    .into_iter()
    .collect();
    params.cast("net", DType::F16).unwrap();
    assert_eq!(params.get("net.w").unwrap().to_vec().unwrap(), [0.0999755859375, f64::INFINITY]);
    assert_eq!(params.get("net.index").unwrap().slice::<u32>(), [70000]);
    assert_eq!(params.get("time").unwrap().dtype(), DType::F32);
    assert!(params.cast("other", DType::F16).is_err());
}

#[test]
fn loading_takes_the_numbers_and_keeps_the_dtypes() {
    let archive = Archive::open("tests/vectors/tiny_lightning.ckpt").unwrap();
    let mut params: Params = [
        ("net.half", Tensor::zeros([3, 2], DType::F32)),
        ("net.double", Tensor::zeros([2, 2], DType::F32)),
        ("net.long", Tensor::zeros([2, 2], DType::U32)),
    ]
    .map(|(path, x)| (path.to_owned(), x))
    .into_iter()
    .collect();
    let how = Load::strict().into_prefix("net").allow_unexpected();
    // `long` holds a negative number, which an index cannot be; nothing is loaded by halves
    let error = params.load(&archive, &how).unwrap_err();
    assert!(error.to_string().contains("long"), "{error}");
    assert_eq!(params.get("net.half").unwrap().slice::<f32>(), [0.0; 6]);
    params.set("net.long", Tensor::zeros([2, 2], DType::F64));
    let error = params.load(&archive, &how).unwrap_err();
    assert!(error.to_string().contains("long of integers, not floats"), "{error}");
    let floats = params.iter().filter(|(path, _)| *path != "net.long");
    params = floats.map(|(path, x)| (path.to_owned(), x.clone())).collect();
    params.load(&archive, &how).unwrap();
    let half = archive.load("half").unwrap();
    assert_eq!(params.get("net.half").unwrap().to_vec().unwrap(), half.to_vec().unwrap());
    assert_eq!(params.get("net.double").unwrap().dtype(), DType::F32);
}

#[test]
fn everything_that_does_not_fit_is_reported_at_once() {
    let mut params = store(&[("a", 1), ("b", 2), ("c", 3), ("index", 2)]);
    let mut file = TensorFile::default();
    for i in 0..12 {
        file.tensors.insert(format!("extra{i:02}"), Tensor::zeros([1], DType::F32));
    }
    file.tensors.insert("b".into(), Tensor::zeros([2, 1], DType::F32));
    file.tensors.insert("c".into(), Tensor::full(1.0, [3], DType::F32));
    file.tensors.insert("index".into(), Tensor::zeros([2], DType::U32));
    file.tensors.insert("optimizer.adam.m.a".into(), Tensor::zeros([1], DType::F32));
    let error = params.load(&file, &Load::strict()).unwrap_err().to_string();
    for wanted in [
        "1 missing: a;",
        "12 unexpected: extra00, extra01",
        "extra09, …;",
        "2 of another shape or kind: b [2, 1], not [2], index of integers, not floats",
    ] {
        assert!(error.contains(wanted), "{error}\ndoes not say: {wanted}");
    }
    assert!(!error.contains("extra10") && !error.contains("optimizer"), "{error}");
    assert_eq!(params.get("c").unwrap().slice::<f32>(), [0.0; 3]);

    let mut params = store(&[("a", 1), ("c", 3)]);
    params.load(&file, &Load::strict().allow_missing().allow_unexpected()).unwrap();
    assert_eq!(params.get("c").unwrap().slice::<f32>(), [1.0; 3]);
    let error = params.load(&file, &Load::strict().from_prefix("x").allow_missing()).unwrap_err();
    assert!(error.to_string().contains("nothing in common"), "{error}");

    let mut params = store(&[("ema.a", 1)]);
    assert!(params.save(&mut file).unwrap_err().to_string().contains("ema.a"));
    params = store(&[("emanation", 1)]);
    params.save(&mut file).unwrap();
}
