//! What reductions over axes have in common: shape rule, layout, and the two ways of running them.

use crate::backend::cpu::reduce::{Fold, reduce};
use crate::backend::gpu::{Gpu, GpuBuffer, Kernel, Strides, Work, words};
use crate::ops::concat;
use crate::scalar::Real;
use crate::{DType, Error, ErrorKind, Result, Shape, Spec, Tensor, Var};

const TEXT: &str = include_str!("../../kernels/reduce.wgsl");
/// One invocation for each span.
pub(super) static ROWS: Kernel = Kernel::new("reduce", "rows", TEXT, &["y", "x"]);
/// One workgroup for each span.
pub(super) static TREE: Kernel = Kernel::new("reduce", "tree", TEXT, &["y", "x"]);

/// Results from which on an invocation for each keeps a GPU busy.
const MANY: usize = 1 << 14;

/// What a kernel does with two numbers, and the number that changes nothing. Twin of `kernels/reduce.wgsl`.
#[derive(Debug, Clone, Copy)]
pub(super) enum Join {
    Sum,
    Max,
    Min,
    Product,
}

impl Join {
    /// Its number in the kernel, and the bits of its neutral element.
    fn words(self) -> [usize; 2] {
        let neutral: f32 = match self {
            Self::Sum => 0.0,
            Self::Max => f32::NEG_INFINITY,
            Self::Min => f32::INFINITY,
            Self::Product => 1.0,
        };
        [self as usize, neutral.to_bits() as usize]
    }
}

/// The axes that a reduction drops: strictly increasing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Axes(Vec<usize>);

impl Axes {
    /// These axes, in any order.
    pub(super) fn new(axes: &[usize]) -> Self {
        let mut axes = axes.to_vec();
        axes.sort_unstable();
        axes.dedup();
        Self(axes)
    }

    pub(super) fn contains(&self, axis: usize) -> bool {
        self.0.contains(&axis)
    }

    /// What is left of a shape.
    pub(super) fn kept(&self, shape: &Shape) -> Shape {
        let kept = shape.dims().iter().enumerate().filter(|(axis, _)| !self.contains(*axis));
        Shape::from(kept.map(|(_, size)| *size).collect::<Vec<_>>())
    }

    /// The shape with every dropped axis left in place with size 1: what stretches back to the whole.
    pub(super) fn with_ones(&self, shape: &Shape) -> Shape {
        let size = |(axis, size): (usize, &usize)| if self.contains(axis) { 1 } else { *size };
        Shape::from(shape.dims().iter().enumerate().map(size).collect::<Vec<_>>())
    }

    /// The axes that are dropped, or those that are kept, as a walk through the operand.
    pub(super) fn walk(&self, shape: &Shape, dropped: bool) -> Strides {
        let axes = shape.dims().iter().copied().zip(shape.strides()).enumerate();
        Strides::new(axes.filter(|(axis, _)| self.contains(*axis) == dropped).map(|(_, extent)| extent))
    }

    /// The shape rule.
    pub(super) fn infer(&self, op: &str, x: &Spec) -> Result<Spec> {
        let rank = x.shape.rank();
        if self.0.iter().any(|&axis| axis >= rank) {
            return Err(Error::new(ErrorKind::Shape, format!("{op}: no such axis"))
                .found(format!("axes {:?} of {x:?}", self.0))
                .wanted(format!("axes below {rank}")));
        }
        Ok(Spec::new(self.kept(&x.shape), x.dtype))
    }

    /// The shape rule of what has no value for no elements.
    pub(super) fn infer_some(&self, op: &str, x: &Spec) -> Result<Spec> {
        let result = self.infer(op, x)?;
        if x.shape.is_empty() && !result.shape.is_empty() {
            return Err(Error::new(ErrorKind::Shape, format!("{op} of no elements does not exist"))
                .found(format!("axes {:?} of {x:?}", self.0))
                .wanted("axes that are not empty"));
        }
        Ok(result)
    }

