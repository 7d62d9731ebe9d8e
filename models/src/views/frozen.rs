//! Read-only weights.

use gradreel::{Result, Shape, Var};

use crate::layers::{Init, Weights};

/// The weights of another source without gradients, so that nothing is recorded for them.
pub(super) struct Frozen<'a>(pub &'a dyn Weights);

impl Weights for Frozen<'_> {
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
        Ok(self.0.weight(path, shape, init)?.detach())
    }
}
