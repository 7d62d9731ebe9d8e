//! `matmul`: the product of two matrices, each as it is or transposed, alone or in equal batches.
//!
//! On the CPU it stands on the crate's own GEMM (`backend::cpu::gemm`); on a GPU tiles of both
//! operands go through workgroup memory.

use std::rc::Rc;

use rayon::prelude::*;

use crate::backend::cpu::buffer;
use crate::backend::cpu::gemm::{Gemm, Out, Par, Strided};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Reads, Var};
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
        ]
    },
};

pub(super) static KERNEL: Kernel =
    Kernel::new("matmul", "main", include_str!("../../kernels/matmul.wgsl"), &["y", "a", "b"]);

/// Batch size, rows, columns of one operand once its transposition is undone.
type Extent = (usize, usize, usize);

#[derive(Debug)]
pub(crate) struct MatMul {
    /// Which operands are read transposed.
    pub(crate) transposed: [bool; 2],
}

impl MatMul {
    fn extent(&self, operand: usize, shape: &Shape) -> Option<Extent> {
        let (batch, rows, columns) = match *shape.dims() {
            [rows, columns] => (1, rows, columns),
            [batch, rows, columns] => (batch, rows, columns),
            _ => return None,
        };
        Some(if self.transposed[operand] { (batch, columns, rows) } else { (batch, rows, columns) })
    }

    /// Batch size and the three sizes `m, k, n` of `[m,k]·[k,n]`.
    pub(crate) fn sizes(&self, a: &Shape, b: &Shape) -> Option<[usize; 4]> {
        let (left, right) = (self.extent(0, a)?, self.extent(1, b)?);
        let fits = a.rank() == b.rank() && left.0 == right.0 && left.2 == right.1;
        fits.then_some([left.0, left.1, left.2, right.2])
    }

    fn run<T: Real>(&self, a: &Tensor, b: &Tensor) -> Vec<T> {
        let [batch, m, k, n] = self.sizes(a.shape(), b.shape()).expect("checked by infer");
        let mut product = buffer(batch * m * n);
        if product.is_empty() {
            return product;
        }
        let (left, right) = (a.slice::<T>(), b.slice::<T>());
        let one = |i: usize, out: &mut [T], par: Par| {
            let (a, b) = (&left[i * m * k..(i + 1) * m * k], &right[i * k * n..(i + 1) * k * n]);
            let a = if self.transposed[0] { Strided::side_by_side(a, m) } else { Strided::lines(a, k) };
            let b = if self.transposed[1] { Strided::lines(b, k) } else { Strided::side_by_side(b, n) };
            Gemm::new([m, k, n]).run(&a, &b, Out::rows(out, n), par);
        };
        match batch {
            1 => one(0, &mut product, Par::Threads),
            _ => product.par_chunks_mut(m * n).enumerate().for_each(|(i, out)| one(i, out, Par::Sequential)),
        }
        product
    }
}

impl Op for MatMul {
    fn name(&self) -> &'static str {
        "matmul"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [a, b] = inputs else { unreachable!("matmul has two operands") };
        let sizes = self.sizes(&a.shape, &b.shape).filter(|_| a.dtype == b.dtype && a.dtype.is_real());
        let Some([_, m, _, n]) = sizes else {
            return Err(Error::new(ErrorKind::Shape, "matmul: the operands do not fit")
                .found(format!("{a:?} and {b:?}, transposed {:?}", self.transposed))
                .wanted("[m,k]·[k,n] or [batch,m,k]·[batch,k,n], both f32 or both f64"));
        };
        let mut shape = a.shape.dims()[..a.shape.rank() - 2].to_vec();
        shape.extend([m, n]);
        Ok(Spec::new(shape, a.dtype))
    }

    fn forward_cpu(&self, inputs: &[Tensor]) -> Result<Forward> {
        let specs: Vec<_> = inputs.iter().map(Tensor::spec).collect();
        let Spec { shape, dtype } = self.infer(&specs)?;
        for_real!(dtype, T => Ok(Tensor::from_vec(self.run::<T>(&inputs[0], &inputs[1]), shape).into()))
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: &[Tensor]) -> Result<Forward> {
        let [a, b] = inputs else { unreachable!("matmul has two operands") };
        let result = self.infer(&[a.spec(), b.spec()])?;
        let [batch, m, k, n] = self.sizes(a.shape(), b.shape()).expect("checked by infer");
        let [a_row, a_column] = if self.transposed[0] { [1, m] } else { [k, 1] };
        let [b_row, b_column] = if self.transposed[1] { [1, k] } else { [n, 1] };
        let sizes = words([batch, m, k, n, a_row, a_column, b_row, b_column]);
        let tile = KERNEL.reflect()?.constant("TILE");
        let tiles = Work::Groups(batch * m.div_ceil(tile) * n.div_ceil(tile));
        Ok(gpu.launch(&KERNEL, &[a, b], &sizes, result, tiles)?.into())
    }

    fn reads(&self, wanted: &[bool]) -> Reads {
        Reads::nothing().input_if(0, wanted[1]).input_if(1, wanted[0])
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        let (a, b, g) = (cx.input(0), cx.input(1), cx.gradient());
        let product = |x: &Var, y: &Var, transposed| Var::run(Rc::new(MatMul { transposed }), &[x, y]);
        let [ta, tb] = self.transposed;
        let for_a = || if ta { product(b, g, [tb, true]) } else { product(g, b, [false, !tb]) };
        let for_b = || if tb { product(g, a, [true, ta]) } else { product(a, g, [!ta, false]) };
        Ok(vec![cx.wants(0).then(for_a), cx.wants(1).then(for_b)])
    }
}

impl Var {
    /// The matrix product `self · other`: `[m,k]·[k,n]`, or `[batch,m,k]·[batch,k,n]`.
    ///
    /// # Panics
    /// When the shapes or dtypes do not fit.
    #[track_caller]
    #[must_use]
    pub fn matmul(&self, other: &Self) -> Self {
        Self::run(Rc::new(MatMul { transposed: [false, false] }), &[self, other])
    }
}
