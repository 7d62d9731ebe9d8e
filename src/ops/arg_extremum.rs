//! `arg_extremum`: where the largest or smallest element over some axes is, as its number in row-major order of those
//! axes. The first one on a tie; the first NaN if there is one. It has no derivative.

use std::rc::Rc;

use crate::backend::cpu::{self, CHUNK, filled, widest};
use crate::backend::gpu::{Gpu, Kernel, Strides, Work, words};
use crate::ops::max::Largest;
use crate::ops::min::Smallest;
use crate::ops::put::Put;
use crate::ops::reduction::{Axes, Join};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{DType, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "arg_extremum",
    gpu: true,
    cases: || {
        let case = |axes: &[usize], largest, x: Tensor| {
            Case::new(ArgExtremum { axes: Axes::new(axes), largest }, [x]).condition()
        };
        let ties =
            Tensor::from_vec(vec![1.0f64, 3.0, 3.0, 1.0, 2.0, 2.0, 2.0, 2.0, f64::NAN, 5.0, f64::NAN, 5.0], [3, 4]);
        vec![
            case(&[1], true, ties.clone()),
            case(&[1], false, ties.clone()),
            case(&[0, 1], true, ties),
            case(&[0, 2], false, uniform(1, [2, 3, 4], -1.0..1.0)),
            case(&[0], true, uniform(2, [300, 2], -1.0..1.0)),
        ]
    },
};

const TEXT: &str = include_str!("../../kernels/arg_extremum.wgsl");
/// One invocation for each result.
pub(super) static ROWS: Kernel = Kernel::new("arg_extremum", "rows", TEXT, &["y", "x"]);
/// One workgroup for each result.
pub(super) static TREE: Kernel = Kernel::new("arg_extremum", "tree", TEXT, &["y", "x"]);
/// Known extrema, in windows of an operand that does not fit one binding.
pub(super) static FIND: Kernel = Kernel::new("arg_extremum", "find", TEXT, &["y", "x", "best"]);

/// Elements behind a result from which on a workgroup works on it.
const LONG: usize = 256;

#[derive(Debug)]
struct ArgExtremum {
    axes: Axes,
    largest: bool,
}

impl ArgExtremum {
    /// The extrema first, in vectors; then where they are.
    fn run<T: Real>(&self, x: &Tensor) -> Vec<u32> {
        let best = if self.largest { self.axes.on_cpu::<T, Largest>(x) } else { self.axes.on_cpu::<T, Smallest>(x) };
        let (kept, dropped) = (self.axes.walk(x.shape(), false), self.axes.walk(x.shape(), true));
        let (x, best) = (x.slice::<T>(), best.slice::<T>());
        let columns = kept.axes().last().is_some_and(|(_, step)| *step == 1);
        filled(
            kept.len(),
            (CHUNK / dropped.len().max(1)).max(if columns { 64 } else { 1 }),
            |start, out: &mut [u32]| {
                let best = &best[start..start + out.len()];
                if columns {
                    widest(Columns { x, best, kept: &kept, dropped: &dropped, start, out });
                    return;
                }
                let (run, _) = dropped.axes().last().copied().unwrap_or((1, 1));
                for (i, (out, &best)) in out.iter_mut().zip(best).enumerate() {
                    let base = kept.place(start + i);
                    let within = |number: usize| {
                        let at = base + dropped.place(number);
                        widest(Find { x: &x[at..at + run], best }).map(|place| number + place)
                    };
                    let found = (0..dropped.len()).step_by(run).find_map(within);
                    *out = u32::try_from(found.unwrap_or(0)).expect("infer has checked the number of elements");
                }
            },
        )
    }
}

impl ArgExtremum {
    /// The extrema first, by parts; then where they are.
    fn by_windows(&self, gpu: &Gpu, x: &Tensor) -> Result<Tensor> {
        let join = if self.largest { Join::Max } else { Join::Min };
        let best = self.axes.on_gpu(gpu, self.name(), x, join)?;
        let (kept, dropped) = (self.axes.walk(x.shape(), false), self.axes.walk(x.shape(), true));
        let axes = [kept.words(self.name())?, dropped.words(self.name())?].concat();
        let y = gpu.empty(self.infer(&[x.spec()])?)?;
        for ((first, part), (_, best)) in gpu.windows(&y, 0..y.len()).into_iter().zip(gpu.windows(&best, 0..y.len())) {
            let seen = kept.bounds_with(&dropped, first, part.len());
            for (number, (begin, window)) in gpu.windows(x, seen).into_iter().enumerate() {
                let (count, fresh) = (dropped.len(), usize::from(number == 0));
                let mut sizes =
                    words([part.len(), count, kept.rank(), dropped.rank(), 0, first, begin, fresh]).to_vec();
                sizes.extend_from_slice(&axes);
                gpu.dispatch(&FIND, &[&part, &window, &best], &sizes, Work::Invocations(part.len()))?;
            }
        }
        Ok(y)
    }
}

