//! The ops: one file each, and one list.
//!
//! A **pointwise** op is a [`Pointwise`]: one function of [`Scalar`](crate::scalar::Scalar)s, traced once, from which
//! come its CPU loop, its WGSL kernel and its derivative. Every other op implements [`crate::Op`] with its shape rule,
//! its forward pass per backend, and its derivative written in ops.
//!
//! Being in [`registry`] buys an op its gradient check in `f64`, the comparison of `f32` with `f64`, the comparison of
//! the GPU with the CPU where it has a kernel, and the empty-shape and non-finite tests of `tests/ops.rs`.

mod abs;
mod add;
mod broadcast_to;
mod concat;
mod density_to_alpha;
mod div;
mod exp;
pub(crate) mod grid;
mod grid_sample;
mod grid_scatter;
mod index_add;
mod index_select;
mod ln;
mod logistic;
mod map;
mod matmul;
mod maximum;
mod minimum;
mod mul;
mod neg;
mod pad;
mod permute;
mod powf;
mod ray_transmittance;
mod ray_weights;
mod relu;
mod reshape;
mod segment_repeat;
mod segment_sum;
mod segments;
mod slice;
mod softplus;
mod sqrt;
mod square;
mod sub;
mod sum;
mod tanh;

use std::rc::Rc;

pub use grid::{GridSampling, Interpolation, Lattice, Padding};
pub use map::{Map, Pointwise};
pub use segments::segment_offsets;

use crate::backend::gpu::{Kernel, SORT_BLOCKS, SORT_STEPS, SORT_TAILS, STRIDED};
use crate::{Key, Op, Shape, Tensor};

/// An op of the crate with the cases its tests feed it.
pub struct Entry {
    /// The op's name.
    pub name: &'static str,
    /// Whether it has a WGSL kernel; the comparison with the CPU runs where it has.
    pub gpu: bool,
    /// What the shared tests feed it, including the places where it could break.
    pub cases: fn() -> Vec<Case>,
}

/// One application of an op to fixed inputs: `f64`, or `u32` for indices.
pub struct Case {
    /// The op with its settings.
    pub op: Rc<dyn Op>,
    /// Its operands.
    pub inputs: Vec<Tensor>,
}

impl Case {
    /// An op applied to these operands.
    pub fn new(op: impl Op, inputs: impl Into<Vec<Tensor>>) -> Self {
        Self { op: Rc::new(op), inputs: inputs.into() }
    }
}

/// Uniform numbers in `range`, the same ones at every call with the same seed.
pub fn uniform(seed: u64, shape: impl Into<Shape>, range: std::ops::Range<f64>) -> Tensor {
    let shape = shape.into();
    let values: Vec<f64> =
        Key::new(seed).uniform(shape.len()).map(|u| range.start + u * (range.end - range.start)).collect();
    Tensor::from_vec(values, shape)
}

/// Every op of the crate. Adding one here adds its tests.
pub fn registry() -> Vec<Entry> {
    vec![
        abs::ABS.entry(),
        add::ADD.entry(),
        density_to_alpha::DENSITY_TO_ALPHA.entry(),
        div::DIV.entry(),
        exp::EXP.entry(),
        ln::LN.entry(),
        logistic::LOGISTIC.entry(),
        maximum::MAXIMUM.entry(),
        minimum::MINIMUM.entry(),
        mul::MUL.entry(),
        neg::NEG.entry(),
        powf::POWF.entry(),
        relu::RELU.entry(),
        softplus::SOFTPLUS.entry(),
        sqrt::SQRT.entry(),
        square::SQUARE.entry(),
        sub::SUB.entry(),
        tanh::TANH.entry(),
        broadcast_to::ENTRY,
        concat::ENTRY,
        grid_sample::ENTRY,
        grid_scatter::ENTRY,
        index_add::ENTRY,
        index_select::ENTRY,
        matmul::ENTRY,
        pad::ENTRY,
        permute::ENTRY,
        ray_transmittance::ENTRY,
        ray_weights::ENTRY,
        reshape::ENTRY,
        segment_repeat::ENTRY,
        segment_sum::ENTRY,
        slice::ENTRY,
        sum::ENTRY,
    ]
}

/// Every kernel of the crate but those made around scalar programs ([`Map::kernel`]). Adding one here adds its tests.
pub fn kernels() -> Vec<&'static Kernel> {
    vec![
        &concat::KERNEL,
        &grid_sample::SAMPLE,
        &grid_sample::SLOPE,
        &grid_scatter::CELLS,
        &grid_scatter::GATHER,
        &grid_scatter::STARTS,
        &index_add::KERNEL,
        &index_select::KERNEL,
        &matmul::KERNEL,
        &pad::KERNEL,
        &SORT_BLOCKS,
        &SORT_STEPS,
        &SORT_TAILS,
        &ray_transmittance::LEFT,
        &ray_transmittance::SLOPE,
        &ray_weights::SLOPE,
        &ray_weights::WEIGHTS,
        &segment_repeat::KERNEL,
        &segment_sum::KERNEL,
        &STRIDED,
        &sum::ROWS,
        &sum::TREE,
    ]
}
