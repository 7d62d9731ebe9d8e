//! `matmul`: the product of matrices, each as it is or transposed, alone or in batches that broadcast.
//!
//! On the CPU it stands on the crate's own GEMM (`backend::cpu::gemm`), which reads either layout in place; on a GPU
//! tiles of both operands go through workgroup memory.

use std::rc::Rc;

use rayon::prelude::*;

use crate::backend::cpu::buffer;
use crate::backend::cpu::gemm::{Gemm, Out, Par, Strided};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "matmul",
    gpu: true,
    cases: || {
        let case = |transposed: [bool; 2], a: &[usize], b: &[usize]| {
            Case::new(MatMul { transposed }, [uniform(1, a, -1.0..1.0), uniform(2, b, -1.0..1.0)])
        };
        vec![
            case([false, false], &[3, 4], &[4, 5]),
            case([true, false], &[4, 3], &[4, 5]),
            case([false, true], &[3, 4], &[5, 4]),
            case([true, true], &[4, 3], &[5, 4]),
            case([false, false], &[2, 3, 4], &[2, 4, 5]),
            case([false, true], &[1, 7], &[9, 7]),
            case([false, false], &[17, 1], &[1, 33]),
            case([false, false], &[3, 2, 4], &[4, 5]),
            case([true, true], &[4, 3], &[2, 5, 4]),
            case([true, false], &[2, 1, 2, 3], &[1, 3, 2, 4]),
            case([false, true], &[2, 1, 2, 2, 3], &[3, 1, 4, 3]),
            case([false, false], &[2, 0, 3], &[2, 3, 4]),
        ]
    },
};

const TEXT: &str = include_str!("../../kernels/matmul.wgsl");
pub(super) static KERNEL: Kernel = Kernel::new("matmul", "main", TEXT, &["y", "a", "b"]);
pub(super) static BIASED: Kernel = Kernel::new("matmul", "biased", TEXT, &["y", "a", "b", "bias"]);

#[derive(Debug)]
pub(crate) struct MatMul {
    /// Which operands are read transposed.
    pub(crate) transposed: [bool; 2],
}

/// What a product is made of: `[m, k] · [k, n]` for each element of a batch.
pub(super) struct Product {
    transposed: [bool; 2],
    /// Sizes of the batch's axes.
    batch: Shape,
    /// The axes of the batch that are left after merging: size, and distance between neighbours in either operand.
    axes: Vec<[usize; 3]>,
    pub(super) m: usize,
    pub(super) k: usize,
    pub(super) n: usize,
}

impl Product {
    /// The product of two shapes, or `None` where they do not fit.
    pub(super) fn new(transposed: [bool; 2], a: &Shape, b: &Shape) -> Option<Self> {
        let split = |shape: &Shape, transposed: bool| {
            let rank = shape.rank().checked_sub(2)?;
            let (batch, matrix) = shape.dims().split_at(rank);
            let [rows, columns] = if transposed { [matrix[1], matrix[0]] } else { [matrix[0], matrix[1]] };
            Some((Shape::from(batch), rows, columns))
        };
        let ((a_batch, m, k), (b_batch, depth, n)) = (split(a, transposed[0])?, split(b, transposed[1])?);
        let batch = a_batch.broadcast(&b_batch).ok().filter(|_| k == depth)?;
        let mut axes: Vec<[usize; 3]> = Vec::new();
        let (a_steps, b_steps) = (steps(&a_batch, batch.rank(), m * k), steps(&b_batch, batch.rank(), k * n));
        for (&size, (a, b)) in batch.dims().iter().zip(a_steps.into_iter().zip(b_steps)).filter(|(size, _)| **size != 1)
        {
            match axes.last_mut() {
                Some(outer) if outer[1] == size * a && outer[2] == size * b => *outer = [outer[0] * size, a, b],
                _ => axes.push([size, a, b]),
            }
        }
        Some(Self { transposed, batch, axes, m, k, n })
    }

    fn shape(&self) -> Shape {
        let mut shape = self.batch.dims().to_vec();
        shape.extend([self.m, self.n]);
        Shape::from(shape)
    }

    /// Where the operands of an element of the batch begin.
    fn starts(&self, number: usize) -> [usize; 2] {
        let (mut starts, mut rest) = ([0, 0], number);
        for [size, a, b] in self.axes.iter().rev() {
            starts = [starts[0] + rest % size * a, starts[1] + rest % size * b];
            rest /= size;
        }
        starts
    }

