//! A value on a tape.

use std::fmt;
use std::rc::Rc;

use crate::tape::{Op, Tape};
use crate::{DType, Device, Result, Shape, Spec, Tensor};

/// A tensor together with its place on a tape. Cloning it copies two pointers.
///
/// Arithmetic (`+ - * /` among variables and with `f64`) and the methods of [`crate::ops`] make new variables. A wrong shape
/// panics at the line of the call.
///
/// ```
/// # use gradreel::{Tape, Tensor};
/// # let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
/// let y = &(&x * 3.0) + 1.0;
/// assert_eq!(y.value()?.slice::<f64>(), [4.0, 7.0]);
/// # Ok::<(), gradreel::Error>(())
/// ```
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
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// assert_eq!(x.tape().len(), 1);
    /// ```
    pub fn tape(&self) -> &Tape {
        &self.tape
    }

    /// Its place on the tape; `None` for a constant.
    pub(super) fn node(&self) -> Option<usize> {
        self.node.map(|node| node as usize)
    }

    /// Whether a leaf is behind it.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// assert!(x.exp().is_differentiable());
    /// assert!(!x.detach().is_differentiable());
    /// ```
    pub fn is_differentiable(&self) -> bool {
        self.node.is_some()
    }

    /// Its tensor.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// assert_eq!(x.value()?.slice::<f64>(), [3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
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
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// assert_eq!(x.item()?, 3.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Var::value`] and [`Tensor::item`].
    pub fn item(&self) -> Result<f64> {
        self.value()?.item()
    }

    /// Sizes per axis.
    ///
    /// ```
    /// # use gradreel::{DType, Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(x.shape().rank(), 2);
    /// ```
    pub fn shape(&self) -> &Shape {
        self.value.shape()
    }

    /// Sizes per axis as a slice.
    ///
    /// ```
    /// # use gradreel::{DType, Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(x.dims(), [2, 3]);
    /// ```
    pub fn dims(&self) -> &[usize] {
        self.value.dims()
    }

    /// Number of elements.
    ///
    /// ```
    /// # use gradreel::{DType, Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(x.len(), 6);
    /// ```
    pub fn len(&self) -> usize {
        self.value.len()
    }

    /// Whether there are no elements.
    ///
    /// ```
    /// # use gradreel::{DType, Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::zeros([2, 3], DType::F32));
    /// assert!(!x.is_empty());
    /// ```
    pub fn is_empty(&self) -> bool {
        self.value.is_empty()
    }

    /// Element type.
    ///
    /// ```
    /// # use gradreel::{DType, Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(x.dtype(), DType::F32);
    /// ```
    pub fn dtype(&self) -> DType {
        self.value.dtype()
    }

    /// Shape and dtype.
    ///
    /// ```
    /// # use gradreel::{DType, Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(x.spec().dtype, DType::F32);
    /// ```
    pub fn spec(&self) -> Spec {
        self.value.spec()
    }

    /// Where it lives.
    ///
    /// ```
    /// # use gradreel::{DType, Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(x.device(), gradreel::Device::Cpu);
    /// ```
    pub fn device(&self) -> Device {
        self.value.device()
    }

    /// The same value as a constant: gradients stop here.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// let y = &x.detach() * &x; // only the second factor counts
    /// assert_eq!(y.backward()?.wrt(&x)?.item()?, 3.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn detach(&self) -> Self {
        self.tape.constant(self.value.clone())
    }

    /// Applies an op of anybody's making to this variable and others.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Map, scalar::Program};
    /// let square = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// assert_eq!(x.apply(square, &[])?.item()?, 9.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
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
