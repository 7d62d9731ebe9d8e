//! `softmax`: `eˣ / Σ eˣ` along an axis, and its logarithm. Their derivatives are written in ops, so that they can be
//! differentiated any number of times.
//!
//! The largest element is subtracted first, so that nothing overflows. A row with a NaN or with +∞ becomes NaN. In a row of
//! nothing but −∞ nothing counts: its softmax is 0 everywhere (as attention wants it of a row that a mask covers wholly),
//! its logarithm −∞, and no gradient passes through its softmax.

use std::rc::Rc;

use crate::backend::cpu::softmax::{Axis, Pass, run};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Shape, Spec, Tensor};

/// Shapes and axes: rows, columns, whole vectors and parts of them, axes of one element.
const SHAPES: [(&[usize], usize); 7] =
    [(&[3, 5], 1), (&[2, 70], 1), (&[4, 3], 0), (&[2, 5, 19], 1), (&[2, 3, 70], 1), (&[3, 1], 1), (&[1, 1], 0)];

pub(super) const ENTRY: Entry = Entry { name: "softmax", gpu: true, cases: || cases(false) };

pub(super) const LOG_ENTRY: Entry = Entry { name: "log_softmax", gpu: true, cases: || cases(true) };

pub(super) const ADJOINT_ENTRY: Entry = Entry {
    name: "softmax_adjoint",
    gpu: true,
    cases: || {
        let case = |(shape, axis): (&[usize], usize)| {
            Case::new(Adjoint { axis }, [uniform(1, shape, 0.0..0.6), uniform(2, shape, -1.0..1.0)])
        };
        SHAPES.map(case).into()
    },
};

fn cases(log: bool) -> Vec<Case> {
    let case = |(shape, axis): (&[usize], usize)| Case::new(Softmax { axis, log }, [uniform(1, shape, -3.0..3.0)]);
    let mut cases: Vec<Case> = SHAPES.map(case).into();
    let large = Tensor::from_vec(vec![900.0f64, 899.0, 903.0, -700.0, -702.0, -700.5], [2, 3]);
    cases.push(Case::new(Softmax { axis: 1, log }, [large]));
    cases
}

const TEXT: &str = include_str!("../../kernels/softmax.wgsl");
/// One invocation for each row or column.
pub(super) static LINES: Kernel = Kernel::new("softmax", "lines", TEXT, &["y", "x"]);
/// One workgroup for each.
pub(super) static GROUPS: Kernel = Kernel::new("softmax", "groups", TEXT, &["y", "x"]);
/// The adjoint, one invocation for each.
pub(super) static ADJOINT_LINES: Kernel = Kernel::new("softmax", "adjoint_lines", TEXT, &["y", "x", "g"]);
/// The adjoint, one workgroup for each.
pub(super) static ADJOINT_GROUPS: Kernel = Kernel::new("softmax", "adjoint_groups", TEXT, &["y", "x", "g"]);

/// Rows up to this length are given to one invocation.
const SHORT: usize = 32;

fn axis_of(shape: &Shape, axis: usize) -> Axis {
    let dims = shape.dims();
    Axis { outer: dims[..axis].iter().product(), len: dims[axis], inner: dims[axis + 1..].iter().product() }
}

fn infer_axis<const N: usize>(name: &str, axis: usize, inputs: &[Spec]) -> Result<Spec> {
    let inputs = Spec::exactly::<N>(name, inputs)?;
    let x = &inputs[0];
    if !x.dtype.is_real() || axis >= x.shape.rank() || inputs.iter().any(|other| other != x) {
        return Err(Error::new(ErrorKind::Shape, format!("{name}: the operand does not fit"))
            .found(format!("axis {axis} of {inputs:?}"))
            .wanted("f32 or f64, and an axis below the number of axes"));
    }
    Ok(x.clone())
}

/// Runs the kernel that suits the axis.
fn launch(gpu: &Gpu, [lines, groups]: [&Kernel; 2], operands: &[&Tensor], axis: Axis, log: bool) -> Result<Tensor> {
    let Axis { outer, len, inner } = axis;
    let count = outer * inner;
    let sizes = words([count, len, inner, usize::from(log)]);
    let (kernel, work) = match inner > 1 || len <= SHORT {
        true => (lines, Work::Invocations(count)),
        false => (groups, Work::Groups(count)),
    };
    gpu.launch(kernel, operands, &sizes, operands[0].spec(), work)
}