    /// Makes the products on the CPU, with a bias added to each column.
    pub(super) fn run<T: Real>(&self, a: &Tensor, b: &Tensor, bias: Option<&Tensor>) -> Vec<T> {
        let Self { m, k, n, .. } = *self;
        let count = self.batch.len();
        let mut product = buffer(count * m * n);
        if product.is_empty() {
            return product;
        }
        let (left, right, bias) = (a.slice::<T>(), b.slice::<T>(), bias.map(Tensor::slice::<T>));
        let one = |(i, out): (usize, &mut [T]), par: Par| {
            let [a, b] = self.starts(i);
            let (a, b) = (&left[a..a + m * k], &right[b..b + k * n]);
            let a = if self.transposed[0] { Strided::side_by_side(a, m) } else { Strided::lines(a, k) };
            let b = if self.transposed[1] { Strided::lines(b, k) } else { Strided::side_by_side(b, n) };
            Gemm::new([m, k, n]).column_bias(bias).run(&a, &b, Out::rows(out, n), par);
        };
        // a few large products are shared out one after another, many or small ones are taken whole
        let spread = count >= 2 * rayon::current_num_threads() && count * m * k * n >= SPREAD;
        let products = product.chunks_mut(m * n).enumerate();
        if spread {
            product.par_chunks_mut(m * n).enumerate().for_each(|part| one(part, Par::Sequential));
        } else {
            products.for_each(|part| one(part, Par::Threads));
        }
        product
    }

    /// Makes the products on a GPU.
    pub(super) fn launch(&self, gpu: &Gpu, operands: &[&Tensor], result: Spec) -> Result<Tensor> {
        let Self { m, k, n, .. } = *self;
        let kernel = if operands.len() == 3 { &BIASED } else { &KERNEL };
        let reflected = kernel.reflect()?;
        let (tile, most) = (reflected.constant("TILE"), reflected.constant("AXES"));
        if self.axes.len() > most {
            return Err(Error::new(ErrorKind::Unsupported, "matmul: too many axes of the batch for its WGSL kernel")
                .found(format!("{} axes that cannot be merged", self.axes.len()))
                .wanted(format!("at most {most}"))
                .fix("stretch the smaller operand with broadcast_to, or reshape both"));
        }
        let [a_row, a_column] = if self.transposed[0] { [1, m] } else { [k, 1] };
        let [b_row, b_column] = if self.transposed[1] { [1, k] } else { [n, 1] };
        let count = self.batch.len();
        let mut sizes = words([count, m, k, n, a_row, a_column, b_row, b_column]).to_vec();
        let unused = std::iter::repeat_n(&[1, 0, 0], most - self.axes.len());
        sizes.extend(unused.chain(&self.axes).flat_map(|[size, a, b]| words([*size, *a, *b, 0])));
        let tiles = Work::Groups(count * m.div_ceil(tile) * n.div_ceil(tile));
        gpu.launch(kernel, operands, &sizes, result, tiles)
    }
}

/// Multiply-adds from which on a batch is spread over the threads.
const SPREAD: usize = 1 << 18;

/// For each axis of a batch of `rank` axes, the distance between neighbours in an operand: 0 along a stretched one.
fn steps(operand: &Shape, rank: usize, matrix: usize) -> Vec<usize> {
    let (pad, strides) = (rank - operand.rank(), operand.strides());
    let step =
        |axis: usize| axis.checked_sub(pad).filter(|&a| operand.dims()[a] > 1).map_or(0, |a| strides[a] * matrix);
    (0..rank).map(step).collect()
}

