//! Runs a network on a file's inputs and weights and compares whatever the file holds: `out.*` and `mid.*` with what the
//! network returns under these names, `grad.*` with the gradients of `Σ out · cot`.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::layers::{Init, Scope, Weights};
use gradreel::io::TensorFile;
use gradreel::{DType, Device, ErrorKind, Gradients, Result, Shape, Tape, Tensor, Var};

use super::procedural;
use crate::find;

/// Where a comparison runs.
#[derive(Clone)]
pub struct Place {
    name: &'static str,
    dtype: DType,
    pub device: Device,
}

impl Place {
    /// Whether numbers are `f64` here.
    pub fn is_f64(&self) -> bool {
        self.dtype == DType::F64
    }
}

/// `f64` and `f32` on the CPU, `f32` on a GPU where there is one (in CI there must be one).
pub fn places() -> Vec<Place> {
    let cpu = |name, dtype| Place { name, dtype, device: Device::Cpu };
    let mut all = vec![cpu("f64", DType::F64), cpu("f32", DType::F32)];
    match Device::gpu() {
        Ok(device) => all.push(Place { name: "GPU", dtype: DType::F32, device }),
        Err(error) if std::env::var("CI").is_ok_and(|ci| ci == "true") => {
            panic!("the GPU must be tested here: {error}")
        }
        Err(error) => eprintln!("no GPU: {error}"),
    }
    all
}

/// Largest errors relative to the largest number of a tensor.
#[derive(Clone, Copy)]
pub struct Tolerance {
    pub value: f64,
    pub gradient: f64,
}

/// A file of vectors: this project's, or one of the same name in the folder that `GRADREEL_VECTORS` names.
pub fn load(name: &str) -> TensorFile {
    let own = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors/views"));
    TensorFile::read(find::path(own, find::VIEWS, &format!("{name}.safetensors"))).unwrap()
}

/// A folder for files that tests write, beside this program.
pub fn scratch(name: &str) -> PathBuf {
    let folder = std::env::current_exe().unwrap().with_file_name("written_by_tests").join(name);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A hyper-parameter of a file.
pub fn setting(file: &TensorFile, name: &str) -> serde_json::Value {
    let settings: serde_json::Value = serde_json::from_str(&file.metadata["hyperparameters"]).unwrap();
    settings[name].clone()
}

/// A hyper-parameter of a file that is a count.
pub fn size(file: &TensorFile, name: &str) -> usize {
    setting(file, name).as_u64().unwrap_or_else(|| panic!("no count {name}")) as usize
}

/// A gradient; of what nothing depends on it is zero.
pub fn gradient(gradients: &Gradients, leaf: &Var) -> Tensor {
    match gradients.wrt(leaf) {
        Ok(gradient) => gradient.clone(),
        Err(error) if error.kind() == ErrorKind::NoGradient => Tensor::zeros(leaf.shape().clone(), leaf.dtype()),
        Err(error) => panic!("{error}"),
    }
}

/// One evaluation: inputs and weights as leaves of a tape.
pub struct Case<'a> {
    file: &'a TensorFile,
    place: &'a Place,
    seed: Option<String>,
    pub tape: Tape,
    leaves: RefCell<BTreeMap<String, Var>>,
}

impl<'a> Case<'a> {
    pub fn new(file: &'a TensorFile, place: &'a Place) -> Self {
        let seed = file.metadata.get("hyperparameters").and_then(|text| {
            let settings: serde_json::Value = serde_json::from_str(text).ok()?;
            settings["weight_seed"].as_str().map(str::to_owned)
        });
        Self { file, place, seed, tape: Tape::new(), leaves: RefCell::default() }
    }

    fn leaf(&self, name: &str, value: impl FnOnce() -> Tensor) -> Var {
        let make = || {
            let value = value().cast(self.place.dtype).unwrap().to_device(&self.place.device).unwrap();
            self.tape.leaf(value)
        };
        self.leaves.borrow_mut().entry(name.to_owned()).or_insert_with(make).clone()
    }

    /// An input of the file.
    pub fn input(&self, name: &str) -> Var {
        let name = format!("in.{name}");
        self.leaf(&name, || self.file.get(&name).unwrap().clone())
    }

    /// Any tensor of the file, without gradient.
    pub fn given(&self, name: &str) -> Var {
        let value = self.file.get(name).unwrap().cast(self.place.dtype).unwrap();
        self.tape.constant(value.to_device(&self.place.device).unwrap())
    }

