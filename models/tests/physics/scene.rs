//! Small bodies and vector files for the tests.

use std::collections::HashMap;
use std::path::Path;

use gradreel_models::physics::{Collider, Contact, Number, Values, World};
use safetensors::{Dtype, SafeTensors};
use serde_json::Value;

use crate::find;

const OWN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors");

/// A file of vectors: this project's, or one of the same name in the folder that `GRADREEL_VECTORS` names.
pub struct Vectors {
    tensors: HashMap<String, Vec<f64>>,
    metadata: HashMap<String, Value>,
}

impl Vectors {
    pub fn load(name: &str) -> Self {
        let bytes = std::fs::read(find::path(Path::new(OWN), find::DYNAMICS, &format!("{name}.safetensors"))).unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let metadata = header.metadata().clone().unwrap_or_default();
        let metadata = metadata.into_iter().map(|(key, text)| (key, serde_json::from_str(&text).unwrap())).collect();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let tensors = file.tensors().into_iter().map(|(name, view)| {
            let values: Vec<f64> = match view.dtype() {
                Dtype::F64 => view.data().as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
                Dtype::F32 => view.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b).into()).collect(),
                other => panic!("{name}: {other:?}"),
            };
            (name, values)
        });
        Self { tensors: tensors.collect(), metadata }
    }

    /// The names of all files of vectors that begin so, but for those with a test of their own.
    pub fn others(prefix: &str, known: &[&str]) -> Vec<String> {
        let names = find::names(Path::new(OWN), find::DYNAMICS, prefix);
        names.into_iter().filter(|name| !known.contains(&name.as_str())).collect()
    }

    pub fn get(&self, name: &str) -> &[f64] {
        self.tensors.get(name).unwrap_or_else(|| panic!("no tensor {name}"))
    }

    pub fn has(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    /// The material among the metadata.
    pub fn material(&self) -> Option<String> {
        self.metadata.get("material").map(|name| name.as_str().unwrap().to_owned())
    }

    /// Whether there is a number of this name, as a tensor or among the metadata.
    pub fn has_number(&self, name: &str) -> bool {
        self.tensors.contains_key(name) || self.metadata.contains_key(name)
    }

    /// A number, kept as a tensor or among the metadata.
    pub fn scalar(&self, name: &str) -> f64 {
        self.tensors.get(name).map_or_else(|| self.number(name), |values| values[0])
    }

    pub fn vectors<T: Number>(&self, name: &str) -> Vec<[T; 3]> {
        self.get(name).as_chunks::<3>().0.iter().map(|v| v.map(T::from_f64)).collect()
    }

    pub fn matrices<T: Number>(&self, name: &str) -> Vec<[[T; 3]; 3]> {
        self.vectors(name).as_chunks().0.to_vec()
    }

    pub fn number(&self, name: &str) -> f64 {
        self.metadata[name].as_f64().unwrap()
    }

    pub fn list(&self, name: &str) -> Vec<f64> {
        self.metadata[name].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    }

    pub fn world(&self) -> World {
        let triple = |value: &Value| -> [f64; 3] { std::array::from_fn(|i| value[i].as_f64().unwrap()) };
        let contact = |value: &Value| {
            [Contact::Sticky, Contact::Slip, Contact::Separate][usize::try_from(value.as_u64().unwrap()).unwrap()]
        };
        let colliders = self.metadata["colliders"].as_array().unwrap().iter().map(|c| match c[0].as_str().unwrap() {
            "plane" => Collider::plane(triple(&c[1]), triple(&c[2]), contact(&c[3])),
            _ => Collider::cylinder(triple(&c[1]), triple(&c[2]), c[3].as_f64().unwrap(), contact(&c[4])),
        });
        World {
            colliders: colliders.collect(),
            gravity: triple(&self.metadata["gravity"]),
            particle_volume: self.number("p_vol"),
            ..World::new(self.number("dx"))
        }
    }

    /// Young's modulus and Poisson's ratio of every particle, from Lamé's parameters.
    pub fn young_poisson<T: Number>(&self) -> Vec<Values<T>> {
        let pairs = || self.get("mu").iter().zip(self.get("lam"));
        let young = pairs().map(|(mu, lam)| mu * (3.0 * lam + 2.0 * mu) / (lam + mu)).map(T::from_f64).collect();
        let poisson = pairs().map(|(mu, lam)| lam / (2.0 * (lam + mu))).map(T::from_f64).collect();
        vec![Values::Each(young), Values::Each(poisson)]
    }

    pub fn density<T: Number>(&self) -> Values<T> {
        Values::Each(self.get("rho").iter().map(|&rho| T::from_f64(rho)).collect())
    }

    /// Gradients with respect to `(mu, lam)` from those with respect to Young's modulus and Poisson's ratio.
    pub fn to_lame<T: Number>(&self, young: &[T], poisson: &[T]) -> [Vec<f64>; 2] {
        let each = |f: fn(f64, f64) -> (f64, f64)| {
            let pairs = self.get("mu").iter().zip(self.get("lam")).zip(young.iter().zip(poisson));
            let chained = pairs.map(|((&mu, &lam), (on_young, on_poisson))| {
                let (by_young, by_poisson) = f(mu, lam);
                on_young.to_f64() * by_young + on_poisson.to_f64() * by_poisson
            });
            chained.collect()
        };
        [
            each(|mu, lam| {
                let sum = (lam + mu) * (lam + mu);
                ((3.0 * lam * lam + 4.0 * lam * mu + 2.0 * mu * mu) / sum, -lam / (2.0 * sum))
            }),
            each(|mu, lam| {
                let sum = (lam + mu) * (lam + mu);
                (mu * mu / sum, mu / (2.0 * sum))
            }),
        ]
    }
}