/// The first element equal to the best, or the first NaN if that is the best.
struct Find<'a, T> {
    x: &'a [T],
    best: T,
}

/// Elements looked at before the search asks whether it is done.
const STRETCH: usize = 64;

impl<T: Real> cpu::Work for Find<'_, T> {
    type Output = Option<usize>;

    #[inline(always)]
    fn run(self) -> Option<usize> {
        let Self { x, best } = self;
        let nan = best.is_nan();
        let mut start = 0;
        while start < x.len() {
            let part = &x[start..x.len().min(start + STRETCH)];
            let (mut any, mut i) = (false, 0);
            while i < part.len() {
                any |= part[i] == best || (nan && part[i].is_nan());
                i += 1;
            }
            if any {
                i = 0;
                while !(part[i] == best || (nan && part[i].is_nan())) {
                    i += 1;
                }
                return Some(start + i);
            }
            start += STRETCH;
        }
        None
    }
}

/// Neighbouring results, whose elements are neighbours as well: one row of elements after the other, from the last.
struct Columns<'a, T> {
    x: &'a [T],
    best: &'a [T],
    kept: &'a Strides,
    dropped: &'a Strides,
    start: usize,
    out: &'a mut [u32],
}

impl<T: Real> cpu::Work for Columns<'_, T> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation)]
    fn run(self) {
        let Self { x, best, kept, dropped, start, out } = self;
        let (width, _) = kept.axes()[kept.rank() - 1];
        let mut done = 0;
        while done < out.len() {
            let len = (width - (start + done) % width).min(out.len() - done);
            let base = kept.place(start + done);
            let (out, best) = (&mut out[done..done + len], &best[done..done + len]);
            let mut number = dropped.len();
            while number > 0 {
                number -= 1;
                let at = base + dropped.place(number);
                let row = &x[at..at + len];
                let mut i = 0;
                while i < len {
                    let found = row[i] == best[i] || (row[i].is_nan() && best[i].is_nan());
                    out[i] = if found { number as u32 } else { out[i] };
                    i += 1;
                }
            }
            done += len;
        }
    }
}

impl Op for ArgExtremum {
    fn name(&self) -> &'static str {
        "arg_extremum"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        let shape = self.axes.infer_some(self.name(), x)?.shape;
        self.axes.check_numbers(self.name(), &x.shape)?;
        Ok(Spec::new(shape, DType::U32))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(self.run::<T>(x), self.axes.kept(x.shape())).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let x = &inputs[0];
        let (kept, dropped) = (self.axes.walk(x.shape(), false), self.axes.walk(x.shape(), true));
        if x.len() > gpu.part_len() {
            return Ok(self.by_windows(gpu, x)?.into());
        }
        let (results, count) = (kept.len(), dropped.len());
        let largest = usize::from(self.largest);
        let mut sizes = words([results, count, kept.rank(), dropped.rank(), largest, 0, 0, 0]).to_vec();
        sizes.extend(kept.words(self.name())?);
        sizes.extend(dropped.words(self.name())?);
        let long = count >= LONG;
        let (kernel, work) = if long { (&TREE, Work::Groups(results)) } else { (&ROWS, Work::Invocations(results)) };
        Ok(gpu.launch(kernel, &[x], &sizes, self.infer(&[x.spec()])?, work)?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, _cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![None])
    }
}

impl Var {
    /// The number of the largest element along an axis, which is dropped, as `u32`: the first one on a tie, the first NaN
    /// if there is one. A constant: it has no derivative.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 5.0, 2.0, 9.0, 0.0, 3.0], [2, 3]));
    /// assert_eq!(x.argmax(1).value()?.slice::<u32>(), [1, 0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist or is empty.
    #[track_caller]
    #[must_use]
    pub fn argmax(&self, axis: usize) -> Self {
        Self::run(Rc::new(ArgExtremum { axes: Axes::new(&[axis]), largest: true }), &[&self.detach()])
    }

    /// The number of the smallest element along an axis; as [`Var::argmax`].
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 5.0, 2.0, 9.0, 0.0, 3.0], [2, 3]));
    /// assert_eq!(x.argmin(1).value()?.slice::<u32>(), [0, 1]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist or is empty.
    #[track_caller]
    #[must_use]
    pub fn argmin(&self, axis: usize) -> Self {
        Self::run(Rc::new(ArgExtremum { axes: Axes::new(&[axis]), largest: false }), &[&self.detach()])
    }

    /// This cotangent of an extremum, put where the extremum of `x` is, among zeros.
    pub(super) fn to_extremum(&self, x: &Self, axes: &Axes, largest: bool) -> Self {
        let place = Self::run(Rc::new(ArgExtremum { axes: axes.clone(), largest }), &[&x.detach()]);
        Self::run(Rc::new(Put::new(x.shape(), axes.clone())), &[self, &place])
    }
}
