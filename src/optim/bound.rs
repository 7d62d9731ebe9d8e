//! Parameters as variables of a tape.

use std::collections::BTreeMap;

use crate::optim::Params;
use crate::optim::params::{join, missing};
use crate::{Gradients, Result, Tape, Tensor, Var};

/// The parameters as variables of one tape.
///
/// ```
/// use gradreel::optim::Params;
/// use gradreel::{Tape, Tensor};
/// let mut params = Params::new();
/// params.set("net.weight", Tensor::from_vec(vec![3.0], [1]));
/// let tape = Tape::new();
/// let bound = params.bind(&tape);
/// let loss = bound.get("net.weight")?.square();
/// let gradients = bound.gradients(&loss.backward()?)?;
/// assert_eq!(gradients["net.weight"].item()?, 6.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
pub struct Bound {
    vars: BTreeMap<String, Var>,
}

impl Params {
    /// Variables of a tape for all tensors: leaves, or constants where frozen.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::from_vec(vec![3.0], [1]));
    /// let tape = Tape::new();
    /// let bound = params.bind(&tape);
    /// assert!(bound.get("net.weight")?.is_differentiable());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    pub fn bind(&self, tape: &Tape) -> Bound {
        let bound = |(path, value): (&str, &Tensor)| {
            let var = if self.is_frozen(path) { tape.constant(value.clone()) } else { tape.leaf(value.clone()) };
            (path.to_owned(), var)
        };
        Bound { vars: self.iter().map(bound).collect() }
    }
}

impl Bound {
    /// The variable at a path.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::from_vec(vec![3.0], [1]));
    /// let tape = Tape::new();
    /// let bound = params.bind(&tape);
    /// assert_eq!(bound.get("net.weight")?.item()?, 3.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::ErrorKind::Input`] when there is none.
    pub fn get(&self, path: &str) -> Result<&Var> {
        self.vars.get(path).ok_or_else(|| missing(path, self.vars.keys()))
    }

    /// The variables under a prefix, by the rest of their paths: what a part of a model needs to know.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::from_vec(vec![3.0], [1]));
    /// let tape = Tape::new();
    /// let bound = params.bind(&tape);
    /// assert_eq!(bound.scope("net").get("weight")?.item()?, 3.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn scope(&self, prefix: impl Into<String>) -> BoundScope<'_> {
        BoundScope { bound: self, prefix: prefix.into() }
    }

    /// The gradients of all that are not frozen, by path.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::from_vec(vec![3.0], [1]));
    /// let tape = Tape::new();
    /// let bound = params.bind(&tape);
    /// let loss = bound.get("net.weight")?.square();
    /// assert_eq!(bound.gradients(&loss.backward()?)?["net.weight"].item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::ErrorKind::NoGradient`] when the loss does not depend on one of them.
    pub fn gradients(&self, gradients: &Gradients) -> Result<BTreeMap<String, Tensor>> {
        let live = self.vars.iter().filter(|(_, var)| var.is_differentiable());
        live.map(|(path, var)| {
            let gradient = gradients.wrt(var).map_err(|e| e.at(path).fix("freeze it if that is intended"))?;
            Ok((path.clone(), gradient.clone()))
        })
        .collect()
    }
}

/// The variables under a prefix, by the rest of their paths.
///
/// ```
/// use gradreel::optim::Params;
/// use gradreel::{Tape, Tensor};
/// let mut params = Params::new();
/// params.set("net.weight", Tensor::from_vec(vec![3.0], [1]));
/// let tape = Tape::new();
/// let bound = params.bind(&tape);
/// let net = bound.scope("net");
/// assert_eq!(net.get("weight")?.item()?, 3.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Clone)]
pub struct BoundScope<'b> {
    bound: &'b Bound,
    prefix: String,
}

impl<'b> BoundScope<'b> {
    /// The variable at the rest of a path.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::from_vec(vec![3.0], [1]));
    /// let tape = Tape::new();
    /// let bound = params.bind(&tape);
    /// assert!(bound.scope("net").get("bias").is_err());
    /// ```
    ///
    /// # Errors
    /// [`crate::ErrorKind::Input`] when there is none.
    pub fn get(&self, path: &str) -> Result<&'b Var> {
        self.bound.get(&join(&self.prefix, path))
    }

    /// The variables under a longer prefix.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{Tape, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.first.weight", Tensor::from_vec(vec![3.0], [1]));
    /// let tape = Tape::new();
    /// let bound = params.bind(&tape);
    /// assert_eq!(bound.scope("net").scope("first").get("weight")?.item()?, 3.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn scope(&self, prefix: &str) -> Self {
        Self { bound: self.bound, prefix: join(&self.prefix, prefix) }
    }
}
