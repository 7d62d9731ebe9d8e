//! Parameters as variables of a tape.

use std::collections::BTreeMap;

use crate::optim::Params;
use crate::optim::params::{join, missing};
use crate::{Gradients, Result, Tape, Tensor, Var};

/// The parameters as variables of one tape.
pub struct Bound {
    vars: BTreeMap<String, Var>,
}

impl Params {
    /// Variables of a tape for all tensors: leaves, or constants where frozen.
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
    /// # Errors
    /// [`crate::ErrorKind::Input`] when there is none.
    pub fn get(&self, path: &str) -> Result<&Var> {
        self.vars.get(path).ok_or_else(|| missing(path, self.vars.keys()))
    }

    /// The variables under a prefix, by the rest of their paths: what a part of a model needs to know.
    pub fn scope(&self, prefix: impl Into<String>) -> BoundScope<'_> {
        BoundScope { bound: self, prefix: prefix.into() }
    }

    /// The gradients of all that are not frozen, by path.
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
#[derive(Clone)]
pub struct BoundScope<'b> {
    bound: &'b Bound,
    prefix: String,
}

impl<'b> BoundScope<'b> {
    /// The variable at the rest of a path.
    ///
    /// # Errors
    /// [`crate::ErrorKind::Input`] when there is none.
    pub fn get(&self, path: &str) -> Result<&'b Var> {
        self.bound.get(&join(&self.prefix, path))
    }

    /// The variables under a longer prefix.
    #[must_use]
    pub fn scope(&self, prefix: &str) -> Self {
        Self { bound: self.bound, prefix: join(&self.prefix, prefix) }
    }
}
