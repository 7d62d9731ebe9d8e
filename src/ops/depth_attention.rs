//! `depth_attention`: at every pixel, the query attends over the depth samples of a volume behind that pixel.
//!
//! `w_d = softmax over d of scale · Σ_c q_c k_cd`, `y_c = Σ_d w_d v_cd`. The core of SyncDreamer's depth-wise attention (Liu
//! et al., 2023). The weights, a fraction `1 / channels` of the keys, are kept for the derivative.

use std::rc::Rc;

use crate::backend::cpu::depth_attention::{self as cpu, Sizes};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Device, Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "depth_attention",
    gpu: true,
    cases: || {
        let case = |[images, heads, channels, depths]: [usize; 4], [height, width]: [usize; 2]| {
            let volume = |seed| uniform(seed, [images, heads, channels, depths, height, width], -1.0..1.0);
            let q = uniform(1, [images, heads, channels, height, width], -1.0..1.0);
            Case::new(DepthAttention { scale: 0.6 }, [q, volume(2), volume(3)])
        };
        let shared = |[images, heads, channels, depths]: [usize; 4], [height, width]: [usize; 2]| {
            let volume = |seed| uniform(seed, [images, 1, channels, depths, height, width], -1.0..1.0);
            let q = uniform(1, [images, heads, channels, height, width], -1.0..1.0);
            Case::new(DepthAttention { scale: 0.6 }, [q, volume(2), volume(3)])
        };
        vec![
            case([2, 2, 5, 3], [3, 4]),
            case([1, 1, 1, 1], [1, 1]),
            case([1, 2, 4, 6], [4, 4]),
            case([1, 1, 3, 2], [1, 523]),
            shared([2, 3, 5, 3], [3, 4]),
            shared([1, 2, 4, 5], [1, 271]),
        ]
    },
};

const TEXT: &str = include_str!("../../kernels/depth_attention.wgsl");
pub(super) static SOFTMAX: Kernel = Kernel::new("depth_attention", "softmax", TEXT, &["y", "map", "volume"]);
pub(super) static SLOPES: Kernel = Kernel::new("depth_attention", "slopes", TEXT, &["y", "map", "volume", "weights"]);
pub(super) static MIX: Kernel = Kernel::new("depth_attention", "mix", TEXT, &["y", "volume", "weights"]);
pub(super) static SPREAD: Kernel = Kernel::new("depth_attention", "spread", TEXT, &["y", "map", "weights"]);

#[derive(Debug)]
struct DepthAttention {
    scale: f64,
}

fn sizes(q: &Shape, k: &Shape) -> Sizes {
    let (&[images, heads, channels, ..], &[_, of_volumes, _, depths, ..]) = (q.dims(), k.dims()) else {
        unreachable!("checked by infer")
    };
    let shared_by = if of_volumes == heads { 1 } else { heads };
    Sizes { heads: images * heads, shared_by, channels, depths, pixels: q.dims()[3..].iter().product() }
}

impl DepthAttention {
    fn words(&self, sizes: Sizes) -> [u32; 6] {
        let mut words = words([sizes.heads, sizes.channels, sizes.depths, sizes.pixels, 0, sizes.shared_by]);
        words[4] = (self.scale as f32).to_bits();
        words
    }

    fn backward_gpu(&self, gpu: &Gpu, [q, k, v]: [&Tensor; 3], weights: &Tensor, g: &Tensor) -> Result<[Tensor; 3]> {
        let sizes = sizes(q.shape(), k.shape());
        let words = self.words(sizes);
        let lines = Work::Invocations(sizes.heads * sizes.pixels);
        let slopes = gpu.launch(&SLOPES, &[g, v, weights], &words, weights.spec(), lines)?;
        let volume = Work::Invocations(k.len());
        Ok([
            gpu.launch(&MIX, &[k, &slopes], &words, q.spec(), Work::Invocations(q.len()))?,
            gpu.launch(&SPREAD, &[q, &slopes], &words, k.spec(), volume)?,
            gpu.launch(&SPREAD, &[g, weights], &words, v.spec(), volume)?,
        ])
    }
}

