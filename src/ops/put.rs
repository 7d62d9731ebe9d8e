//! `put`: one number for each row at the place that an index names, among zeros. Its derivative is
//! [`take`](super::take).

use std::rc::Rc;

use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::{Gpu, Kernel, Strides, Work, words};
use crate::ops::index_select::check_rows;
use crate::ops::reduction::Axes;
use crate::ops::take::Take;
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{DType, Device, Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "put",
    gpu: true,
    cases: || {
        let case = |shape: &[usize], axes: &[usize], index: &[u32]| {
            let op = Put::new(&shape.into(), Axes::new(axes));
            let rows = op.axes.kept(&op.shape);
            let index = Tensor::from_vec(index.to_vec(), &rows);
            Case::new(op, [uniform(1, rows, -1.0..1.0), index])
        };
        vec![
            case(&[3, 4], &[1], &[0, 3, 2]),
            case(&[2, 3, 4], &[0, 2], &[7, 0, 5]),
            case(&[5], &[0], &[4]),
            case(&[2, 3, 2], &[1], &[0, 1, 2, 1]),
        ]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("put", "main", include_str!("../../kernels/put.wgsl"), &["y", "x", "index"]);

/// Groups of axes that the kernel's array holds.
const MOST: usize = 8;

#[derive(Debug)]
pub(super) struct Put {
    shape: Shape,
    axes: Axes,
}

impl Put {
    /// Into a result of this shape, in which an index counts the places of `axes` in row-major order.
    pub(super) fn new(shape: &Shape, axes: Axes) -> Self {
        Self { shape: shape.clone(), axes }
    }

    fn run<T: Real>(&self, x: &[T], index: &[u32]) -> Vec<T> {
        let (kept, hot) = (self.axes.walk(&self.shape, false), self.axes.walk(&self.shape, true));
        let mut result = filled(self.shape.len(), CHUNK, |_, part: &mut [T]| part.fill(T::ZERO));
        for (number, (&x, &i)) in x.iter().zip(index).enumerate() {
            result[kept.place(number) + hot.place(i as usize)] = x;
        }
        result
    }

    /// Axes of the result as the kernel walks them: size, and steps in the rows and in the numbers of the index.
    fn groups(&self) -> Result<Vec<[usize; 4]>> {
        let mut groups: Vec<(usize, bool)> = Vec::new();
        for (axis, &size) in self.shape.dims().iter().enumerate() {
            let hot = self.axes.contains(axis);
            match groups.last_mut() {
                Some((outer, same)) if *same == hot => *outer *= size,
                _ => groups.push((size, hot)),
            }
        }
        if groups.len() > MOST {
            return Err(Error::new(ErrorKind::Unsupported, "put: too many axes for its WGSL kernel")
                .found(groups.len())
                .wanted(format!("at most {MOST}"))
                .fix("reshape, or move the operand to the CPU with to_device(&Device::Cpu)"));
        }
        let mut steps = [1, 1];
        let mut walked: Vec<[usize; 4]> = Vec::new();
        for (size, hot) in groups.into_iter().rev() {
            let step = &mut steps[usize::from(hot)];
            walked.push(if hot { [size, 0, *step, 0] } else { [size, *step, 0, 0] });
            *step *= size;
        }
        walked.reverse();
        Ok(walked)
    }
}

impl Op for Put {
    fn name(&self) -> &'static str {
        "put"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x, index] = Spec::exactly(self.name(), inputs)?;
        let rows = self.axes.infer(self.name(), &Spec::new(&self.shape, DType::U32))?;
        self.axes.check_numbers(self.name(), &self.shape)?;
        if *index != rows || x.shape != rows.shape || !x.dtype.is_real() {
            return Err(Error::new(ErrorKind::Shape, "put: the operands do not fit")
                .found(format!("{x:?} at {index:?} into {}", self.shape))
                .wanted(format!("f32 or f64 at {rows:?}")));
        }
        Ok(Spec::new(&self.shape, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [x, index] = inputs.array();
        check_rows(self.name(), index.slice(), self.axes.walk(&self.shape, true).len())?;
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(self.run::<T>(x.slice(), index.slice()), &self.shape).into()))
    }

    /// An index beyond the end gives zeros: [`Var::one_hot`] has checked before.
    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [x, index] = inputs.array();
        let groups = self.groups()?;
        let rows = Strides::new(groups.iter().map(|[size, row, ..]| (*size, *row)));
        let y = gpu.empty(Spec::new(&self.shape, x.dtype()))?;
        for (first, part) in gpu.windows(&y, 0..y.len()) {
            let seen = rows.bounds(0, first, part.len());
            for ((begin, x), (_, index)) in gpu.windows(x, seen.clone()).into_iter().zip(gpu.windows(index, seen)) {
                let mut sizes = words([part.len(), groups.len(), first, begin]).to_vec();
                groups.iter().for_each(|group| sizes.extend(words(*group)));
                gpu.dispatch(&KERNEL, &[&part, &x, &index], &sizes, Work::Invocations(part.len()))?;
            }
        }
        Ok(y.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing().input(1)
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let take = Take::new(self.axes.clone());
        Ok(vec![Some(Var::run(Rc::new(take), &[cx.gradient(), cx.input(1)])), None])
    }
}

impl Var {
    /// With these as indices of any shape: 1 at the index, 0 elsewhere, along a new last axis of size `classes`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let classes = tape.constant(Tensor::from_vec(vec![2u32, 0], [2]));
    /// assert_eq!(classes.one_hot(3, gradreel::DType::F64)?.value()?.slice::<f64>(), [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when an index is not below `classes`.
    ///
    /// # Panics
    /// When these are not `u32`, or `dtype` is not `f32` or `f64`.
    #[track_caller]
    pub fn one_hot(&self, classes: usize, dtype: DType) -> Result<Self> {
        let index = self.tensor();
        assert_eq!(index.dtype(), DType::U32, "one_hot: the indices are {:?}", index.spec());
        match index.device() {
            Device::Cpu => check_rows("one_hot", index.slice(), classes)?,
            Device::Gpu(_) => check_rows("one_hot", index.gpu_buffer().indices()?, classes)?,
        }
        let mut dims = self.dims().to_vec();
        dims.push(classes);
        let put = Put::new(&dims.into(), Axes::new(&[self.shape().rank()]));
        let one = self.tape().constant(Tensor::scalar(1.0, dtype).to_device(&self.device())?);
        self.tape().apply(Rc::new(put), &[&one.broadcast_to(self.shape()), self])
    }
}
