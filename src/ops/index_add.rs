//! `index_add`: adds rows into a tensor of zeros by their numbers. Its derivative is
//! [`index_select`](super::index_select).

use std::rc::Rc;

use rayon::prelude::*;

use crate::backend::cpu::{Bins, CHUNK, buffer, filled, partition};
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
    /// In the order of the list, so that the result does not depend on the thread count.
    ///
    /// Of a long list the places are first sorted by blocks of the result, which are then filled in parallel.
    fn run<T: Element + std::ops::AddAssign>(x: &Tensor, index: &[u32], rows: usize) -> Vec<T> {
        let row: usize = x.dims()[1..].iter().product();
        let values = x.slice::<T>();
        let mut sums: Vec<T> = buffer(rows * row);
        let add = |sums: &mut [T], place: usize, at: usize| {
            if row == 1 {
                sums[at] += values[place];
            } else {
                let from = &values[place * row..][..row];
                sums[at * row..][..row].iter_mut().zip(from).for_each(|(sum, v)| *sum += *v);
            }
        };
        if values.len() < SERIAL || rows < 2 {
            sums.fill(T::zeroed());
            index.iter().enumerate().for_each(|(place, &at)| add(&mut sums, place, at as usize));
            return sums;
        }
        // a power of two of rows to a block, some 64 blocks
        let shift = rows.div_ceil(64).next_power_of_two().trailing_zeros();
        let blocks: Vec<u32> = filled(index.len(), CHUNK, |start, part| {
            part.iter_mut().zip(&index[start..]).for_each(|(block, &at)| *block = at >> shift);
        });
        let bins = partition(&blocks, rows.div_ceil(1 << shift));
        sums.par_chunks_mut((row << shift).max(1)).enumerate().for_each(|(block, sums)| {
            sums.fill(T::zeroed());
            for &place in bins.positions(block, block + 1) {
                add(sums, place as usize, index[place as usize] as usize - (block << shift));
            }
        });
        sums
    }
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
            Ok(Tensor::from_vec(Self::run::<T>(x, index.slice(), self.rows), shape).into())
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
