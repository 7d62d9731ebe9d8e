//! `cumsum`: running sums along an axis, from either end. On the CPU the sums are in `f64`.

use std::rc::Rc;

use crate::backend::cpu::scan::scan;
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "cumsum",
    gpu: true,
    cases: || {
        let case = |axis, reverse, shape: &[usize]| Case::new(CumSum { axis, reverse }, [uniform(1, shape, -1.0..1.0)]);
        vec![
            case(0, false, &[5]),
            case(1, true, &[2, 3, 4]),
            case(2, false, &[2, 3, 4]),
            case(0, true, &[1, 3]),
            case(0, false, &[37, 2]),
        ]
    },
};

pub(super) static KERNEL: Kernel = Kernel::new("scan", "cumsum", include_str!("../../kernels/scan.wgsl"), &["y", "b"]);

#[derive(Debug)]
struct CumSum {
    axis: usize,
    reverse: bool,
}

/// The shape rule of what runs along an axis.
pub(super) fn check_axis(op: &str, axis: usize, x: &Spec) -> Result<()> {
    if axis < x.shape.rank() {
        return Ok(());
    }
    Err(Error::new(ErrorKind::Shape, format!("{op}: no such axis"))
        .found(format!("axis {axis} of {x:?}"))
        .wanted(format!("an axis below {}", x.shape.rank())))
}

/// Sizes before, of and after an axis.
pub(super) fn around(shape: &Shape, axis: usize) -> [usize; 3] {
    let dims = shape.dims();
    [dims[..axis].iter().product(), dims[axis], dims[axis + 1..].iter().product()]
}

impl Op for CumSum {
    fn name(&self) -> &'static str {
        "cumsum"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        check_axis(self.name(), self.axis, x)?;
        Ok(x.clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let sizes = around(x.shape(), self.axis);
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(scan::<T>(None, x.slice(), sizes, self.reverse), x.shape()).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let [outer, len, inner] = around(x.shape(), self.axis);
        let lines = outer * inner;
        let sizes = words([lines, len, inner, usize::from(self.reverse)]);
        Ok(gpu.launch(&KERNEL, &[x], &sizes, x.spec(), Work::Invocations(lines))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let back = Self { axis: self.axis, reverse: !self.reverse };
        Ok(vec![Some(Var::run(Rc::new(back), &[cx.gradient()]))])
    }
}

impl Var {
    /// Running sums `yᵢ = x₀ + … + xᵢ` along an axis.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// assert_eq!(x.cumsum(0).value()?.slice::<f64>(), [1.0, 3.0, 6.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn cumsum(&self, axis: usize) -> Self {
        Self::run(Rc::new(CumSum { axis, reverse: false }), &[self])
    }

    /// Running sums from the end, `yᵢ = xᵢ + … + xₙ₋₁`, along an axis.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// assert_eq!(x.cumsum_from_end(0).value()?.slice::<f64>(), [6.0, 5.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn cumsum_from_end(&self, axis: usize) -> Self {
        Self::run(Rc::new(CumSum { axis, reverse: true }), &[self])
    }
}
