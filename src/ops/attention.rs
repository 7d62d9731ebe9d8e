//! `attention`: `softmax(scale · Q Kᵀ + mask) V` for each head, without the matrix of scores in memory.
//!
//! A query all of whose keys are masked by −∞ gets zeros. The derivative recomputes the weights from one number kept for
//! each query.

use std::rc::Rc;

use crate::backend::cpu::attention::{self as cpu, Heads, Mask};
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Var};
use crate::tensor::for_real;
use crate::{Device, Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const ENTRY: Entry = Entry {
    name: "attention",
    gpu: true,
    cases: || {
        let case = |leading: &[usize], [queries, keys, channels, values]: [usize; 4], mask: Option<&[usize]>| {
            let operand =
                |seed, rows: usize, columns: usize| uniform(seed, [leading, &[rows, columns]].concat(), -1.0..1.0);
            let mut inputs = vec![operand(1, queries, channels), operand(2, keys, channels), operand(3, keys, values)];
            inputs.extend(mask.map(|shape| uniform(4, shape, -2.0..2.0)));
            Case::new(Attention { scale: 0.7 }, inputs)
        };
        vec![
            case(&[2, 2], [3, 5, 4, 4], None),
            case(&[3], [5, 2, 3, 7], None),
            case(&[], [1, 1, 1, 1], None),
            case(&[1, 2], [70, 103, 5, 3], None),
            case(&[2, 1], [4, 3, 2, 2], Some(&[4, 3])),
            case(&[2, 3], [4, 3, 2, 1], Some(&[2, 1, 1, 3])),
            case(&[2, 3], [2, 3, 2, 1], Some(&[3, 2, 3])),
        ]
    },
};

const TEXT: &str = include_str!("../../kernels/attention.wgsl");
pub(super) static SUMS: Kernel = Kernel::new("attention", "sums", TEXT, &["y", "q", "k", "mask"]);
pub(super) static FORWARD: Kernel =
    Kernel::new("attention", "forward", TEXT, &["y", "q", "k", "v", "mask", "log_sums"]);
const ADJOINT: &[&str] = &["y", "q", "k", "v", "mask", "log_sums", "g", "means"];
pub(super) static FOR_QUERIES: Kernel = Kernel::new("attention", "for_queries", TEXT, ADJOINT);
pub(super) static FOR_KEYS: Kernel = Kernel::new("attention", "for_keys", TEXT, ADJOINT);
pub(super) static FOR_VALUES: Kernel =
    Kernel::new("attention", "for_values", TEXT, &["y", "q", "k", "mask", "log_sums", "g"]);
pub(super) static FOR_SCORES: Kernel = Kernel::new("attention", "for_scores", TEXT, ADJOINT);

#[derive(Debug)]
struct Attention {
    scale: f64,
}

/// Sizes of a problem.
struct Sizes {
    /// Axes before those of rows and channels.
    leading: Vec<usize>,
    heads: usize,
    queries: usize,
    keys: usize,
    channels: usize,
    values: usize,
    /// Steps of the mask along all axes of the scores; nothing without a mask.
    mask: Option<Vec<usize>>,
}

impl Sizes {
    /// None where the operands do not fit.
    fn new(shapes: &[&Shape]) -> Option<Self> {
        let [q, k, v] = [shapes[0].dims(), shapes[1].dims(), shapes[2].dims()];
        if !(2..=4).contains(&q.len()) || [k.len(), v.len()] != [q.len(); 2] {
            return None;
        }
        let (leading, &[queries, channels]) = q.split_last_chunk()?;
        let (of_keys, &[keys, key_channels]) = k.split_last_chunk()?;
        let (of_values, &[value_keys, values]) = v.split_last_chunk()?;
        if of_keys != leading || of_values != leading || key_channels != channels || value_keys != keys {
            return None;
        }
        if channels == 0 || values == 0 {
            return None;
        }
        let scores = Shape::from([leading, &[queries, keys]].concat());
        let mask = match shapes.get(3) {
            None => None,
            Some(mask) => {
                if mask.broadcast(&scores).ok()? != scores {
                    return None;
                }
                let mut steps = vec![0; scores.rank() - mask.rank()];
                steps.extend(
                    mask.strides().iter().zip(mask.dims()).map(|(step, size)| if *size == 1 { 0 } else { *step }),
                );
                Some(steps)
            }
        };
        let heads = leading.iter().product();
        Some(Self { leading: leading.to_vec(), heads, queries, keys, channels, values, mask })
    }

    fn of(inputs: &[&Tensor]) -> Self {
        Self::new(&inputs.iter().map(|x| x.shape()).collect::<Vec<_>>()).expect("checked by infer")
    }

    /// The shape of the scores.
    fn scores(&self) -> Vec<usize> {
        [&self.leading[..], &[self.queries, self.keys]].concat()
    }

    fn cpu<'a, T: Real>(&self, inputs: &[&'a Tensor], scale: f64) -> Heads<'a, T> {
        let leading = Shape::from(&self.leading[..]);
        let mask = self.mask.as_ref().map(|steps| {
            let (outer, &[query_step, key_step]) = steps.split_last_chunk().expect("scores have two axes at least");
            let start = |head: usize| leading.index(head).iter().zip(outer).map(|(i, step)| i * step).sum();
            Mask { values: inputs[3].slice(), starts: (0..self.heads).map(start).collect(), query_step, key_step }
        });
        Heads {
            q: inputs[0].slice(),
            k: inputs[1].slice(),
            v: inputs[2].slice(),
            mask,
            scale: T::from_f64(scale),
            heads: self.heads,
            queries: self.queries,
            keys: self.keys,
            channels: self.channels,
            values: self.values,
        }
    }

    /// The words of the kernels' parameters.
    fn words(&self, scale: f64) -> [u32; 12] {
        let mut steps = [0; 4];
        if let Some(mask) = &self.mask {
            steps[4 - mask.len()..].copy_from_slice(mask);
        }
        let inner = self.leading.last().copied().unwrap_or(1).max(1);
        let [outer_step, inner_step, query_step, key_step] = steps;
        let masked = usize::from(self.mask.is_some());
        let Self { heads, queries, keys, channels, values, .. } = *self;
        let mut words = words([
            heads, queries, keys, channels, values, 0, masked, inner, outer_step, inner_step, query_step, key_step,
        ]);
        words[5] = (scale as f32).to_bits();
        words
    }
}

