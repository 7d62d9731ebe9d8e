//! A training that is stopped, written to a file and taken up again ends where it would have ended, bit for bit.

use std::collections::BTreeMap;

use gradreel::io::TensorFile;
use gradreel::optim::{Adam, Clip, Ema, Load, Params, Schedule, Sgd};
use gradreel::{DType, ErrorKind, Tensor, ops};

struct Training {
    params: Params,
    adam: Adam,
    sgd: Sgd,
    ema: Ema,
}

impl Training {
    fn new() -> Self {
        let x = |seed| ops::uniform(seed, [50, 3], -1.0..1.0).cast(DType::F32).unwrap();
        let schedule = Schedule::warmup(4, 0.1).then(4, Schedule::cosine(10, 0.0));
        Self {
            params: [("a.w".to_owned(), x(1)), ("b.w".to_owned(), x(2))].into_iter().collect(),
            adam: Adam::new(0.02).with_weight_decay(0.01).with_schedule(schedule).with_clip(Clip::Norm(2.0)),
            sgd: Sgd::new(0.01).with_nesterov_momentum(0.9).with_schedule(Schedule::step(3, 0.5)),
            ema: Ema::new(0.9),
        }
    }

    fn run(&mut self, steps: std::ops::Range<u64>) {
        for step in steps {
            let gradient = |path: &str, k: u64| {
                let noise = ops::uniform(100 + 2 * step + k, [50, 3], -1.0..1.0).to_vec().unwrap();
                let x = self.params.get(path).unwrap().to_vec().unwrap();
                let g = x.iter().zip(noise).map(|(x, n)| (x + 0.3 * n) as f32).collect();
                BTreeMap::from([(path.to_owned(), Tensor::from_vec(g, [50, 3]))])
            };
            let (a, b) = (gradient("a.w", 0), gradient("b.w", 1));
            self.adam.step(&mut self.params, &a).unwrap();
            self.sgd.step(&mut self.params, &b).unwrap();
            self.ema.update(&self.params).unwrap();
        }
    }

    fn save(&self) -> TensorFile {
        let mut file = TensorFile::default();
        self.params.save(&mut file).unwrap();
        self.adam.save(&mut file);
        self.sgd.save(&mut file);
        self.ema.save(&mut file);
        file
    }
}

fn bits(file: &TensorFile) -> Vec<(String, Vec<u32>)> {
    let bits = |x: &Tensor| x.slice::<f32>().iter().map(|v| v.to_bits()).collect();
    file.tensors.iter().map(|(name, x)| (name.clone(), bits(x))).collect()
}

#[test]
fn a_resumed_training_ends_at_the_same_bits() {
    let mut whole = Training::new();
    whole.run(0..14);
    let mut first = Training::new();
    first.run(0..6);
    let written = first.save().to_bytes().unwrap();

    let file = TensorFile::from_bytes(&written).unwrap();
    assert!(file.tensors.contains_key("optimizer.adam.m.a.w") && file.tensors.contains_key("optimizer.adam.v.a.w"));
    assert!(file.tensors.contains_key("optimizer.sgd.momentum.b.w") && file.tensors.contains_key("ema.a.w"));
    assert_eq!(file.metadata["optimizer.adam.step"], "6");
    let mut second = Training::new();
    second.params.load(&file, &Load::strict()).unwrap();
    second.adam.restore(&file).unwrap();
    second.sgd.restore(&file).unwrap();
    second.ema.restore(&file).unwrap();
    second.run(6..14);

    assert_eq!(bits(&second.save()), bits(&whole.save()));
    assert_eq!(second.save().metadata, whole.save().metadata);
    let mut without = Training::new();
    without.params.load(&file, &Load::strict()).unwrap();
    without.run(6..14);
    assert_ne!(bits(&without.save()), bits(&whole.save()), "the state matters");
}

#[test]
fn an_incomplete_state_is_refused() {
    let mut training = Training::new();
    training.run(0..2);
    let mut file = training.save();
    file.tensors.remove("optimizer.adam.v.a.w");
    let error = training.adam.restore(&file).unwrap_err();
    assert!(error.to_string().contains("optimizer.adam.v.a.w"), "{error}");
    file.tensors.remove("optimizer.adam.m.a.w");
    file.tensors.insert("optimizer.adam.v.a.w".into(), Tensor::zeros([1], DType::F32));
    assert!(training.adam.restore(&file).unwrap_err().to_string().contains("incomplete"));
    assert_eq!(Adam::new(0.1).restore(&TensorFile::default()).unwrap_err().kind(), ErrorKind::Input);

    // the state of other parameters
    let file = training.save();
    let mut other = Training::new();
    other.adam.restore(&file).unwrap();
    other.params.set("a.w", Tensor::zeros([2], DType::F32));
    let gradients = BTreeMap::from([("a.w".to_owned(), Tensor::zeros([2], DType::F32))]);
    let error = other.adam.step(&mut other.params, &gradients).unwrap_err();
    assert!(error.to_string().contains("f32[50, 3]"), "{error}");
}