impl Op for DepthAttention {
    fn name(&self) -> &'static str {
        "depth_attention"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let [q, k, v] = Spec::exactly(self.name(), inputs)?;
        let fits = match (q.shape.dims(), k.shape.dims()) {
            (&[images, heads, channels, height, width], volume) if channels > 0 => {
                matches!(*volume, [a, b, c, _, d, e]
                    if [a, c, d, e] == [images, channels, height, width] && (b == heads || b == 1 && heads > 0))
            }
            _ => false,
        };
        if !fits || k != v || !q.dtype.is_real() || k.dtype != q.dtype {
            return Err(Error::new(ErrorKind::Shape, "depth_attention: the operands do not fit")
                .found(format!("{inputs:?}"))
                .wanted("q [images, heads, channels, height, width], k and v [images, heads or 1, channels, depths, height, width], all f32 or all f64"));
        }
        Ok(q.clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let [q, k, v] = inputs.array();
        let sizes = sizes(q.shape(), k.shape());
        for_real!(q.dtype(), T => {
            let operands = [q.slice::<T>(), k.slice::<T>(), v.slice::<T>()];
            let (result, weights) = cpu::forward(sizes, operands, self.scale);
            let count = weights.len();
            let y = Tensor::from_vec(result, q.shape());
            Ok(Forward::with_residual(y, Tensor::from_vec(weights, [count])).holding(count * size_of::<T>()))
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let [q, k, v] = inputs.array();
        let sizes = sizes(q.shape(), k.shape());
        let words = self.words(sizes);
        let weights = Spec::new([sizes.heads * sizes.depths * sizes.pixels], q.dtype());
        let lines = Work::Invocations(sizes.heads * sizes.pixels);
        let weights = gpu.launch(&SOFTMAX, &[q, k], &words, weights, lines)?;
        let y = gpu.launch(&MIX, &[v, &weights], &words, q.spec(), Work::Invocations(q.len()))?;
        let bytes = 4 * weights.len();
        Ok(Forward::with_residual(y, weights).holding(bytes))
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        cx.first_order_only(self.name())?;
        let inputs: [&Tensor; 3] = std::array::from_fn(|i| cx.input(i).tensor());
        let (weights, g) = (cx.residual::<Tensor>(), cx.gradient().tensor());
        let found = match cx.gradient().device() {
            Device::Cpu => for_real!(g.dtype(), T => {
                let sizes = sizes(inputs[0].shape(), inputs[1].shape());
                let slices = inputs.map(|x| x.slice::<T>());
                let found = cpu::backward(sizes, slices, weights.slice(), g.slice(), self.scale);
                let mut shapes = inputs.iter().map(|x| x.shape());
                found.map(|x| Tensor::from_vec(x, shapes.next().expect("three operands")))
            }),
            Device::Gpu(gpu) => self.backward_gpu(&gpu, inputs, weights, g)?,
        };
        Ok(found.into_iter().map(|x| Some(cx.gradient().tape().constant(x))).collect())
    }
}

impl Var {
    /// Attention over the depth samples of every pixel: `softmax over d of (scale · Σ_c q_c k_cd)` weighs `v_cd`.
    ///
    /// `self` is the query `[images, heads, channels, height, width]`; keys and values are volumes `[images, heads, channels,
    /// depths, height, width]`; the result has the query's shape. One head of keys and values may serve all heads of queries
    /// (Shazeer 2019). The usual scale is `1 / √channels`. Zeros where there is no depth, or where all scores are −∞.
    /// Differentiable once.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let q = tape.leaf(Tensor::from_vec(vec![1.0f64], [1, 1, 1, 1, 1]));
    /// let k = tape.leaf(Tensor::from_vec(vec![0.0, 3.0f64.ln()], [1, 1, 1, 2, 1, 1]));
    /// let v = tape.leaf(Tensor::from_vec(vec![4.0f64, 8.0], [1, 1, 1, 2, 1, 1]));
    /// assert!((q.depth_attention(&k, &v, 1.0).item()? - 7.0).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes or dtypes do not fit.
    #[track_caller]
    #[must_use]
    pub fn depth_attention(&self, k: &Self, v: &Self, scale: f64) -> Self {
        Self::run(Rc::new(DepthAttention { scale }), &[self, k, v])
    }
}
