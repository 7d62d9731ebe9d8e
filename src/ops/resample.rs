//! `resample`: along one axis, each place of the result is a weighted sum of a few places of the operand. The derivative is
//! the same op with the transposed table of weights, so any order of derivative works. Nearest and linear resizing and average
//! pooling are made of it, axis by axis.

use std::rc::Rc;
use std::sync::Arc;

use rayon::prelude::*;

use crate::backend::cpu::{CHUNK, buffer};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Device, Error, ErrorKind, Result, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "resample",
    gpu: true,
    cases: || {
        let case = |axis: usize, shape: [usize; 3], rows: &[&[(usize, f64)]]| {
            let table = Table::new(shape[axis], rows.iter().map(|row| row.to_vec()));
            Case::new(Resample { axis, table: Arc::new(table) }, [uniform(1, shape, -1.0..1.0)])
        };
        let mixed: &[&[(usize, f64)]] =
            &[&[(0, 1.0)], &[(0, 0.25), (2, 0.5), (1, -2.0)], &[(2, 0.75), (1, 0.25)], &[(1, 1.0)]];
        vec![
            case(1, [2, 3, 4], mixed),
            case(2, [3, 2, 3], mixed),
            case(0, [3, 1, 17], mixed),
            case(2, [1, 1, 5], &[&[(4, 1.0)], &[], &[(0, 0.5)]]),
        ]
    },
};

pub(super) static KERNEL: Kernel = Kernel::new(
    "resample",
    "main",
    include_str!("../../kernels/resample.wgsl"),
    &["y", "x", "starts", "places", "weights"],
);

/// A sparse matrix by rows: row `r` holds the entries `starts[r]..starts[r + 1]`.
#[derive(Debug)]
pub(super) struct Table {
    /// Number of columns: places of the operand.
    from: usize,
    starts: Vec<u32>,
    places: Vec<u32>,
    weights: Vec<f64>,
}

impl Table {
    /// The table whose rows are these places, below `from`, with their weights.
    pub(super) fn new(from: usize, rows: impl Iterator<Item = Vec<(usize, f64)>>) -> Self {
        let mut table = Self { from, starts: vec![0], places: Vec::new(), weights: Vec::new() };
        for row in rows {
            for (place, weight) in row {
                table.places.push(index(place));
                table.weights.push(weight);
            }
            table.starts.push(index(table.places.len()));
        }
        table
    }

    /// Places of the result.
    fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        range.map(|i| (self.places[i] as usize, self.weights[i]))
    }

    fn transposed(&self) -> Self {
        let mut rows = vec![Vec::new(); self.from];
        for row in 0..self.rows() {
            self.row(row).for_each(|(place, weight)| rows[place].push((row, weight)));
        }
        Self::new(self.rows(), rows.into_iter())
    }
}

#[allow(clippy::cast_possible_truncation)]
fn index(place: usize) -> u32 {
    place as u32
}

#[derive(Debug)]
pub(super) struct Resample {
    axis: usize,
    table: Arc<Table>,
}

impl Resample {
    /// Elements in front of the axis (as blocks), and behind it.
    fn around(&self, dims: &[usize]) -> (usize, usize) {
        (dims[..self.axis].iter().product(), dims[self.axis + 1..].iter().product())
    }

