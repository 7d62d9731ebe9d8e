//! Parameters by dotted path: stored, bound to a tape, frozen by prefix.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Error, ErrorKind, Gradients, Result, Tape, Tensor, Var};

/// Tensors by dotted path, in the order of their paths.
///
/// ```
/// use gradreel::optim::{Adam, Params};
/// use gradreel::{Tape, Tensor};
///
/// let mut params = Params::new();
/// params.set("line.slope", Tensor::from_vec(vec![0.0f32], [1]));
/// let mut adam = Adam::new(0.1);
/// for _ in 0..200 {
///     let tape = Tape::new();
///     let bound = params.bind(&tape);
///     let loss = (bound.get("line.slope")? - 3.0).square().sum_all();
///     adam.step(&mut params, &bound.gradients(&loss.backward()?)?)?;
/// }
/// assert!((params.get("line.slope")?.item()? - 3.0).abs() < 1e-2);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Params {
    tensors: BTreeMap<String, Tensor>,
    frozen: BTreeSet<String>,
}

impl Params {
    /// An empty store.
    pub fn new() -> Self {
        Self::default()
    }

    /// Stores a tensor under a path, replacing what was there.
    pub fn set(&mut self, path: impl Into<String>, value: Tensor) {
        self.tensors.insert(path.into(), value);
    }

    /// The tensor at a path.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when there is none.
    pub fn get(&self, path: &str) -> Result<&Tensor> {
        self.tensors.get(path).ok_or_else(|| missing(path, self.tensors.keys()))
    }

    /// Every path with its tensor.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.tensors.iter().map(|(path, value)| (path.as_str(), value))
    }

    /// Number of scalars in all tensors.
    pub fn count(&self) -> usize {
        self.tensors.values().map(Tensor::len).sum()
    }

    /// Treats every path with this prefix as constant from now on.
    pub fn freeze(&mut self, prefix: impl Into<String>) {
        self.frozen.insert(prefix.into());
    }

    /// Undoes [`Params::freeze`] of the same prefix.
    pub fn thaw(&mut self, prefix: &str) {
        self.frozen.remove(prefix);
    }

    /// Variables of a tape for all tensors: leaves, or constants where frozen.
    #[track_caller]
    pub fn bind(&self, tape: &Tape) -> Bound {
        let bound = |(path, value): (&String, &Tensor)| {
            let frozen = self.frozen.iter().any(|prefix| path.starts_with(prefix.as_str()));
            let var = if frozen { tape.constant(value.clone()) } else { tape.leaf(value.clone()) };
            (path.clone(), var)
        };
        Bound { vars: self.tensors.iter().map(bound).collect() }
    }
}

impl FromIterator<(String, Tensor)> for Params {
    fn from_iter<I: IntoIterator<Item = (String, Tensor)>>(tensors: I) -> Self {
        Self { tensors: tensors.into_iter().collect(), frozen: BTreeSet::new() }
    }
}

/// The parameters as variables of one tape.
pub struct Bound {
    vars: BTreeMap<String, Var>,
}

impl Bound {
    /// The variable at a path.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when there is none.
    pub fn get(&self, path: &str) -> Result<&Var> {
        self.vars.get(path).ok_or_else(|| missing(path, self.vars.keys()))
    }

    /// The gradients of all that are not frozen, by path.
    ///
    /// # Errors
    /// [`ErrorKind::NoGradient`] when the loss does not depend on one of them.
    pub fn gradients(&self, gradients: &Gradients) -> Result<BTreeMap<String, Tensor>> {
        let live = self.vars.iter().filter(|(_, var)| var.is_differentiable());
        live.map(|(path, var)| {
            let gradient = gradients.wrt(var).map_err(|e| e.at(path).fix("freeze it if that is intended"))?;
            Ok((path.clone(), gradient.clone()))
        })
        .collect()
    }
}

fn missing<'a>(path: &str, known: impl Iterator<Item = &'a String>) -> Error {
    let known: Vec<_> = known.take(8).map(String::as_str).collect();
    Error::new(ErrorKind::Input, "no parameter at this path").at(path).found(format!("paths such as {known:?}"))
}