    /// An input as plain numbers.
    pub fn numbers(&self, name: &str) -> Vec<f64> {
        self.file.get(&format!("in.{name}")).unwrap().to_vec().unwrap()
    }

    /// The shape of a weight in the file.
    pub fn shape(&self, weight: &str) -> Vec<usize> {
        self.file.get(&format!("w.{weight}")).unwrap().dims().to_vec()
    }

    /// A hyper-parameter.
    pub fn setting(&self, name: &str) -> serde_json::Value {
        setting(self.file, name)
    }

    /// A hyper-parameter that is a count.
    pub fn size(&self, name: &str) -> usize {
        size(self.file, name)
    }

    /// The sizes of any tensor of the file.
    pub fn dims(&self, name: &str) -> &[usize] {
        self.file.get(name).unwrap().dims()
    }

    /// A hyper-parameter that is four counts.
    pub fn sizes(&self, name: &str) -> [usize; 4] {
        let list: Vec<usize> = serde_json::from_value(self.setting(name)).unwrap();
        list.try_into().unwrap()
    }

    /// A leaf that was asked for before.
    pub fn leaf_of(&self, name: &str) -> Var {
        self.leaves.borrow()[name].clone()
    }

    /// The weights.
    pub fn scope(&self) -> Scope<'_> {
        Scope::root(self)
    }
}

impl Weights for Case<'_> {
    fn weight(&self, path: &str, shape: &Shape, _: Init) -> Result<Var> {
        let name = format!("w.{path}");
        let leaf = match &self.seed {
            Some(seed) => self.leaf(&name, || procedural::weight(seed, path, shape)),
            None => self.leaf(&name, || self.file.get(&name).unwrap().clone()),
        };
        assert_eq!(leaf.shape(), shape, "{path}");
        Ok(leaf)
    }
}

/// Runs a network everywhere and compares. `strip` is the part of the weights' paths that gradients in the file leave out.
pub fn check(name: &str, strip: &str, tolerance: Tolerance, run: impl Fn(&Case<'_>) -> Result<Vec<(String, Var)>>) {
    let file = load(name);
    for place in places() {
        let case = Case::new(&file, &place);
        let results = run(&case).unwrap();
        let mut compared = 0;
        let mut loss: Option<Var> = None;
        for (result, value) in &results {
            if let Ok(expected) = file.get(result) {
                close(&format!("{name} {} {result}", place.name), value.value().unwrap(), expected, tolerance.value);
                compared += 1;
            }
            if let Some(cotangent) =
                result.strip_prefix("out.").and_then(|short| file.get(&format!("cot.{short}")).ok())
            {
                let cotangent = cotangent.cast(place.dtype).unwrap().to_device(&place.device).unwrap();
                let part = (value * &case.tape.constant(cotangent)).sum_all();
                loss = Some(loss.map_or(part.clone(), |sum| &sum + &part));
            }
        }
        assert!(compared > 0, "{name}: nothing was compared");
        let Some(loss) = loss else { continue };
        let gradients = loss.backward().unwrap();
        for (key, expected) in &file.tensors {
            let Some(short) = key.strip_prefix("grad.") else { continue };
            let leaves = case.leaves.borrow();
            let full = short.strip_prefix("w.").map(|path| format!("w.{strip}{path}"));
            let leaf = full.and_then(|full| leaves.get(&full)).or_else(|| leaves.get(short));
            let leaf = leaf.unwrap_or_else(|| panic!("{name}: nothing asked for {key}"));
            let context = format!("{name} {} {key}", place.name);
            close(&context, &gradient(&gradients, leaf), expected, tolerance.gradient);
        }
    }
}

/// Compares relative to the largest number; tensors that are rounding noise are compared absolutely.
#[track_caller]
pub fn close(name: &str, found: &Tensor, expected: &Tensor, tolerance: f64) {
    assert_eq!(found.dims(), expected.dims(), "{name}");
    let (found, expected) = (found.to_vec().unwrap(), expected.to_vec().unwrap());
    let largest = expected.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let allowed = if largest < 1e-6 { 1e-5 } else { tolerance * largest };
    for (i, (a, b)) in found.iter().zip(&expected).enumerate() {
        assert!((a - b).abs() <= allowed, "{name}: element {i} is {a}, not {b} (allowed {allowed:.1e})");
    }
}
