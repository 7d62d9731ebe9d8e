//! Operands that a shape rule has accepted.

use std::fmt;
use std::ops::Deref;

use crate::tape::Op;
use crate::{DType, Error, ErrorKind, Result, Spec, Tensor};

/// Operands that an op's shape rule has accepted: what a forward pass is given.
///
/// Reads like a slice of tensors. Only [`Op::forward`] and the tape make one, after [`Op::infer`] agreed, so that no
/// forward pass of an op can be reached without its shape rule.
///
/// ```compile_fail
/// use gradreel::{Op, Tensor, ops};
///
/// let short = Tensor::from_vec(vec![1.0f64], [1]);
/// // no shape rule has seen these tensors
/// ops::registry()[0].cases()[0].op.forward_cpu(&[short]);
/// ```
#[derive(Clone, Copy)]
pub struct Operands<'a>(&'a [Tensor]);

impl<'a> Operands<'a> {
    /// Tensors whose specs the op's shape rule has accepted.
    pub(super) fn accepted(tensors: &'a [Tensor]) -> Self {
        Self(tensors)
    }

    /// Asks the op's shape rule about some tensors.
    pub(super) fn check<O: Op + ?Sized>(op: &O, tensors: &'a [Tensor]) -> Result<Self> {
        let specs: Vec<Spec> = tensors.iter().map(Tensor::spec).collect();
        infer(op, &specs)?;
        Ok(Self(tensors))
    }

    /// All of them, when there are `N`.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct First;
    /// # impl Op for First {
    /// #     fn name(&self) -> &str { "first" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    ///     let [x, _y] = inputs.array();
    ///     Ok(x.clone().into())
    /// }
    /// #     fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> { Ok(vec![Some(cx.gradient().clone()), None]) }
    /// # }
    /// # let tape = Tape::new();
    /// # let [x, y] = [1.0, 2.0].map(|x| tape.constant(Tensor::from_vec(vec![x], [1])));
    /// # assert_eq!(x.apply(First, &[&y])?.item()?, 1.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When there are not `N`: the shape rule should have refused them.
    #[track_caller]
    pub fn array<const N: usize>(self) -> &'a [Tensor; N] {
        let count = self.0.len();
        self.0.try_into().unwrap_or_else(|_| panic!("a shape rule accepted {count} operands where {N} are read"))
    }

    /// All of them.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct First;
    /// # impl Op for First {
    /// #     fn name(&self) -> &str { "first" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    ///     let operands: &[Tensor] = inputs.all();
    ///     Ok(operands[0].clone().into())
    /// }
    /// #     fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> { Ok(vec![Some(cx.gradient().clone()), None]) }
    /// # }
    /// # let tape = Tape::new();
    /// # let [x, y] = [1.0, 2.0].map(|x| tape.constant(Tensor::from_vec(vec![x], [1])));
    /// # assert_eq!(x.apply(First, &[&y])?.item()?, 1.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn all(self) -> &'a [Tensor] {
        self.0
    }
}

impl Deref for Operands<'_> {
    type Target = [Tensor];

    fn deref(&self) -> &[Tensor] {
        self.0
    }
}

impl fmt::Debug for Operands<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0).finish()
    }
}

/// The op's shape rule; where it refuses operands of different float types, the error says how to cast them.
pub(super) fn infer<O: Op + ?Sized>(op: &O, specs: &[Spec]) -> Result<Spec> {
    op.infer(specs).map_err(|error| match mixed(specs) {
        Some((number, dtype)) if error.kind() == ErrorKind::Shape => explain(op.name(), specs, number, dtype),
        _ => error,
    })
}

/// The first operand whose float type is not that of the first float operand, and the wider of both types.
fn mixed(specs: &[Spec]) -> Option<(usize, DType)> {
    let mut floats = specs.iter().enumerate().filter(|(_, x)| x.dtype != DType::U32);
    let (first, one) = floats.next()?;
    let (other, two) = floats.find(|(_, x)| x.dtype != one.dtype)?;
    // never to a type of storage: ops do not compute in it
    Some(if one.dtype.size() < two.dtype.size() { (first, two.dtype) } else { (other, one.dtype) })
}

fn explain(op: &str, specs: &[Spec], number: usize, dtype: DType) -> Error {
    Error::new(ErrorKind::Shape, format!("{op}: the operands are of different dtypes"))
        .found(format!("{specs:?}"))
        .wanted("operands of one dtype, all f32 or all f64")
        .fix(format!("cast operand {number} to {dtype}, with .cast(DType::{dtype:?})"))
}
