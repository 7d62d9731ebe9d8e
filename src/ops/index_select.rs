//! `index_select`: rows of a tensor by their numbers. Its derivative is [`index_add`](super::index_add).

use std::rc::Rc;

use crate::backend::cpu::{CHUNK, filled};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{DType, Element, Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "index_select",
    gpu: true,
    cases: || {
        let rows = |index: &[u32]| Tensor::from_vec(index.to_vec(), [index.len()]);
        vec![
            Case::new(IndexSelect, [uniform(1, [5, 3], -1.0..1.0), rows(&[4, 0, 0, 2])]),
            Case::new(IndexSelect, [uniform(1, [5], -1.0..1.0), rows(&[])]),
        ]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("index_select", "main", include_str!("../../kernels/index_select.wgsl"), &["y", "x", "index"]);

#[derive(Debug)]
struct IndexSelect;

impl IndexSelect {
    fn run<T: Element>(x: &Tensor, index: &[u32]) -> Vec<T> {
        let row: usize = x.dims()[1..].iter().product();
        let values = x.slice::<T>();
        let chunk = (CHUNK / row.max(1)).max(1) * row;
        filled(index.len() * row, chunk, |start, part: &mut [T]| {
            if row == 1 {
                part.iter_mut().zip(&index[start..]).for_each(|(out, &i)| *out = values[i as usize]);
            } else if row > 0 {
                let rows = part.chunks_mut(row).zip(&index[start / row..]);
                rows.for_each(|(out, &i)| out.copy_from_slice(&values[i as usize * row..][..row]));
            }
        })
    }
}

/// Fails if an index is not a row.
pub(super) fn check_rows(op: &str, index: &[u32], rows: usize) -> Result<()> {
    match index.iter().position(|&i| i as usize >= rows) {
        None => Ok(()),
        Some(at) => Err(Error::new(ErrorKind::Input, format!("{op}: an index is outside the tensor"))
            .at(format!("index[{at}]"))
            .found(index[at])
            .wanted(format!("below {rows}"))),
    }
}

impl Op for IndexSelect {
    fn name(&self) -> &'static str {
        "index_select"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x, index] = Spec::exactly(self.name(), inputs)?;
        x.real(self.name())?;
        if x.shape.rank() == 0 || index.shape.rank() != 1 || index.dtype != DType::U32 {
            return Err(Error::new(ErrorKind::Shape, "index_select: the operands do not fit")
                .found(format!("{x:?} by {index:?}"))
                .wanted("rows by a list of u32"));
        }
        let mut dims = x.shape.dims().to_vec();
        dims[0] = index.shape.len();
        Ok(Spec::new(dims, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [x, index] = inputs.array();
        check_rows(self.name(), index.slice(), x.dims()[0])?;
        let spec = self.infer(&[x.spec(), index.spec()])?;
        for_real!(x.dtype(), T => Ok(Tensor::from_vec(Self::run::<T>(x, index.slice()), spec.shape).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [x, index] = inputs.array();
        check_rows(self.name(), index.gpu_buffer().indices()?, x.dims()[0])?;
        let result = self.infer(&[x.spec(), index.spec()])?;
        let len = result.shape.len();
        let row: usize = x.dims()[1..].iter().product();
        Ok(gpu.launch(&KERNEL, &[x, index], &words([len, row]), result, Work::Invocations(len))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing().input(1)
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (x, index) = (cx.input(0), cx.input(1));
        Ok(vec![Some(cx.gradient().index_add(index, x.dims()[0])?), None])
    }
}

impl Var {
    /// Rows (along axis 0) by their numbers, a list of `u32`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3, 1]));
    /// let index = tape.constant(Tensor::from_vec(vec![2u32, 0], [2]));
    /// assert_eq!(x.index_select(&index)?.value()?.slice::<f64>(), [3.0, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when an index is not a row.
    ///
    /// # Panics
    /// When `index` is not a list of `u32`.
    #[track_caller]
    pub fn index_select(&self, index: &Self) -> Result<Self> {
        self.tape().apply(Rc::new(IndexSelect), &[self, index])
    }
}