#[derive(Debug)]
struct Softmax {
    axis: usize,
    /// Whether the logarithm is wanted.
    log: bool,
}

impl Op for Softmax {
    fn name(&self) -> &'static str {
        if self.log { "log_softmax" } else { "softmax" }
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        infer_axis::<1>(self.name(), self.axis, inputs)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let axis = axis_of(x.shape(), self.axis);
        for_real!(x.dtype(), T => {
            let pass = if self.log { Pass::LogSoftmax(x.slice::<T>()) } else { Pass::Softmax(x.slice::<T>()) };
            Ok(Tensor::from_vec(run(axis, pass), x.shape()).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let axis = axis_of(inputs[0].shape(), self.axis);
        Ok(launch(gpu, [&LINES, &GROUPS], &[&inputs[0]], axis, self.log)?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing().output()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (y, g) = (cx.output(), cx.gradient());
        let cotangent = match self.log {
            true => g - &(&y.exp() * &total(g, self.axis)),
            false => y.softmax_adjoint(g, self.axis),
        };
        Ok(vec![Some(cotangent)])
    }
}

/// The sum along an axis, which is kept with size 1.
fn total(x: &Var, axis: usize) -> Var {
    let mut with_one = x.dims().to_vec();
    with_one[axis] = 1;
    x.sum(&[axis]).reshape(with_one)
}

/// `y (g − Σ g y)`: the adjoint of the softmax whose result is `y`.
#[derive(Debug)]
struct Adjoint {
    axis: usize,
}

impl Op for Adjoint {
    fn name(&self) -> &'static str {
        "softmax_adjoint"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        infer_axis::<2>(self.name(), self.axis, inputs)
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [y, g] = inputs.array();
        let axis = axis_of(y.shape(), self.axis);
        for_real!(y.dtype(), T => {
            Ok(Tensor::from_vec(run(axis, Pass::Adjoint(y.slice::<T>(), g.slice::<T>())), y.shape()).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let axis = axis_of(inputs[0].shape(), self.axis);
        Ok(launch(gpu, [&ADJOINT_LINES, &ADJOINT_GROUPS], &[&inputs[0], &inputs[1]], axis, false)?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        Reads::nothing().input(0).input_if(1, wanted[0])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (y, g, u) = (cx.input(0), cx.input(1), cx.gradient());
        // with s = Σ g y: d/dy_j of Σ u y (g − s) is u_j (g_j − s) − g_j Σ u y; in g the map is its own transpose
        let for_y = || &(u * &(g - &total(&(g * y), self.axis))) - &(g * &total(&(u * y), self.axis));
        let for_g = || y.softmax_adjoint(u, self.axis);
        Ok(vec![cx.wants(0).then(for_y), cx.wants(1).then(for_g)])
    }
}

impl Var {
    /// `eˣ / Σ eˣ` along an axis. Zeros where an axis holds nothing but −∞; NaN where it holds a NaN or +∞.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0f64, 3.0f64.ln(), 5.0, 5.0], [2, 2]));
    /// let y = x.softmax(1);
    /// for (found, expected) in y.value()?.slice::<f64>().iter().zip([0.25, 0.75, 0.5, 0.5]) {
    ///     assert!((found - expected).abs() < 1e-15);
    /// }
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn softmax(&self, axis: usize) -> Self {
        Self::run(Rc::new(Softmax { axis, log: false }), &[self])
    }

    /// `x − ln Σ eˣ` along an axis: the logarithm of [`Var::softmax`] without its loss of digits.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0, 0.0], [2]));
    /// assert_eq!(x.log_softmax(0).value()?.slice::<f64>()[0], -std::f64::consts::LN_2);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn log_softmax(&self, axis: usize) -> Self {
        Self::run(Rc::new(Softmax { axis, log: true }), &[self])
    }

    #[track_caller]
    fn softmax_adjoint(&self, g: &Self, axis: usize) -> Self {
        Self::run(Rc::new(Adjoint { axis }), &[self, g])
    }
}
