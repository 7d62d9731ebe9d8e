//! A value on a tape.

use std::fmt;
use std::rc::Rc;

use crate::tape::{Op, Tape};
use crate::{DType, Device, Result, Shape, Spec, Tensor};

/// A tensor together with its place on a tape. Cloning it copies two pointers.
///
/// Arithmetic (`+ - * /` among variables and with `f64`) and the methods of [`crate::ops`] make new variables. A wrong shape
/// panics at the line of the call.
#[derive(Clone)]
pub struct Var {
    tape: Tape,
    node: Option<u32>,
    value: Tensor,
}

impl Var {
    pub(super) fn new(tape: Tape, node: Option<usize>, value: Tensor) -> Self {
        Self { tape, node: node.map(|node| u32::try_from(node).expect("fewer than 2^32 nodes")), value }
    }

    /// The tape it lives on.
    pub fn tape(&self) -> &Tape {
        &self.tape
    }

    /// Its place on the tape; `None` for a constant.
    pub(super) fn node(&self) -> Option<usize> {
        self.node.map(|node| node as usize)
    }

    /// Whether a leaf is behind it.
    pub fn is_differentiable(&self) -> bool {
        self.node.is_some()
    }

    /// Its tensor.
    ///
    /// # Errors
    /// The tape's fault, if there was one before (see [`Tape::check`]).
    pub fn value(&self) -> Result<&Tensor> {
        self.tape.check()?;
        Ok(&self.value)
    }

    /// Its tensor, faults or not: for ops, which run before anybody has looked.
    pub(crate) fn tensor(&self) -> &Tensor {
        &self.value
    }

    pub(super) fn tensor_mut(&mut self) -> &mut Tensor {
        &mut self.value
    }

    /// Its only number.
    ///
    /// # Errors
    /// As [`Var::value`] and [`Tensor::item`].
    pub fn item(&self) -> Result<f64> {
        self.value()?.item()
    }

    /// Sizes per axis.
    pub fn shape(&self) -> &Shape {
        self.value.shape()
    }

    /// Sizes per axis as a slice.
    pub fn dims(&self) -> &[usize] {
        self.value.dims()
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.value.len()
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.value.is_empty()
    }

    /// Element type.
    pub fn dtype(&self) -> DType {
        self.value.dtype()
    }

    /// Shape and dtype.
    pub fn spec(&self) -> Spec {
        self.value.spec()
    }

    /// Where it lives.
    pub fn device(&self) -> Device {
        self.value.device()
    }

    /// The same value as a constant: gradients stop here.
    #[must_use]
    pub fn detach(&self) -> Self {
        self.tape.constant(self.value.clone())
    }

    /// Applies an op of anybody's making to this variable and others.
    ///
    /// # Errors
    /// As [`Tape::apply`].
    #[track_caller]
    pub fn apply(&self, op: impl Op, others: &[&Self]) -> Result<Self> {
        let inputs: Vec<_> = std::iter::once(self).chain(others.iter().copied()).collect();
        self.tape.apply(Rc::new(op), &inputs)
    }

    /// Applies an op of this crate behind a method that returns a plain `Var`.
    #[track_caller]
    pub(crate) fn run(op: Rc<dyn Op>, inputs: &[&Self]) -> Self {
        inputs[0].tape.apply_or_keep_fault(op, inputs)
    }
}

impl fmt::Debug for Var {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.node {
            Some(node) => write!(f, "Var({node}: {:?})", self.value),
            None => write!(f, "Var(constant: {:?})", self.value),
        }
    }
}