/// A cube of particles, `side` per edge, half a cell apart, its lowest corner near `corner`; slightly irregular.
pub fn cube(side: usize, dx: f64, corner: [f64; 3]) -> Vec<[f64; 3]> {
    let wobble = |i: usize| 0.1 * (1.7 * i as f64 + 0.3).sin();
    let mut positions = Vec::new();
    for i in 0..side * side * side {
        let index = [i / (side * side), i / side % side, i % side];
        positions.push(std::array::from_fn(|a| corner[a] + dx / 2.0 * (index[a] as f64 + 0.5 + wobble(3 * i + a))));
    }
    positions
}

/// Largest difference, in units of the largest number if that is above 1.
#[track_caller]
pub fn close<T: Number>(what: &str, found: &[T], wanted: &[f64], tolerance: f64) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    let scale = wanted.iter().fold(1.0f64, |most, x| most.max(x.abs()));
    let worst = found.iter().zip(wanted).map(|(a, b)| (a.to_f64() - b).abs());
    let worst = worst.fold(0.0, |most: f64, x| if x > most || x.is_nan() { x } else { most }) / scale;
    assert!(worst <= tolerance, "{what}: differs by {worst:.3e}, allowed {tolerance:.1e}");
}

/// Difference in the Euclidean norm, relative to what is wanted.
#[track_caller]
pub fn close_norm<T: Number>(what: &str, found: &[T], wanted: &[f64], tolerance: f64) {
    assert_eq!(found.len(), wanted.len(), "{what}");
    let square: f64 = found.iter().zip(wanted).map(|(a, b)| (a.to_f64() - b).powi(2)).sum();
    within::<T>(what, square.sqrt(), wanted, tolerance);
}

/// A distance is a share of the norm of what is wanted at most; zeros up to rounding are measured by rounding.
#[track_caller]
fn within<T>(what: &str, distance: f64, wanted: &[f64], tolerance: f64) {
    let norm = wanted.iter().map(|b| b * b).sum::<f64>().sqrt();
    let rounding = if size_of::<T>() == 4 { 1e-9 } else { 1e-15 };
    // where anything is allowed, no norm matters
    let allowed = if norm < 1e-15 && tolerance.is_finite() { rounding } else { tolerance * norm.max(1e-300) };
    assert!(distance <= allowed, "{what}: off by {distance:.3e} of {norm:.3e}, allowed {allowed:.1e}");
}

/// The distance of two lists in the Euclidean norm without the worst hundredth of the entries: a few grains of sand that are
/// about to yield do so in single precision only, or do not; which, the width of the vectors decides as well.
#[track_caller]
pub fn distance_of_most<T: Number>(what: &str, found: &[T], wanted: &[f64]) -> f64 {
    assert_eq!(found.len(), wanted.len(), "{what}");
    let mut squares: Vec<f64> = found.iter().zip(wanted).map(|(a, b)| (a.to_f64() - b).powi(2)).collect();
    squares.sort_by(f64::total_cmp);
    squares[..squares.len() - squares.len() / 100].iter().sum::<f64>().sqrt()
}

/// As [`close_norm`], by [`distance_of_most`].
#[track_caller]
pub fn close_norm_of_most<T: Number>(what: &str, found: &[T], wanted: &[f64], tolerance: f64) {
    within::<T>(what, distance_of_most(what, found, wanted), wanted, tolerance);
}
