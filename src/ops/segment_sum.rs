//! `segment_sum`: sums of the rows of each segment. Its derivative is [`segment_repeat`](super::segment_repeat).

use std::rc::Rc;

use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::segment_repeat::SegmentRepeat;
use crate::ops::segments::{are_offsets, check_offsets};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "segment_sum",
    gpu: true,
    cases: || {
        let case = |shape: &[usize], offsets: &[u32]| {
            let offsets = Tensor::from_vec(offsets.to_vec(), [offsets.len()]);
            Case::new(SegmentSum, [uniform(1, shape, -1.0..1.0), offsets])
        };
        vec![
            case(&[7, 3], &[0, 2, 2, 6, 7]),
            case(&[5], &[0, 5]),
            case(&[4, 1, 2], &[0, 0, 1, 4, 4]),
            case(&[0, 2], &[0, 0]),
            case(&[0], &[0]),
        ]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("segment_sum", "main", include_str!("../../kernels/segment_sum.wgsl"), &["y", "x", "offsets"]);

#[derive(Debug)]
pub(super) struct SegmentSum;

/// Each sum in the order of its rows.
fn run<T: Real>(x: &[T], offsets: &[u32], row: usize) -> Vec<T> {
    let segments = offsets.len() - 1;
    filled(segments * row, (CHUNK / row.max(1)).max(1) * row, |start, part: &mut [T]| {
        if row == 1 {
            for (sum, ends) in part.iter_mut().zip(offsets[start..].windows(2)) {
                *sum = x[ends[0] as usize..ends[1] as usize].iter().copied().sum();
            }
            return;
        }
        for (sums, ends) in part.chunks_mut(row.max(1)).zip(offsets[start / row.max(1)..].windows(2)) {
            sums.fill(T::ZERO);
            for values in x[ends[0] as usize * row..ends[1] as usize * row].chunks(row) {
                sums.iter_mut().zip(values).for_each(|(sum, v)| *sum += *v);
            }
        }
    })
}

impl Op for SegmentSum {
    fn name(&self) -> &'static str {
        "segment_sum"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x, offsets] = Spec::exactly(self.name(), inputs)?;
        if x.shape.rank() == 0 || !x.dtype.is_real() || !are_offsets(offsets) {
            return Err(Error::new(ErrorKind::Shape, "segment_sum: the operands do not fit")
                .found(format!("{x:?} by {offsets:?}"))
                .wanted("rows by offsets [segments + 1], u32"));
        }
        let mut dims = x.shape.dims().to_vec();
        dims[0] = offsets.shape.len() - 1;
        Ok(Spec::new(dims, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [x, offsets] = inputs.array();
        check_offsets(self.name(), offsets.slice(), x.dims()[0])?;
        let result = self.infer(&[x.spec(), offsets.spec()])?;
        let row = x.dims()[1..].iter().product();
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(run::<T>(x.slice(), offsets.slice(), row), result.shape).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [x, offsets] = inputs.array();
        check_offsets(self.name(), offsets.gpu_buffer().indices()?, x.dims()[0])?;
        let result = self.infer(&[x.spec(), offsets.spec()])?;
        let (len, row) = (result.shape.len(), x.dims()[1..].iter().product::<usize>());
        Ok(gpu.launch(&KERNEL, &[x, offsets], &words([len, row]), result, Work::Invocations(len))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing().input(1)
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let rows = cx.input(0).dims()[0];
        let repeated = cx.gradient().tape().apply(Rc::new(SegmentRepeat { rows }), &[cx.gradient(), cx.input(1)])?;
        Ok(vec![Some(repeated), None])
    }
}

impl Var {
    /// Sums of neighbouring rows (along axis 0): sum `s` is that of the rows `offsets[s] .. offsets[s + 1]`, and 0 where there
    /// are none. Of samples along rays it makes pixels.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0f64, 2.0, 4.0], [3]));
    /// let offsets = tape.constant(Tensor::from_vec(vec![0u32, 2, 2, 3], [4]));
    /// assert_eq!(x.segment_sum(&offsets)?.value()?.slice::<f64>(), &[3.0, 0.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the offsets fall somewhere, or are not those of the rows.
    ///
    /// # Panics
    /// When the operands are not rows and a list of `u32`.
    #[track_caller]
    pub fn segment_sum(&self, offsets: &Self) -> Result<Self> {
        self.tape().apply(Rc::new(SegmentSum), &[self, offsets])
    }
}