impl Op for MatMul {
    fn name(&self) -> &'static str {
        "matmul"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [a, b] = Spec::exactly(self.name(), inputs)?;
        let product = Product::new(self.transposed, &a.shape, &b.shape);
        let Some(product) = product.filter(|_| a.dtype == b.dtype && a.dtype.is_real()) else {
            let side = |transposed: bool, plain, turned| if transposed { turned } else { plain };
            let (left, right) = (side(self.transposed[0], "m,k", "k,m"), side(self.transposed[1], "k,n", "n,k"));
            return Err(Error::new(ErrorKind::Shape, "matmul: the operands do not fit")
                .found(format!("{a:?} and {b:?}"))
                .wanted(format!("[..,{left}] and [..,{right}], axes in front equal or 1, both f32 or both f64"))
                .fix("matmul_transposed and transposed_matmul read an operand transposed; to_dtype casts"));
        };
        Ok(Spec::new(product.shape(), a.dtype))
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let (a, b) = (&inputs[0], &inputs[1]);
        let product = Product::new(self.transposed, a.shape(), b.shape()).expect("checked by infer");
        for_real!(a.dtype(), T => Ok(Tensor::from_vec(product.run::<T>(a, b, None), product.shape()).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let (a, b) = (&inputs[0], &inputs[1]);
        let product = Product::new(self.transposed, a.shape(), b.shape()).expect("checked by infer");
        Ok(product.launch(gpu, &[a, b], Spec::new(product.shape(), a.dtype()))?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        Reads::nothing().input_if(0, wanted[1]).input_if(1, wanted[0])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (a, b, g) = (cx.input(0), cx.input(1), cx.gradient());
        let [ta, tb] = self.transposed;
        let for_a = || if ta { product(b, g, [tb, true]) } else { product(g, b, [false, !tb]) };
        let for_b = || if tb { product(g, a, [true, ta]) } else { product(a, g, [!ta, false]) };
        Ok(vec![
            cx.wants(0).then(|| add_stretched(&for_a(), a.shape())),
            cx.wants(1).then(|| add_stretched(&for_b(), b.shape())),
        ])
    }
}

/// Adds up the axes along which an operand of this shape was stretched.
fn add_stretched(gradient: &Var, shape: &Shape) -> Var {
    let pad = gradient.shape().rank() - shape.rank();
    let stretched = |axis: &usize| *axis < pad || (shape.dims()[axis - pad] == 1 && gradient.dims()[*axis] != 1);
    let axes: Vec<usize> = (0..gradient.shape().rank()).filter(stretched).collect();
    if axes.is_empty() { gradient.clone() } else { gradient.sum(&axes).reshape(shape) }
}

/// A product of variables. One matrix times a batch of others is a single product where the layout allows it.
#[track_caller]
pub(super) fn product(a: &Var, b: &Var, transposed: [bool; 2]) -> Var {
    let run = |a: &Var, b: &Var| Var::run(Rc::new(MatMul { transposed }), &[a, b]);
    if a.shape().rank() <= 2 || b.shape().rank() != 2 || transposed[0] || a.is_empty() {
        return run(a, b);
    }
    let (batch, columns) = a.dims().split_at(a.shape().rank() - 1);
    let rows = run(&a.reshape([batch.iter().product(), columns[0]]), b);
    let mut shape = batch.to_vec();
    shape.push(rows.dims()[1]);
    rows.reshape(shape)
}

impl Var {
    /// The matrix product `self · other`: `[.., m, k] · [.., k, n]` gives `[.., m, n]`.
    ///
    /// Axes in front of the matrices are a batch: aligned at the last one, and an axis of size 1, or a missing one,
    /// stretches.
    ///
    /// ```
    /// use gradreel::{DType, Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let rotations = tape.constant(Tensor::full(1.0, [10, 3, 3], DType::F32));
    /// let points = tape.constant(Tensor::full(1.0, [3, 50], DType::F32));
    /// assert_eq!(rotations.matmul(&points).dims(), [10, 3, 50]);
    /// ```
    ///
    /// # Panics
    /// When the shapes or dtypes do not fit.
    #[track_caller]
    #[must_use]
    pub fn matmul(&self, other: &Self) -> Self {
        product(self, other, [false, false])
    }

    /// The product `self · otherᵀ` with the last two axes of `other` exchanged: `[.., m, k]` and `[.., n, k]` give
    /// `[.., m, n]`. Nothing is copied for the transposition; a batch is as in [`Var::matmul`].
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [1, 2]));
    /// let y = tape.leaf(Tensor::from_vec(vec![3.0, 4.0, 5.0, 6.0], [2, 2]));
    /// assert_eq!(x.matmul_transposed(&y).value()?.slice::<f64>(), [11.0, 17.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes or dtypes do not fit.
    #[track_caller]
    #[must_use]
    pub fn matmul_transposed(&self, other: &Self) -> Self {
        product(self, other, [false, true])
    }

    /// The product `selfᵀ · other` with the last two axes of `self` exchanged: `[.., k, m]` and `[.., k, n]` give
    /// `[.., m, n]`. Nothing is copied for the transposition; a batch is as in [`Var::matmul`].
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2, 1]));
    /// let y = tape.leaf(Tensor::from_vec(vec![3.0, 4.0], [2, 1]));
    /// assert_eq!(x.transposed_matmul(&y).item()?, 11.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes or dtypes do not fit.
    #[track_caller]
    #[must_use]
    pub fn transposed_matmul(&self, other: &Self) -> Self {
        product(self, other, [true, false])
    }
}