    /// Whether the places of the dropped axes can be numbered by `u32`.
    pub(super) fn check_numbers(&self, op: &str, shape: &Shape) -> Result<()> {
        let count = self.walk(shape, true).len();
        if u32::try_from(count).is_ok() {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Unsupported, format!("{op}: too many elements to number by u32")).found(count))
    }

    /// Runs it on the CPU.
    pub(super) fn on_cpu<T: Real, F: Fold<T>>(&self, x: &Tensor) -> Tensor {
        let (kept, dropped) = (self.walk(x.shape(), false), self.walk(x.shape(), true));
        Tensor::from_vec(reduce::<T, F>(x.slice(), kept.axes(), dropped.axes()), self.kept(x.shape()))
    }

    /// Runs it on a GPU, along a tree whose shape depends on the operand's alone (and, where that does not fit one
    /// binding, on the size of a binding).
    pub(super) fn on_gpu(&self, gpu: &Gpu, op: &str, x: &Tensor, join: Join) -> Result<Tensor> {
        if x.dtype() != DType::F32 {
            return Err(Error::new(ErrorKind::Unsupported, format!("{op} computes in f32 on a GPU"))
                .found(format!("{x:?}"))
                .fix("cast it to f32"));
        }
        if x.len() > gpu.part_len() {
            return self.by_parts(gpu, op, x, join);
        }
        let (mut kept, mut dropped) = (self.walk(x.shape(), false), self.walk(x.shape(), true));
        let mut partial = x.clone();
        loop {
            let (results, count) = (kept.len(), dropped.len());
            let rows = results >= MANY || count <= ROWS.reflect()?.constant("ROWS_SPAN");
            let (kernel, span) = if rows { (&ROWS, "ROWS_SPAN") } else { (&TREE, "TREE_SPAN") };
            let spans = count.div_ceil(kernel.reflect()?.constant(span)).max(1);
            let work = if rows { Work::Invocations(results * spans) } else { Work::Groups(results * spans) };
            let [join, neutral] = join.words();
            let mut sizes = words([results, count, spans, kept.rank(), dropped.rank(), join, neutral, 0]).to_vec();
            sizes.extend(kept.words(op)?);
            sizes.extend(dropped.words(op)?);
            partial = gpu.launch(kernel, &[&partial], &sizes, Spec::new([spans, results], x.dtype()), work)?;
            if spans == 1 {
                return Ok(partial.reshape(self.kept(x.shape())));
            }
            (kept, dropped) = (Strides::new([(results, 1)]), Strides::new([(spans, results)]));
        }
    }
}

impl Axes {
    /// Reduces an operand that does not fit one binding. Blocks along its outermost axis are taken as they lie: where that
    /// axis is kept, they give parts of the result; where it is dropped, their results are reduced once more. Where a block
    /// would not fit or not begin where parts may, slices along the outermost axis that is kept are copied.
    fn by_parts(&self, gpu: &Gpu, op: &str, x: &Tensor, join: Join) -> Result<Tensor> {
        // neighbouring axes of the same kind as one
        let mut groups: Vec<(usize, bool)> = Vec::new();
        for (axis, &size) in x.dims().iter().enumerate().filter(|(_, size)| **size != 1) {
            match groups.last_mut() {
                Some((merged, dropped)) if *dropped == self.contains(axis) => *merged *= size,
                _ => groups.push((size, self.contains(axis))),
            }
        }
        let axes = Self((0..groups.len()).filter(|&axis| groups[axis].1).collect());
        let (rows, dropped) = groups[0];
        let inner: usize = groups[1..].iter().map(|(size, _)| size).product();
        let mut least = 1;
        while !(least * inner * x.dtype().size()).is_multiple_of(GpuBuffer::ALIGNMENT) {
            least *= 2;
        }
        let block = gpu.part_len() / inner / least * least;
        let mut parts = Vec::new();
        // one row of a dropped axis in a block would be no reduction
        if block >= if dropped { 2 } else { 1 } {
            for start in (0..rows).step_by(block) {
                let mut shape: Vec<usize> = groups.iter().map(|(size, _)| *size).collect();
                shape[0] = block.min(rows - start);
                let part = axes.on_gpu(gpu, op, &x.gpu_part(start * inner, shape), join)?;
                parts.push(if dropped { part.reshape([vec![1], part.dims().to_vec()].concat()) } else { part });
            }
            let joined = concat::join(gpu, &parts, 0)?;
            let whole = if dropped { Self(vec![0]).on_gpu(gpu, op, &joined, join)? } else { joined };
            return Ok(whole.reshape(self.kept(x.shape())));
        }
        let axis = groups.iter().position(|(_, dropped)| !dropped).expect("blocks of a single axis fit");
        let volume = |groups: &[(usize, bool)]| groups.iter().map(|(size, _)| size).product::<usize>();
        let (before, size, after) = (volume(&groups[..axis]), groups[axis].0, volume(&groups[axis + 1..]));
        let block = (gpu.part_len() / (before * after)).clamp(1, size);
        for start in (0..size).step_by(block) {
            let mut shape: Vec<usize> = groups.iter().map(|(size, _)| *size).collect();
            shape[axis] = block.min(size - start);
            let walk = Strides::new([(before, size * after), (shape[axis] * after, 1)]);
            let slice = walk.gather(gpu, op, x, start * after, Spec::new(shape, x.dtype()))?;
            parts.push(axes.on_gpu(gpu, op, &slice, join)?);
        }
        Ok(concat::join(gpu, &parts, 0)?.reshape(self.kept(x.shape())))
    }
}

impl Var {
    /// Puts the dropped axes of a result back with size 1 and stretches them to a shape.
    pub(super) fn stretch_back(&self, axes: &Axes, shape: &Shape) -> Self {
        self.reshape(axes.with_ones(shape)).broadcast_to(shape)
    }
}