/// The mask, or another operand in its place, which is not read.
fn mask_or_other<'a>(inputs: &[&'a Tensor]) -> &'a Tensor {
    inputs.get(3).copied().unwrap_or(inputs[0])
}

impl Attention {
    /// Cotangents of the operands, and of the scores where they are wanted, on a GPU.
    fn backward_gpu(
        &self,
        gpu: &Gpu,
        inputs: &[&Tensor],
        log_sums: &Tensor,
        g: &Tensor,
        means: &Tensor,
    ) -> Result<Vec<Tensor>> {
        let sizes = Sizes::of(inputs);
        let words = sizes.words(self.scale);
        let (q, k, v, mask) = (inputs[0], inputs[1], inputs[2], mask_or_other(inputs));
        let all = [q, k, v, mask, log_sums, g, means];
        let (of_queries, of_keys) = (sizes.heads * sizes.queries, sizes.heads * sizes.keys);
        let mut found = vec![
            gpu.launch(&FOR_QUERIES, &all, &words, q.spec(), Work::Groups(of_queries))?,
            gpu.launch(&FOR_KEYS, &all, &words, k.spec(), Work::Groups(of_keys))?,
            gpu.launch(&FOR_VALUES, &[q, k, mask, log_sums, g], &words, v.spec(), Work::Groups(of_keys))?,
        ];
        if sizes.mask.is_some() {
            let scores = Spec::new(sizes.scores(), q.dtype());
            let work = Work::Invocations(scores.shape.len());
            found.push(gpu.launch(&FOR_SCORES, &all, &words, scores, work)?);
        }
        Ok(found)
    }
}

