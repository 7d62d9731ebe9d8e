//! `index_add`: adds rows into a tensor of zeros by their numbers. Its derivative is
//! [`index_select`](super::index_select).

use std::rc::Rc;

use rayon::prelude::*;

use crate::backend::cpu::{Bins, buffer, partition};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::index_select::check_rows;
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{DType, Device, Element, Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "index_add",
    gpu: true,
    cases: || {
        let rows = |index: &[u32]| Tensor::from_vec(index.to_vec(), [index.len()]);
        vec![
            Case::new(IndexAdd { rows: 5 }, [uniform(1, [4, 3], -1.0..1.0), rows(&[4, 0, 0, 2])]),
            Case::new(IndexAdd { rows: 3 }, [uniform(1, [2], -1.0..1.0), rows(&[1, 1])]),
            Case::new(IndexAdd { rows: 2 }, [uniform(1, [0, 3], -1.0..1.0), rows(&[])]),
        ]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("index_add", "main", include_str!("../../kernels/index_add.wgsl"), &["y", "x", "starts", "order"]);

#[derive(Debug)]
struct IndexAdd {
    rows: usize,
}

/// Elements below which one thread adds up what there is.
const SERIAL: usize = 1 << 15;

impl IndexAdd {
    /// In the order of the list, so that the result does not depend on the thread count: each thread has some rows of the
    /// result, goes through the whole list, and adds what is meant for them.
    fn run<T: Element + std::ops::AddAssign>(x: &Tensor, index: &[u32], rows: usize) -> Vec<T> {
        let row: usize = x.dims()[1..].iter().product();
        let values = x.slice::<T>();
        let mut sums: Vec<T> = buffer(rows * row);
        let threads = if values.len() < SERIAL { 1 } else { rayon::current_num_threads() };
        let part = rows.div_ceil(threads).max(1);
        if threads == 1 {
            add_rows(values, index, 0, row, &mut sums);
        } else {
            let parts = sums.par_chunks_mut((part * row).max(1)).enumerate();
            parts.for_each(|(i, sums)| add_rows(values, index, i * part, row, sums));
        }
        sums
    }
}

/// Sums of those rows that go to the rows of the result from `first` on that `sums` holds.
fn add_rows<T: Element + std::ops::AddAssign>(values: &[T], index: &[u32], first: usize, row: usize, sums: &mut [T]) {
    sums.fill(T::zeroed());
    if row == 1 {
        for (value, &at) in values.iter().zip(index) {
            if let Some(sum) = sums.get_mut((at as usize).wrapping_sub(first)) {
                *sum += *value;
            }
        }
        return;
    }
    for (values, &at) in values.chunks_exact(row.max(1)).zip(index) {
        let start = (at as usize).wrapping_sub(first).wrapping_mul(row);
        let rows = if at as usize >= first { sums.get_mut(start..start + row) } else { None };
        if let Some(sums) = rows {
            sums.iter_mut().zip(values).for_each(|(sum, v)| *sum += *v);
        }
    }
}

impl Op for IndexAdd {
    fn name(&self) -> &'static str {
        "index_add"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x, index] = Spec::exactly(self.name(), inputs)?;
        x.real(self.name())?;
        let fits = x.shape.rank() > 0 && index.shape.dims() == &x.shape.dims()[..1] && index.dtype == DType::U32;
        if !fits {
            return Err(Error::new(ErrorKind::Shape, "index_add: the operands do not fit")
                .found(format!("{x:?} by {index:?}"))
                .wanted("rows and one u32 for each"));
        }
        let mut dims = x.shape.dims().to_vec();
        dims[0] = self.rows;
        Ok(Spec::new(dims, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [x, index] = inputs.array();
        check_rows(self.name(), index.slice(), self.rows)?;
        let shape = self.infer(&[x.spec(), index.spec()])?.shape;
        for_real!(x.dtype(), T => {
            Ok(Tensor::from_vec(Self::run::<T>(x, index.slice(), self.rows), shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [x, index] = inputs.array();
        let rows = index.gpu_buffer().indices()?;
        check_rows(self.name(), rows, self.rows)?;
        let result = self.infer(&[x.spec(), index.spec()])?;
        let on_gpu = |list: Vec<u32>| {
            let len = list.len();
            Tensor::from_vec(list, [len]).to_device(&Device::Gpu(gpu.clone()))
        };
        let Bins { starts, order } = partition(rows, self.rows);
        let (starts, order) = (on_gpu(starts)?, on_gpu(order)?);
        let len = result.shape.len();
        let row: usize = x.dims()[1..].iter().product();
        let sizes = words([len, row]);
        Ok(gpu.launch(&KERNEL, &[x, &starts, &order], &sizes, result, Work::Invocations(len))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing().input(1)
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(cx.gradient().index_select(cx.input(1))?), None])
    }
}

impl Var {
    /// Adds these rows (axis 0) into `rows` rows of zeros, each at its number in `index`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let rows = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3, 1]));
    /// let index = tape.constant(Tensor::from_vec(vec![1u32, 0, 1], [3]));
    /// assert_eq!(rows.index_add(&index, 2)?.value()?.slice::<f64>(), [2.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when an index is not below `rows`.
    ///
    /// # Panics
    /// When `index` has not one `u32` for each row.
    #[track_caller]
    pub fn index_add(&self, index: &Self, rows: usize) -> Result<Self> {
        self.tape().apply(Rc::new(IndexAdd { rows }), &[self, index])
    }
}
