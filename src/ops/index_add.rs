//! `index_add`: adds rows into a tensor of zeros by their numbers. Its derivative is
//! [`index_select`](super::index_select).

use std::rc::Rc;

use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::index_select::check_rows;
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Reads, Var};
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
        ]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("index_add", "main", include_str!("../../kernels/index_add.wgsl"), &["y", "x", "starts", "order"]);

#[derive(Debug)]
struct IndexAdd {
    rows: usize,
}

impl IndexAdd {
    /// In the order of the list, so that the result does not depend on the thread count.
    fn run<T: Element + std::ops::AddAssign>(x: &Tensor, index: &[u32], len: usize) -> Vec<T> {
        let row: usize = x.dims()[1..].iter().product();
        let mut sums = vec![T::zeroed(); len];
        for (&i, values) in index.iter().zip(x.slice::<T>().chunks(row.max(1))) {
            sums[i as usize * row..][..row].iter_mut().zip(values).for_each(|(sum, v)| *sum += *v);
        }
        sums
    }
}

/// The positions of a list of rows sorted by row, and where those of each row start: `rows + 1` numbers.
fn sorted(index: &[u32], rows: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; rows + 1];
    index.iter().for_each(|&row| starts[row as usize + 1] += 1);
    (0..rows).for_each(|row| starts[row + 1] += starts[row]);
    let mut next = starts.clone();
    let mut order = vec![0u32; index.len()];
    for (position, &row) in (0u32..).zip(index) {
        order[next[row as usize] as usize] = position;
        next[row as usize] += 1;
    }
    (starts, order)
}

impl Op for IndexAdd {
    fn name(&self) -> &'static str {
        "index_add"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [x, index] = inputs else { unreachable!("index_add has two operands") };
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

    fn forward_cpu(&self, inputs: &[Tensor]) -> Result<Forward> {
        let [x, index] = inputs else { unreachable!("index_add has two operands") };
        check_rows(self.name(), index.slice(), self.rows)?;
        let shape = self.infer(&[x.spec(), index.spec()])?.shape;
        for_real!(x.dtype(), T => {
            Ok(Tensor::from_vec(Self::run::<T>(x, index.slice(), shape.len()), shape).into())
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: &[Tensor]) -> Result<Forward> {
        let [x, index] = inputs else { unreachable!("index_add has two operands") };
        let rows = index.gpu_buffer().indices()?;
        check_rows(self.name(), rows, self.rows)?;
        let result = self.infer(&[x.spec(), index.spec()])?;
        let on_gpu = |list: Vec<u32>| {
            let len = list.len();
            Tensor::from_vec(list, [len]).to_device(&Device::Gpu(gpu.clone()))
        };
        let (starts, order) = sorted(rows, self.rows);
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
