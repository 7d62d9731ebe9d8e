//! `recurrence`: `yᵢ = aᵢ yᵢ₋₁ + bᵢ` along an axis, from either end. Running products are one of its uses.

use std::rc::Rc;

use crate::backend::cpu::scan::scan;
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::cumsum::{around, check_axis};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "recurrence",
    gpu: true,
    cases: || {
        let case = |axis, reverse, shape: &[usize]| {
            let operands = [uniform(1, shape, -1.0..1.0), uniform(2, shape, -1.0..1.0)];
            Case::new(Recurrence { axis, reverse }, operands)
        };
        vec![case(0, false, &[5]), case(1, true, &[2, 3, 4]), case(2, false, &[2, 3, 4]), case(0, true, &[9, 2])]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("scan", "recurrence", include_str!("../../kernels/scan.wgsl"), &["y", "a", "b"]);

#[derive(Debug)]
struct Recurrence {
    axis: usize,
    reverse: bool,
}

impl Recurrence {
    /// Each element replaced by its neighbour, the one before it in running order or the one after it; 0 where there is
    /// none.
    fn neighbours(&self, x: &Var, before: bool) -> Var {
        let len = x.dims()[self.axis];
        match before != self.reverse {
            true => x.slice(self.axis, 0..len - 1).pad(self.axis, 1, 0),
            false => x.slice(self.axis, 1..len).pad(self.axis, 0, 1),
        }
    }
}

impl Op for Recurrence {
    fn name(&self) -> &'static str {
        "recurrence"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [a, b] = Spec::exactly(self.name(), inputs)?;
        check_axis(self.name(), self.axis, b)?;
        if a != b {
            return Err(Error::new(ErrorKind::Shape, "recurrence: factors and terms must have one shape")
                .found(format!("{a:?} and {b:?}"))
                .fix("stretch one to the other with broadcast_to"));
        }
        Ok(b.clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [a, b] = inputs.array();
        let sizes = around(b.shape(), self.axis);
        for_real!(b.dtype(), T => {
            Ok(Tensor::from_vec(scan::<T>(Some(a.slice()), b.slice(), sizes, self.reverse), b.shape()).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [a, b] = inputs.array();
        let [outer, len, inner] = around(b.shape(), self.axis);
        let lines = outer * inner;
        let sizes = words([lines, len, inner, usize::from(self.reverse)]);
        Ok(gpu.launch(&KERNEL, &[a, b], &sizes, b.spec(), Work::Invocations(lines))?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        let factors = Reads::nothing().input(0);
        if wanted[0] { factors.output() } else { factors }
    }

    /// The cotangents run the other way: `λᵢ = gᵢ + aᵢ₊₁ λᵢ₊₁`; then `dbᵢ = λᵢ` and `daᵢ = λᵢ yᵢ₋₁`.
    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (a, g) = (cx.input(0), cx.gradient());
        if a.is_empty() {
            return Ok(vec![Some(g.clone()), Some(g.clone())]);
        }
        let back = Self { axis: self.axis, reverse: !self.reverse };
        let to_b = Var::run(Rc::new(back), &[&self.neighbours(a, false), g]);
        let to_a = cx.wants(0).then(|| &to_b * &self.neighbours(cx.output(), true));
        Ok(vec![to_a, Some(to_b)])
    }
}

impl Var {
    /// With these as the factors `a`, runs `yᵢ = aᵢ yᵢ₋₁ + bᵢ` along an axis from `y₀ = b₀`; `a₀` is not used.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let decay = tape.leaf(Tensor::from_vec(vec![0.5f64; 3], [3]));
    /// let kicks = tape.leaf(Tensor::from_vec(vec![1.0f64, 0.0, 4.0], [3]));
    /// let y = decay.recurrence(&kicks, 0);
    /// assert_eq!(y.value()?.slice::<f64>(), &[1.0, 0.5, 4.25]);
    /// assert_eq!(y.sum_all().backward()?.wrt(&decay)?.slice::<f64>(), &[0.0, 1.5, 0.5]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes differ or the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn recurrence(&self, terms: &Self, axis: usize) -> Self {
        Self::run(Rc::new(Recurrence { axis, reverse: false }), &[self, terms])
    }

    /// As [`Var::recurrence`] from the end: `yᵢ = aᵢ yᵢ₊₁ + bᵢ` from `yₙ₋₁ = bₙ₋₁`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let factors = tape.leaf(Tensor::from_vec(vec![2.0, 2.0, 2.0], [3]));
    /// let terms = tape.leaf(Tensor::from_vec(vec![1.0, 1.0, 1.0], [3]));
    /// assert_eq!(factors.recurrence_from_end(&terms, 0).value()?.slice::<f64>(), [7.0, 3.0, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes differ or the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn recurrence_from_end(&self, terms: &Self, axis: usize) -> Self {
        Self::run(Rc::new(Recurrence { axis, reverse: true }), &[self, terms])
    }

    /// Running products `yᵢ = x₀ ⋯ xᵢ` along an axis. The derivative is right where factors are 0.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// assert_eq!(x.cumprod(0).value()?.slice::<f64>(), [1.0, 2.0, 6.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn cumprod(&self, axis: usize) -> Self {
        let len = self.dims().get(axis).copied().unwrap_or_else(|| panic!("cumprod: {axis} is no axis of {self:?}"));
        let first = self.slice(axis, 0..len.min(1)).pad(axis, 0, len.saturating_sub(1));
        self.recurrence(&first, axis)
    }

    /// Running products from the end, `yᵢ = xᵢ ⋯ xₙ₋₁`, along an axis.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// assert_eq!(x.cumprod_from_end(0).value()?.slice::<f64>(), [6.0, 6.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn cumprod_from_end(&self, axis: usize) -> Self {
        let len = self.dims().get(axis).copied().unwrap_or_else(|| panic!("cumprod: {axis} is no axis of {self:?}"));
        let last = self.slice(axis, len - len.min(1)..len).pad(axis, len.saturating_sub(1), 0);
        self.recurrence_from_end(&last, axis)
    }
}
