//! The contract of a differentiable operation.

use std::any::Any;
use std::fmt::Debug;
use std::rc::Rc;

use crate::backend::gpu::Gpu;
use crate::tape::Var;
use crate::tape::operands::Operands;
use crate::{Device, Error, ErrorKind, Result, Spec, Tensor};

/// A differentiable operation: shape rule, forward per backend, derivative written in ops.
///
/// Ops of the crate are listed in [`crate::ops::registry`] and inherit its tests. An op of your own needs no list: implement
/// this trait, call [`Var::apply`], and check it with [`crate::gradcheck`].
///
/// ```
/// use std::rc::Rc;
/// use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
///
/// /// `y = x³`, written by hand.
/// #[derive(Debug)]
/// struct Cube;
///
/// impl Op for Cube {
///     fn name(&self) -> &str { "cube" }
///     fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
///         let [x] = Spec::exactly(self.name(), inputs)?;
///         Ok(x.clone())
///     }
///     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
///         let cubes = inputs[0].slice::<f64>().iter().map(|x| x * x * x).collect();
///         Ok(Tensor::from_vec(cubes, inputs[0].shape()).into())
///     }
///     fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
///         Ok(vec![Some(cx.gradient() * &(&cx.input(0).square() * 3.0))])
///     }
/// }
///
/// let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![2.0f64], [1]));
/// let y = x.apply(Cube, &[])?;
/// assert_eq!(y.sum_all().backward()?.wrt(&x)?.slice::<f64>(), &[12.0]);
/// # Ok::<(), gradreel::Error>(())
/// ```
pub trait Op: Debug + 'static {
    /// Its name in errors, tables and kernel files.
    fn name(&self) -> &str;

    /// Shape and dtype of the result, or why the operands do not fit: their number ([`Spec::exactly`]), shapes and dtypes.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] with what was found and wanted.
    fn infer(&self, inputs: &[Spec]) -> Result<Spec>;

    /// Computes the result on the CPU.
    ///
    /// # Errors
    /// Data, physics and unsupported dtypes; never shapes, which [`Op::infer`] has checked.
    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward>;

    /// Computes the result on a GPU. Without one of its own, the op says at the call that it has no kernel there.
    ///
    /// # Errors
    /// [`ErrorKind::Unsupported`] without a kernel; [`ErrorKind::Device`] when the device fails.
    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let _ = (gpu, inputs);
        Err(Error::new(ErrorKind::Unsupported, format!("{} has no WGSL kernel", self.name()))
            .fix("move its operands to the CPU with to_device(&Device::Cpu)"))
    }

    /// Computes the result where the operands live, which the shape rule has accepted.
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when the operands live on different devices, and what the backends return.
    fn forward_accepted(&self, inputs: Operands<'_>) -> Result<Forward> {
        let device = inputs.first().map_or(Device::Cpu, Tensor::device);
        if let Some(stray) = inputs.iter().find(|x| x.device() != device) {
            return Err(Error::new(ErrorKind::Device, format!("{}: operands live on different devices", self.name()))
                .found(format!("{device} and {}", stray.device()))
                .fix("move them to one device with to_device"));
        }
        match device {
            Device::Cpu => self.forward_cpu(inputs),
            Device::Gpu(gpu) => self.forward_gpu(&gpu, inputs),
        }
    }

    /// Asks the shape rule, then computes the result where the operands live.
    ///
    /// # Errors
    /// What [`Op::infer`] and [`Op::forward_accepted`] return.
    fn forward(&self, inputs: &[Tensor]) -> Result<Forward> {
        self.forward_accepted(Operands::check(self, inputs)?)
    }

    /// Which values [`Op::vjp`] looks at when the gradients of the operands marked in `wanted` are asked for.
    ///
    /// The tape lets go of all others at once, so that the activations behind linear ops, or in front of frozen weights,
    /// are freed while the forward pass still runs. What is left out keeps its shape, dtype and device; reading its
    /// values panics. Without a rule of its own, an op keeps everything.
    fn reads(&self, wanted: &[bool]) -> Reads {
        let _ = wanted;
        Reads::everything()
    }

    /// Vector-Jacobian product: for each operand, the cotangent that belongs to the result's, or `None` where the operand
    /// is not differentiable (indices, say).
    ///
    /// # Errors
    /// What the ops it is written in return.
    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>>;
}

