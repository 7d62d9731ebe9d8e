//! Vector files, the places where a test runs, and comparisons.

use std::collections::HashMap;
use std::path::Path;
use std::sync::OnceLock;

use gradreel::{DType, Device, Result, Tape, Tensor, Var};
use safetensors::{Dtype, SafeTensors};
use serde_json::Value;

use crate::find;

const OWN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors");

/// A file of vectors: this project's, or one of the same name in the folder that `GRADREEL_VECTORS` names.
pub struct File {
    tensors: HashMap<String, (Vec<f64>, Vec<usize>)>,
    metadata: HashMap<String, Value>,
}

impl File {
    pub fn load(name: &str) -> Self {
        let bytes = std::fs::read(find::path(Path::new(OWN), find::DYNAMICS, &format!("{name}.safetensors"))).unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let metadata = header.metadata().clone().unwrap_or_default();
        let metadata = metadata.into_iter().map(|(key, text)| (key, serde_json::from_str(&text).unwrap())).collect();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let tensors = file.tensors().into_iter().map(|(name, view)| {
            let data = view.data();
            let values: Vec<f64> = match view.dtype() {
                Dtype::F64 => data.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
                Dtype::F32 => data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b).into()).collect(),
                Dtype::I64 => data.as_chunks().0.iter().map(|b| i64::from_le_bytes(*b) as f64).collect(),
                Dtype::I32 => data.as_chunks().0.iter().map(|b| i32::from_le_bytes(*b).into()).collect(),
                Dtype::U8 | Dtype::BOOL => data.iter().map(|&b| b.into()).collect(),
                other => panic!("{name}: {other:?}"),
            };
            (name, (values, view.shape().to_vec()))
        });
        Self { tensors: tensors.collect(), metadata }
    }

    /// The names of all files of vectors that begin so, but for those with a test of their own.
    pub fn others(prefix: &str, known: &[&str]) -> Vec<String> {
        let names = find::names(Path::new(OWN), find::DYNAMICS, prefix);
        names.into_iter().filter(|name| !known.contains(&name.as_str())).collect()
    }

    pub fn get(&self, name: &str) -> &[f64] {
        &self.tensors.get(name).unwrap_or_else(|| panic!("no tensor {name}")).0
    }

    pub fn dims(&self, name: &str) -> &[usize] {
        &self.tensors[name].1
    }

    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    pub fn has(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    pub fn points(&self, name: &str) -> Vec<[f64; 3]> {
        self.get(name).as_chunks::<3>().0.to_vec()
    }

    pub fn triple(&self, name: &str) -> [f64; 3] {
        self.get(name).try_into().unwrap()
    }

    pub fn tensor(&self, name: &str) -> Tensor {
        Tensor::from_vec(self.get(name).to_vec(), self.dims(name))
    }

    /// A setting, kept as a tensor of one number or among the metadata.
    pub fn number(&self, name: &str) -> f64 {
        match self.tensors.get(name) {
            Some((values, _)) => values[0],
            None => self.setting(name).as_f64().unwrap(),
        }
    }

    pub fn setting(&self, name: &str) -> &Value {
        self.metadata.get(name).unwrap_or_else(|| panic!("no setting {name}"))
    }

    /// Nodes per axis of a grid `[.., x, y, z]`.
    pub fn nodes(&self, name: &str) -> [usize; 3] {
        let dims = self.dims(name);
        dims[dims.len() - 3..].try_into().unwrap()
    }

    /// A grid `[.., channels, x, y, z]` with channels last, `[x, y, z, channels]`.
    pub fn grid(&self, name: &str) -> Tensor {
        let ([x, y, z], values) = (self.nodes(name), self.get(name));
        Tensor::from_vec(turned(values, values.len() / (x * y * z)), [x, y, z, values.len() / (x * y * z)])
    }
}

/// Rows and columns swapped, of `rows` rows.
pub fn turned(values: &[f64], rows: usize) -> Vec<f64> {
    let columns = values.len() / rows;
    (0..values.len()).map(|i| values[i % rows * columns + i / rows]).collect()
}

/// A grid `[x, y, z, channels]` with channels first.
pub fn channels_first(grid: &Tensor) -> Vec<f64> {
    let nodes: usize = grid.dims()[..3].iter().product();
    turned(&grid.to_vec().unwrap(), nodes)
}

