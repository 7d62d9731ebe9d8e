//! Sources of a model's weights during training.

use gradreel::optim::Params;
use gradreel::{DType, Result, Shape, Tape, Tensor, Var};

use super::Plan;
use crate::layers::{Init, Weights};
use crate::views::FileWeights;

/// Trained weights from one source, all others from the file.
pub(super) struct Source<'a> {
    pub trained: &'a dyn Weights,
    pub plan: &'a Plan,
    pub frozen: FileWeights,
}

impl Weights for Source<'_> {
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
        match self.plan.trains(path) {
            true => self.trained.weight(path, shape, init),
            false => self.frozen.weight(path, shape, init),
        }
    }
}

/// The trained weights as constants.
pub(super) struct Fixed<'a> {
    pub params: &'a Params,
    pub tape: &'a Tape,
}

impl Weights for Fixed<'_> {
    fn weight(&self, path: &str, _: &Shape, _: Init) -> Result<Var> {
        Ok(self.tape.constant(self.params.get(path)?.clone()))
    }
}

/// Requests some weights from another source, and no others.
pub(super) struct Picked<'a> {
    pub inner: &'a dyn Weights,
    pub tape: Tape,
    pub fresh: &'a [String],
}

impl Weights for Picked<'_> {
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
        match self.fresh.iter().any(|fresh| fresh == path) {
            true => self.inner.weight(path, shape, init),
            false => Ok(self.tape.constant(Tensor::zeros([0], DType::F32))),
        }
    }
}