/// The values that a derivative looks at besides the cotangent; see [`Op::reads`].
///
/// ```
/// use gradreel::Reads;
///
/// // a product needs the other factor
/// fn reads(wanted: &[bool]) -> Reads {
///     Reads::nothing().input_if(0, wanted[1]).input_if(1, wanted[0])
/// }
/// assert_eq!(reads(&[true, false]), Reads::nothing().input(1));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reads {
    /// One bit per operand; the last stands for all operands from the 64th on.
    inputs: u64,
    output: bool,
}

impl Reads {
    /// All operands and the result.
    ///
    /// ```
    /// use gradreel::Reads;
    /// assert!(Reads::everything().reads_output());
    /// ```
    pub const fn everything() -> Self {
        Self { inputs: u64::MAX, output: true }
    }

    /// No values: shapes, dtypes and the cotangent are enough. The right answer for most linear ops.
    ///
    /// ```
    /// use gradreel::Reads;
    /// assert!(!Reads::nothing().reads_input(0));
    /// ```
    pub const fn nothing() -> Self {
        Self { inputs: 0, output: false }
    }

    /// All operands, but not the result.
    ///
    /// ```
    /// use gradreel::Reads;
    /// assert!(Reads::inputs().reads_input(3) && !Reads::inputs().reads_output());
    /// ```
    pub const fn inputs() -> Self {
        Self { inputs: u64::MAX, output: false }
    }

    /// This operand as well.
    ///
    /// ```
    /// use gradreel::Reads;
    /// let reads = Reads::nothing().input(1);
    /// assert!(reads.reads_input(1) && !reads.reads_input(0));
    /// ```
    #[must_use]
    pub const fn input(self, index: usize) -> Self {
        Self { inputs: self.inputs | Self::bit(index), ..self }
    }

    /// This operand as well, under a condition.
    ///
    /// ```
    /// use gradreel::Reads;
    /// assert_eq!(Reads::nothing().input_if(0, false), Reads::nothing());
    /// ```
    #[must_use]
    pub const fn input_if(self, index: usize, condition: bool) -> Self {
        if condition { self.input(index) } else { self }
    }

    /// The result as well.
    ///
    /// ```
    /// use gradreel::Reads;
    /// assert!(Reads::nothing().output().reads_output());
    /// ```
    #[must_use]
    pub const fn output(self) -> Self {
        Self { output: true, ..self }
    }

    /// Whether this operand is read.
    ///
    /// ```
    /// use gradreel::Reads;
    /// assert!(Reads::inputs().reads_input(0));
    /// ```
    pub const fn reads_input(self, index: usize) -> bool {
        self.inputs & Self::bit(index) != 0
    }

    /// Whether the result is read.
    ///
    /// ```
    /// use gradreel::Reads;
    /// assert!(!Reads::inputs().reads_output());
    /// ```
    pub const fn reads_output(self) -> bool {
        self.output
    }

    const fn bit(index: usize) -> u64 {
        1 << if index < 63 { index } else { 63 }
    }
}

/// What a forward pass hands on: the result, and anything the derivative wants to keep.
///
/// ```
/// use gradreel::{Forward, Tensor};
/// let forward = Forward::from(Tensor::from_vec(vec![1.0], [1]));
/// assert!(forward.residual.is_none());
/// ```
pub struct Forward {
    /// The result.
    pub output: Tensor,
    /// Handed to [`Op::vjp`] through [`Backward::residual`].
    pub residual: Option<Rc<dyn Any>>,
    pub(super) residual_bytes: usize,
}

impl Forward {
    /// A result with something kept for the backward pass.
    ///
    /// ```
    /// use gradreel::{Forward, Tensor};
    /// let largest = 3usize;
    /// let forward = Forward::with_residual(Tensor::from_vec(vec![9.0], [1]), largest);
    /// assert!(forward.residual.is_some());
    /// ```
    pub fn with_residual(output: Tensor, residual: impl Any) -> Self {
        Self { output, residual: Some(Rc::new(residual)), residual_bytes: 0 }
    }

    /// Says how many bytes the residual holds, for [`Tape::memory`](crate::Tape::memory).
    ///
    /// ```
    /// use gradreel::{Forward, Tensor};
    /// let places = vec![0u32; 100];
    /// let forward = Forward::with_residual(Tensor::from_vec(vec![9.0], [1]), places).holding(400);
    /// # let _ = forward;
    /// ```
    #[must_use]
    pub fn holding(self, bytes: usize) -> Self {
        Self { residual_bytes: bytes, ..self }
    }
}

