//! Scopes: hierarchical paths into a store of weights.

use std::cell::RefCell;
use std::fmt::Display;

use gradreel::optim::{Bound, Params};
use gradreel::{DType, Error, ErrorKind, Key, Result, Shape, Tape, Tensor, Var};

/// Initialisation of a weight that is not loaded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Init {
    /// All 0.
    Zeros,
    /// All 1.
    Ones,
    /// All this number.
    Constant(f64),
    /// Uniform in ±1/√n, with n the fan-in (He et al. 2015 with a = √5).
    FanIn(usize),
    /// Normal with this standard deviation.
    Normal(f64),
}

/// A source of weights, by dotted path.
pub trait Weights {
    /// The weight at a path.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when there is no such weight; [`ErrorKind::Shape`] when it has another shape.
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var>;
}

impl Weights for Bound {
    fn weight(&self, path: &str, shape: &Shape, _: Init) -> Result<Var> {
        let var = self.get(path)?;
        if var.shape() == shape {
            return Ok(var.clone());
        }
        Err(Error::new(ErrorKind::Shape, "a weight has another shape than its layer")
            .at(path)
            .found(var.shape())
            .wanted(shape)
            .fix("load the checkpoint that belongs to this configuration"))
    }
}

/// A location in a tree of weights.
#[derive(Clone)]
pub struct Scope<'a> {
    weights: &'a dyn Weights,
    path: String,
    recomputed: bool,
}

impl<'a> Scope<'a> {
    /// The root of a source.
    pub fn root(weights: &'a dyn Weights) -> Self {
        Self { weights, path: String::new(), recomputed: false }
    }

    /// The scope one or more names deeper.
    #[must_use]
    pub fn at(&self, name: impl Display) -> Self {
        let path = if self.path.is_empty() { name.to_string() } else { format!("{}.{name}", self.path) };
        Self { weights: self.weights, path, recomputed: self.recomputed }
    }

    /// The same scope, with segments built there recomputed in the backward pass ([`super::Segment`]).
    #[must_use]
    pub fn recomputed(&self) -> Self {
        Self { recomputed: true, ..self.clone() }
    }

    /// Whether segments built here are recomputed.
    pub(crate) fn is_recomputed(&self) -> bool {
        self.recomputed
    }

    /// The source of weights.
    pub(crate) fn weights(&self) -> &'a dyn Weights {
        self.weights
    }

    /// The path of this scope; empty at the root.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// A weight of this scope.
    ///
    /// # Errors
    /// As [`Weights::weight`].
    pub fn weight(&self, name: &str, shape: impl Into<Shape>, init: Init) -> Result<Var> {
        self.weights.weight(&self.at(name).path, &shape.into(), init)
    }
}

/// Initial parameters for all weights that `build` requests. A weight depends only on the key and its path, not on the
/// order in which layers are built.
///
/// # Errors
/// Propagates errors of `build`.
pub fn initialise<M>(key: Key, dtype: DType, build: impl FnOnce(&Scope<'_>) -> Result<M>) -> Result<Params> {
    let fresh = Fresh { tape: Tape::new(), key, dtype, made: RefCell::default() };
    build(&Scope::root(&fresh))?;
    Ok(fresh.made.into_inner())
}

/// Paths and shapes of all weights that `build` requests, in order, without creating them.
///
/// # Errors
/// Propagates errors of `build`.
pub fn listing<M>(build: impl FnOnce(&Scope<'_>) -> Result<M>) -> Result<Vec<(String, Shape)>> {
    let list = Listing { tape: Tape::new(), rows: RefCell::default() };
    build(&Scope::root(&list))?;
    Ok(list.rows.into_inner())
}

struct Fresh {
    tape: Tape,
    key: Key,
    dtype: DType,
    made: RefCell<Params>,
}

impl Weights for Fresh {
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
        let key = path.bytes().fold(self.key, |key, byte| key.fold(u64::from(byte)));
        let value = match init {
            Init::Zeros => Tensor::zeros(shape, self.dtype),
            Init::Ones => Tensor::full(1.0, shape, self.dtype),
            Init::Constant(value) => Tensor::full(value, shape, self.dtype),
            Init::FanIn(inputs) => {
                let bound = 1.0 / (inputs.max(1) as f64).sqrt();
                let values: Vec<f64> = key.uniform(shape.len()).map(|u| (2.0 * u - 1.0) * bound).collect();
                Tensor::from_vec(values, shape).cast(self.dtype)?
            }
            Init::Normal(deviation) => {
                let values: Vec<f64> = key.normal(shape.len()).map(|z| z * deviation).collect();
                Tensor::from_vec(values, shape).cast(self.dtype)?
            }
        };
        self.made.borrow_mut().set(path, value.clone());
        Ok(self.tape.constant(value))
    }
}

struct Listing {
    tape: Tape,
    rows: RefCell<Vec<(String, Shape)>>,
}

impl Weights for Listing {
    fn weight(&self, path: &str, shape: &Shape, _: Init) -> Result<Var> {
        self.rows.borrow_mut().push((path.to_owned(), shape.clone()));
        Ok(self.tape.constant(Tensor::zeros([0], DType::F32)))
    }
}