impl Op for Attention {
    fn name(&self) -> &'static str {
        "attention"
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let dtype = Spec::between(self.name(), inputs, 3..=4)?[0].dtype;
        let sizes = Sizes::new(&inputs.iter().map(|x| &x.shape).collect::<Vec<_>>());
        match sizes.filter(|_| dtype.is_real() && inputs.iter().all(|x| x.dtype == dtype)) {
            Some(sizes) => Ok(Spec::new([&sizes.leading[..], &[sizes.queries, sizes.values]].concat(), dtype)),
            None => Err(Error::new(ErrorKind::Shape, "attention: the operands do not fit")
                .found(format!("{inputs:?}"))
                .wanted(
                    "q [.., queries, channels], k [.., keys, channels], v [.., keys, values] and a mask that broadcasts to \
                     [.., queries, keys], with the same at most two leading axes and no empty channels, all f32 or all f64",
                )),
        }
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let inputs: Vec<_> = inputs.iter().collect();
        let sizes = Sizes::of(&inputs);
        for_real!(inputs[0].dtype(), T => {
            let (result, log_sums) = cpu::forward(&sizes.cpu::<T>(&inputs, self.scale));
            let shape = [&sizes.leading[..], &[sizes.queries, sizes.values]].concat();
            let count = log_sums.len();
            let y = Tensor::from_vec(result, shape);
            Ok(Forward::with_residual(y, Tensor::from_vec(log_sums, [count])).holding(count * size_of::<T>()))
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let inputs: Vec<_> = inputs.iter().collect();
        let sizes = Sizes::of(&inputs);
        let words = sizes.words(self.scale);
        let (q, k, v, mask) = (inputs[0], inputs[1], inputs[2], mask_or_other(&inputs));
        let count = sizes.heads * sizes.queries;
        let work = Work::Groups(count);
        let log_sums = gpu.launch(&SUMS, &[q, k, mask], &words, Spec::new([count], q.dtype()), work)?;
        let result = Spec::new([&sizes.leading[..], &[sizes.queries, sizes.values]].concat(), q.dtype());
        let y = gpu.launch(&FORWARD, &[q, k, v, mask, &log_sums], &words, result, work)?;
        Ok(Forward::with_residual(y, log_sums).holding(4 * count))
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        cx.first_order_only(self.name())?;
        let inputs: Vec<_> = cx.inputs().iter().map(Var::tensor).collect();
        let (log_sums, g) = (cx.residual::<Tensor>(), cx.gradient());
        let found = match g.device() {
            Device::Cpu => for_real!(g.dtype(), T => {
                let sizes = Sizes::of(&inputs);
                let heads = sizes.cpu::<T>(&inputs, self.scale);
                let scores_wanted = inputs.len() == 4 && cx.wants(3);
                let (y, log_sums) = (cx.output().tensor().slice::<T>(), log_sums.slice::<T>());
                let found = cpu::backward(&heads, y, log_sums, g.tensor().slice::<T>(), scores_wanted);
                let [q, k, v] = [(found.q, 0), (found.k, 1), (found.v, 2)].map(|(x, i)| Tensor::from_vec(x, inputs[i].shape()));
                let scores = found.scores.map(|x| Tensor::from_vec(x, sizes.scores()));
                [q, k, v].into_iter().chain(scores).collect()
            }),
            Device::Gpu(gpu) => {
                let means = (g * cx.output()).sum(&[g.shape().rank() - 1]);
                self.backward_gpu(&gpu, &inputs, log_sums, g.tensor(), means.tensor())?
            }
        };
        let mut cotangents: Vec<_> = found.into_iter().map(|x| Some(g.tape().constant(x))).collect();
        cotangents.resize(inputs.len(), None);
        if let Some(Some(scores)) = cotangents.get_mut(3) {
            // the mask's cotangent is the sum over what it was broadcast to
            let mask = inputs[3].shape();
            let missing = scores.shape().rank() - mask.rank();
            let axes = 0..scores.shape().rank();
            let stretched: Vec<usize> =
                axes.filter(|&axis| axis < missing || mask.dims()[axis - missing] == 1).collect();
            *scores = scores.sum(&stretched).reshape(mask);
        }
        Ok(cotangents)
    }
}

impl Var {
    /// Scaled-dot-product attention, `softmax(scale · self · kᵀ + mask) · v` for each head.
    ///
    /// `self` is `[.., queries, channels]`, `k` `[.., keys, channels]`, `v` `[.., keys, values]` with the same leading axes
    /// (none, `[heads]`, or `[batch, heads]`); the result is `[.., queries, values]`. The usual scale is `1 / √channels`. A
    /// mask is added to the scaled scores and broadcasts to `[.., queries, keys]`; −∞ takes a key out, and a query left
    /// without keys gets zeros. The matrix of scores is never in memory (unless the gradient of a mask is asked for).
    /// Differentiable once.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = |values: &[f64], shape: [usize; 2]| tape.leaf(Tensor::from_vec(values.to_vec(), shape));
    /// let (q, k, v) = (x(&[1.0], [1, 1]), x(&[0.0, 3.0f64.ln()], [2, 1]), x(&[4.0, 8.0], [2, 1]));
    /// let y = q.attention(&k, &v, 1.0, None); // weights 1/4 and 3/4
    /// assert!((y.item()? - 7.0).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes or dtypes do not fit.
    #[track_caller]
    #[must_use]
    pub fn attention(&self, k: &Self, v: &Self, scale: f64, mask: Option<&Self>) -> Self {
        let operands: Vec<_> = [self, k, v].into_iter().chain(mask).collect();
        Self::run(Rc::new(Attention { scale }), &operands)
    }
}