impl From<Tensor> for Forward {
    fn from(output: Tensor) -> Self {
        Self { output, residual: None, residual_bytes: 0 }
    }
}

/// What [`Op::vjp`] may use: the cotangent of the result, the operands, the result and the residual.
///
/// ```
/// use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
/// #[derive(Debug)]
/// struct Double;
/// impl Op for Double {
///     fn name(&self) -> &str { "double" }
///     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
///     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
///         let twice = inputs[0].slice::<f64>().iter().map(|x| 2.0 * x).collect();
///         Ok(Tensor::from_vec(twice, inputs[0].shape()).into())
///     }
///     fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
///         assert!(cx.wants(0) && cx.inputs().len() == 1 && !cx.is_recorded());
///         Ok(vec![Some(cx.gradient() * 2.0)])
///     }
/// }
/// let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
/// assert_eq!(x.apply(Double, &[])?.backward()?.wrt(&x)?.item()?, 2.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
pub struct Backward<'a> {
    pub(super) gradient: &'a Var,
    pub(super) inputs: &'a [Var],
    pub(super) wanted: &'a [bool],
    pub(super) output: &'a Var,
    pub(super) residual: Option<&'a Rc<dyn Any>>,
    pub(super) live: bool,
    /// Whether the tape looks for what is not finite.
    pub(super) anomaly: bool,
}

