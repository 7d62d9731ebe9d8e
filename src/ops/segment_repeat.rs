//! `segment_repeat`: a row for each segment, repeated for the rows of it. Its derivative is
//! [`segment_sum`](super::segment_sum).

use std::rc::Rc;

use rayon::prelude::*;

use crate::backend::cpu::{Places, buffer};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::segments::{are_offsets, check_offsets};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "segment_repeat",
    gpu: true,
    cases: || {
        let case = |shape: &[usize], rows: usize, offsets: &[u32]| {
            let offsets = Tensor::from_vec(offsets.to_vec(), [offsets.len()]);
            Case::new(SegmentRepeat { rows }, [uniform(1, shape, -1.0..1.0), offsets])
        };
        vec![
            case(&[4, 3], 7, &[0, 2, 2, 6, 7]),
            case(&[1], 5, &[0, 5]),
            case(&[4, 1, 2], 4, &[0, 0, 1, 4, 4]),
            case(&[1, 2], 0, &[0, 0]),
            case(&[0], 0, &[0]),
        ]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("segment_repeat", "main", include_str!("../../kernels/segment_repeat.wgsl"), &["y", "x", "offsets"]);

/// Segments per work item.
const SEGMENTS: usize = 256;

#[derive(Debug)]
pub(super) struct SegmentRepeat {
    pub(super) rows: usize,
}

fn run<T: Real>(x: &[T], offsets: &[u32], rows: usize, row: usize) -> Vec<T> {
    let mut result = buffer(rows * row);
    let out = Places::of(&mut result);
    let segments = offsets.len() - 1;
    (0..segments.div_ceil(SEGMENTS)).into_par_iter().for_each(|item| {
        for s in item * SEGMENTS..segments.min((item + 1) * SEGMENTS) {
            let (start, end) = (offsets[s] as usize * row, offsets[s + 1] as usize * row);
            // SAFETY: the offsets never fall and end with the number of rows, so that the ranges do not overlap.
            let part = unsafe { out.part(start, end - start) };
            if row == 1 {
                part.fill(x[s]);
            } else {
                part.chunks_mut(row.max(1)).for_each(|to| to.copy_from_slice(&x[s * row..][..row]));
            }
        }
    });
    result
}

impl Op for SegmentRepeat {
    fn name(&self) -> &'static str {
        "segment_repeat"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x, offsets] = Spec::exactly(self.name(), inputs)?;
        let fits = are_offsets(offsets) && x.shape.dims().first() == Some(&(offsets.shape.len() - 1));
        if !fits || !x.dtype.is_real() {
            return Err(Error::new(ErrorKind::Shape, "segment_repeat: the operands do not fit")
                .found(format!("{x:?} by {offsets:?}"))
                .wanted("one row for each segment, by offsets [segments + 1], u32"));
        }
        let mut dims = x.shape.dims().to_vec();
        dims[0] = self.rows;
        Ok(Spec::new(dims, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [x, offsets] = inputs.array();
        check_offsets(self.name(), offsets.slice(), self.rows)?;
        let result = self.infer(&[x.spec(), offsets.spec()])?;
        let row = x.dims()[1..].iter().product();
        for_real!(x.dtype(), T => {
            Ok(Tensor::from_vec(run::<T>(x.slice(), offsets.slice(), self.rows, row), result.shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [x, offsets] = inputs.array();
        check_offsets(self.name(), offsets.gpu_buffer().indices()?, self.rows)?;
        let result = self.infer(&[x.spec(), offsets.spec()])?;
        let (len, row) = (result.shape.len(), x.dims()[1..].iter().product::<usize>());
        let sizes = words([len, row, offsets.len() - 1]);
        Ok(gpu.launch(&KERNEL, &[x, offsets], &sizes, result, Work::Invocations(len))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing().input(1)
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().segment_sum(cx.input(1))?), None])
    }
}

impl Var {
    /// Row `s` (along axis 0) repeated for the rows `offsets[s] .. offsets[s + 1]` of the result: of something known for each
    /// ray it makes something known for each of the ray's samples.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let rays = tape.leaf(Tensor::from_vec(vec![5.0, 7.0], [2, 1]));
    /// let offsets = tape.constant(Tensor::from_vec(vec![0u32, 2, 3], [3]));
    /// assert_eq!(rays.segment_repeat(&offsets)?.value()?.slice::<f64>(), [5.0, 5.0, 7.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the offsets do not begin with 0 or fall somewhere.
    ///
    /// # Panics
    /// When the operands are not one row for each segment and a list of `u32`.
    #[track_caller]
    pub fn segment_repeat(&self, offsets: &Self) -> Result<Self> {
        let rows = match offsets.tensor().device() {
            crate::Device::Gpu(_) => offsets.tensor().gpu_buffer().indices()?.last().copied(),
            crate::Device::Cpu => offsets.tensor().slice::<u32>().last().copied(),
        };
        let rows = rows.unwrap_or(0) as usize;
        self.tape().apply(Rc::new(SegmentRepeat { rows }), &[self, offsets])
    }
}