    fn run<T: Real>(&self, x: &Tensor) -> Vec<T> {
        let (outer, inner) = self.around(x.dims());
        let table = &*self.table;
        let (from, to) = (table.from * inner, table.rows() * inner);
        let values = x.slice::<T>();
        let mut result = buffer::<T>(outer * to);
        if result.is_empty() {
            return result;
        }
        let weights: Vec<T> = table.weights.iter().map(|&weight| T::from_f64(weight)).collect();
        let alone =
            table.places.len() == table.rows() && table.starts.iter().zip(0..).all(|(start, row)| *start == row);
        let block = |x: &[T], y: &mut [T], first: usize| {
            if inner == 1 && alone {
                // one neighbour each, side by side
                let (places, weights) = (&table.places[first..][..y.len()], &weights[first..][..y.len()]);
                for i in 0..y.len() {
                    y[i] = x[places[i] as usize] * weights[i];
                }
                return;
            }
            for (row, y) in (first..).zip(y.chunks_exact_mut(inner)) {
                let terms = table.starts[row] as usize..table.starts[row + 1] as usize;
                let (places, weights) = (&table.places[terms.clone()], &weights[terms]);
                match (places, weights) {
                    (&[a], &[w]) => {
                        let a = &x[a as usize * inner..][..inner];
                        for i in 0..inner {
                            y[i] = a[i] * w;
                        }
                    }
                    (&[a, b], &[u, v]) => {
                        let (a, b) = (&x[a as usize * inner..][..inner], &x[b as usize * inner..][..inner]);
                        for i in 0..inner {
                            y[i] = a[i] * u + b[i] * v;
                        }
                    }
                    _ => {
                        y.fill(T::ZERO);
                        for (&a, &w) in places.iter().zip(weights) {
                            let a = &x[a as usize * inner..][..inner];
                            for i in 0..inner {
                                y[i] += a[i] * w;
                            }
                        }
                    }
                }
            }
        };
        if to <= CHUNK {
            // many small blocks: some for each piece of work
            let blocks = (CHUNK / to).max(1);
            let pieces = result.par_chunks_mut(blocks * to).enumerate();
            pieces.for_each(|(i, y)| {
                for (j, y) in y.chunks_exact_mut(to).enumerate() {
                    block(&values[(i * blocks + j) * from..][..from], y, 0);
                }
            });
        } else {
            let rows = (CHUNK / inner).max(1);
            result.par_chunks_mut(to).enumerate().for_each(|(i, y)| {
                let x = &values[i * from..][..from];
                y.par_chunks_mut(rows * inner).enumerate().for_each(|(j, y)| block(x, y, j * rows));
            });
        }
        result
    }
}

impl Op for Resample {
    fn name(&self) -> &'static str {
        "resample"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = Spec::one_real(self.name(), inputs)?;
        let mut dims = x.shape.dims().to_vec();
        match dims.get_mut(self.axis) {
            Some(size) if *size == self.table.from && x.dtype.is_real() => *size = self.table.rows(),
            _ => {
                return Err(Error::new(ErrorKind::Shape, "resample: the operand does not fit the table")
                    .found(format!("axis {} of {x:?}", self.axis))
                    .wanted(format!("an axis of size {} of an f32 or f64 tensor", self.table.from)));
            }
        }
        Ok(Spec::new(dims, x.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let Spec { shape, dtype } = self.infer(&[inputs[0].spec()])?;
        for_real!(dtype, T => Ok(Tensor::from_vec(self.run::<T>(&inputs[0]), shape).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let result = self.infer(&[inputs[0].spec()])?;
        let device = Device::Gpu(gpu.clone());
        let list = |values: &[u32]| Tensor::from_vec(values.to_vec(), [values.len()]).to_device(&device);
        // an empty buffer cannot be bound
        let pad = usize::from(self.table.places.is_empty());
        let places = [self.table.places.as_slice(), &[0; 1][..pad]].concat();
        let weights: Vec<f64> = [self.table.weights.as_slice(), &[0.0; 1][..pad]].concat();
        let weights = Tensor::from_vec(weights, [places.len()]).cast(crate::DType::F32)?.to_device(&device)?;
        let (starts, places) = (list(&self.table.starts)?, list(&places)?);
        let (len, (_, inner)) = (result.shape.len(), self.around(inputs[0].dims()));
        let sizes = words([len, inner, self.table.rows(), self.table.from]);
        let operands = [&inputs[0], &starts, &places, &weights];
        Ok(gpu.launch(&KERNEL, &operands, &sizes, result, Work::Invocations(len))?.into())
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::nothing()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        Ok(vec![Some(resample(cx.gradient(), self.axis, self.table.transposed()))])
    }
}

/// Applies a table along one axis.
#[track_caller]
pub(super) fn resample(x: &Var, axis: usize, table: Table) -> Var {
    Var::run(Rc::new(Resample { axis, table: Arc::new(table) }), &[x])
}
