//! Tests of the chain as a whole, on films and models that are made here.

mod chain;
mod pictures;
pub(super) mod scene;