impl Backward<'_> {
    /// The cotangent of the result.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct Square;
    /// # impl Op for Square {
    /// #     fn name(&self) -> &str { "square" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// #     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    /// #         let squares = inputs[0].slice::<f64>().iter().map(|x| x * x).collect();
    /// #         Ok(Forward::with_residual(Tensor::from_vec(squares, inputs[0].shape()), 2.0f64))
    /// #     }
    /// fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
    ///     // y = x²: the cotangent of x is 2 x times that of y
    ///     Ok(vec![Some(&(cx.gradient() * cx.input(0)) * 2.0)])
    /// }
    /// # }
    /// # let tape = Tape::new();
    /// # let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// # assert_eq!(x.apply(Square, &[])?.backward()?.wrt(&x)?.item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn gradient(&self) -> &Var {
        self.gradient
    }

    /// An operand; without its values if [`Op::reads`] leaves it out.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct Square;
    /// # impl Op for Square {
    /// #     fn name(&self) -> &str { "square" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// #     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    /// #         let squares = inputs[0].slice::<f64>().iter().map(|x| x * x).collect();
    /// #         Ok(Forward::with_residual(Tensor::from_vec(squares, inputs[0].shape()), 2.0f64))
    /// #     }
    /// fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
    ///     let x = cx.input(0);
    ///     Ok(vec![Some(&(cx.gradient() * x) * 2.0)])
    /// }
    /// # }
    /// # let tape = Tape::new();
    /// # let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// # assert_eq!(x.apply(Square, &[])?.backward()?.wrt(&x)?.item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn input(&self, index: usize) -> &Var {
        &self.inputs[index]
    }

    /// All operands; without the values of those that [`Op::reads`] leaves out.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct Square;
    /// # impl Op for Square {
    /// #     fn name(&self) -> &str { "square" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// #     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    /// #         let squares = inputs[0].slice::<f64>().iter().map(|x| x * x).collect();
    /// #         Ok(Forward::with_residual(Tensor::from_vec(squares, inputs[0].shape()), 2.0f64))
    /// #     }
    /// fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
    ///     let [x] = cx.inputs() else { unreachable!("the shape rule takes one operand") };
    ///     Ok(vec![Some(&(cx.gradient() * x) * 2.0)])
    /// }
    /// # }
    /// # let tape = Tape::new();
    /// # let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// # assert_eq!(x.apply(Square, &[])?.backward()?.wrt(&x)?.item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn inputs(&self) -> &[Var] {
        self.inputs
    }

    /// Whether anybody wants the gradient of this operand; others may be left `None`.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct Square;
    /// # impl Op for Square {
    /// #     fn name(&self) -> &str { "square" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// #     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    /// #         let squares = inputs[0].slice::<f64>().iter().map(|x| x * x).collect();
    /// #         Ok(Forward::with_residual(Tensor::from_vec(squares, inputs[0].shape()), 2.0f64))
    /// #     }
    /// fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
    ///     if !cx.wants(0) {
    ///         return Ok(vec![None]);
    ///     }
    ///     Ok(vec![Some(&(cx.gradient() * cx.input(0)) * 2.0)])
    /// }
    /// # }
    /// # let tape = Tape::new();
    /// # let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// # assert_eq!(x.apply(Square, &[])?.backward()?.wrt(&x)?.item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn wants(&self, index: usize) -> bool {
        self.wanted[index]
    }

    /// The result; without its values if [`Op::reads`] leaves it out.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct Square;
    /// # impl Op for Square {
    /// #     fn name(&self) -> &str { "square" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// #     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    /// #         let squares = inputs[0].slice::<f64>().iter().map(|x| x * x).collect();
    /// #         Ok(Forward::with_residual(Tensor::from_vec(squares, inputs[0].shape()), 2.0f64))
    /// #     }
    /// fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
    ///     // the slope of x² by its result, for x > 0
    ///     Ok(vec![Some(&(cx.gradient() * &cx.output().sqrt()) * 2.0)])
    /// }
    /// # }
    /// # let tape = Tape::new();
    /// # let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// # assert_eq!(x.apply(Square, &[])?.backward()?.wrt(&x)?.item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn output(&self) -> &Var {
        self.output
    }

    /// Whether the derivative is recorded, to be differentiated again: a fused kernel will not do then.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct Square;
    /// # impl Op for Square {
    /// #     fn name(&self) -> &str { "square" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// #     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    /// #         let squares = inputs[0].slice::<f64>().iter().map(|x| x * x).collect();
    /// #         Ok(Forward::with_residual(Tensor::from_vec(squares, inputs[0].shape()), 2.0f64))
    /// #     }
    /// fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
    ///     assert!(!cx.is_recorded(), "Var::backward records nothing");
    ///     Ok(vec![Some(&(cx.gradient() * cx.input(0)) * 2.0)])
    /// }
    /// # }
    /// # let tape = Tape::new();
    /// # let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// # assert_eq!(x.apply(Square, &[])?.backward()?.wrt(&x)?.item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn is_recorded(&self) -> bool {
        self.live
    }

    /// For derivatives that are kernels rather than ops: refuses to be recorded.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct Square;
    /// # impl Op for Square {
    /// #     fn name(&self) -> &str { "square" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// #     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    /// #         let squares = inputs[0].slice::<f64>().iter().map(|x| x * x).collect();
    /// #         Ok(Forward::with_residual(Tensor::from_vec(squares, inputs[0].shape()), 2.0f64))
    /// #     }
    /// fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
    ///     cx.first_order_only("square")?;
    ///     Ok(vec![Some(&(cx.gradient() * cx.input(0)) * 2.0)])
    /// }
    /// # }
    /// # let tape = Tape::new();
    /// # let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// # assert_eq!(x.apply(Square, &[])?.backward()?.wrt(&x)?.item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Unsupported`] when the caller wants gradients of gradients, which would silently be incomplete.
    pub fn first_order_only(&self, op: &str) -> Result<()> {
        if !self.live {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Unsupported, format!("{op} cannot be differentiated twice"))
            .found("its derivative is a fused kernel, not written in ops")
            .fix("use Var::backward, or compose it of ops whose derivatives are written in ops"))
    }

    /// What the forward pass kept.
    ///
    /// ```
    /// # use gradreel::{Backward, Forward, Op, Operands, Result, Spec, Tape, Tensor, Var};
    /// # #[derive(Debug)]
    /// # struct Square;
    /// # impl Op for Square {
    /// #     fn name(&self) -> &str { "square" }
    /// #     fn infer(&self, inputs: &[Spec]) -> Result<Spec> { Ok(inputs[0].clone()) }
    /// #     fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
    /// #         let squares = inputs[0].slice::<f64>().iter().map(|x| x * x).collect();
    /// #         Ok(Forward::with_residual(Tensor::from_vec(squares, inputs[0].shape()), 2.0f64))
    /// #     }
    /// fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
    ///     let two: &f64 = cx.residual();
    ///     Ok(vec![Some(&(cx.gradient() * cx.input(0)) * *two)])
    /// }
    /// # }
    /// # let tape = Tape::new();
    /// # let x = tape.leaf(Tensor::from_vec(vec![3.0], [1]));
    /// # assert_eq!(x.apply(Square, &[])?.backward()?.wrt(&x)?.item()?, 6.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the forward pass kept nothing, or something of another type.
    #[track_caller]
    pub fn residual<T: 'static>(&self) -> &T {
        self.residual.and_then(|r| r.downcast_ref()).expect("the forward pass keeps a residual of this type")
    }
}