/// Where a test runs, and what it may differ by: values, and gradients in the Euclidean norm.
#[derive(Clone)]
pub struct Place {
    pub name: &'static str,
    pub dtype: DType,
    pub device: Device,
    pub value: f64,
    pub gradient: f64,
}

impl Place {
    /// A leaf of this place.
    pub fn leaf(&self, tape: &Tape, value: &Tensor) -> Var {
        tape.leaf(self.tensor(value))
    }

    pub fn constant(&self, tape: &Tape, value: &Tensor) -> Var {
        tape.constant(self.tensor(value))
    }

    pub fn tensor(&self, value: &Tensor) -> Tensor {
        value.cast(self.dtype).unwrap().to_device(&self.device).unwrap()
    }

    /// The same place with other tolerances: values and gradients in `f64`, then in `f32`.
    pub fn allowing(&self, double: [f64; 2], single: [f64; 2]) -> Self {
        let [value, gradient] = if self.dtype == DType::F64 { double } else { single };
        Self { value, gradient, ..self.clone() }
    }

    /// Largest difference, in units of the largest number if that is above 1.
    #[track_caller]
    pub fn close(&self, what: &str, found: &[f64], wanted: &[f64]) {
        assert_eq!(found.len(), wanted.len(), "{} on {}", what, self.name);
        let scale = wanted.iter().fold(1.0f64, |most, x| most.max(x.abs()));
        let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs());
        let worst = worst.fold(0.0, |most: f64, x| if x > most || x.is_nan() { x } else { most }) / scale;
        assert!(worst <= self.value, "{what} on {}: differs by {worst:.3e}, allowed {:.1e}", self.name, self.value);
    }

    /// As [`Place::close`] for grids whose empty nodes hold a number far from all others: the same nodes must be empty.
    #[track_caller]
    pub fn close_grid(&self, what: &str, found: &[f64], wanted: &[f64], empty: f64) {
        let filled = |values: &[f64]| values.iter().map(|&x| if x == empty { 0.0 } else { x }).collect::<Vec<_>>();
        assert!(found.iter().zip(wanted).all(|(a, b)| (*a == empty) == (*b == empty)), "{what} on {}", self.name);
        self.close(what, &filled(found), &filled(wanted));
    }

    #[track_caller]
    pub fn close_var(&self, what: &str, found: &Var, wanted: &[f64]) {
        self.close(what, &found.value().unwrap().to_vec().unwrap(), wanted);
    }

    /// Difference in the Euclidean norm, relative to what is wanted; zeros up to rounding are measured by rounding.
    #[track_caller]
    pub fn close_gradient(&self, what: &str, found: &[f64], wanted: &[f64]) {
        assert_eq!(found.len(), wanted.len(), "{} on {}", what, self.name);
        let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
        let apart = norm(&mut found.iter().zip(wanted).map(|(a, b)| a - b));
        let size = norm(&mut wanted.iter().copied());
        let rounding = if self.dtype == DType::F64 { 1e-15 } else { 1e-9 };
        let allowed = if size < 1e-15 { rounding } else { self.gradient * size };
        assert!(apart <= allowed, "{what} on {}: off by {apart:.3e} of {size:.3e}, allowed {allowed:.1e}", self.name);
    }
}

/// `f64` and `f32` on the CPU, `f32` on a GPU where there is one (in CI there must be one).
pub fn places() -> Vec<Place> {
    let place = |name, dtype, device| {
        let (value, gradient) = if dtype == DType::F64 { (1e-9, 1e-9) } else { (1e-4, 1e-3) };
        Place { name, dtype, device, value, gradient }
    };
    let mut all = vec![place("f64", DType::F64, Device::Cpu), place("f32", DType::F32, Device::Cpu)];
    // one adapter for all tests
    static OPENED: OnceLock<Result<Device>> = OnceLock::new();
    match OPENED.get_or_init(Device::gpu) {
        Ok(device) => all.push(place("GPU", DType::F32, device.clone())),
        Err(error) if std::env::var("CI").is_ok_and(|ci| ci == "true") => {
            panic!("the GPU must be tested here: {error}")
        }
        Err(error) => eprintln!("no GPU: {error}"),
    }
    all
}

/// `Σ y · cotangent`.
pub fn contract(y: &Var, cotangent: &Tensor) -> Var {
    let cotangent = cotangent.cast(y.dtype()).unwrap().to_device(&y.device()).unwrap();
    (y * &y.tape().constant(cotangent).reshape(y.shape())).sum_all()
}
