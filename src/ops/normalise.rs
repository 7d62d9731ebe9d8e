//! `group_norm` and `layer_norm`: groups of channels, or the last axes, are brought to mean 0 and variance 1, then scaled
//! and shifted by parameters. Wu & He, "Group Normalization" (2018); Ba et al., "Layer Normalization" (2016).
//!
//! `y = (x − mean) / √(variance + ε) · scale + shift`, with the variance divided by the number of elements. SiLU, `y ·
//! logistic(y)`, may follow in the same pass.

use std::rc::Rc;

use crate::backend::cpu::normalise as cpu;
use crate::backend::gpu::{Gpu, Kernel, Work, words};
use crate::ops::{Case, Entry, uniform};
use crate::scalar::Real;
use crate::tape::{Backward, Forward, Op, Operands, Reads, Var};
use crate::tensor::for_real;
use crate::{Device, Error, ErrorKind, Result, Shape, Spec, Tensor};

pub(super) const GROUP_ENTRY: Entry = Entry {
    name: "group_norm",
    gpu: true,
    cases: || {
        let case = |shape: &[usize], groups, silu, affine| {
            case(Normalise { over: Over::Groups(groups), epsilon: 1e-5, silu }, shape, &shape[1..2], affine)
        };
        vec![
            case(&[2, 6, 3, 5], 3, false, true),
            case(&[2, 4, 3, 2, 3], 2, true, true),
            case(&[1, 4, 17], 1, true, false),
            case(&[3, 6], 2, false, true),
            case(&[2, 4, 2], 4, false, false),
            case(&[40, 5], 1, true, true),
        ]
    },
};

pub(super) const LAYER_ENTRY: Entry = Entry {
    name: "layer_norm",
    gpu: true,
    cases: || {
        let case = |shape: &[usize], axes, affine| {
            let over = Over::LastAxes(axes);
            case(Normalise { over, epsilon: 1e-5, silu: false }, shape, &shape[shape.len() - axes..], affine)
        };
        vec![
            case(&[2, 3, 17], 1, true),
            case(&[3, 4, 5], 2, true),
            case(&[7], 1, true),
            case(&[70, 3], 1, true),
            case(&[2, 9], 1, false),
        ]
    },
};

fn case(op: Normalise, shape: &[usize], parameters: &[usize], affine: bool) -> Case {
    let mut inputs = vec![uniform(1, shape, -1.0..2.0)];
    if affine {
        inputs.extend([uniform(2, parameters, 0.5..1.5), uniform(3, parameters, -1.0..1.0)]);
    }
    Case::new(op, inputs)
}

const TEXT: &str = include_str!("../../kernels/normalise.wgsl");
pub(super) static STATISTICS: Kernel = Kernel::new("normalise", "statistics", TEXT, &["y", "x"]);
pub(super) static FORWARD: Kernel = Kernel::new("normalise", "forward", TEXT, &["y", "x", "runs", "scale", "shift"]);
pub(super) static MEANS: Kernel =
    Kernel::new("normalise", "cotangent_means", TEXT, &["y", "x", "runs", "scale", "shift", "g"]);
pub(super) static BACKWARD: Kernel =
    Kernel::new("normalise", "backward", TEXT, &["y", "x", "runs", "scale", "shift", "g", "means"]);
pub(super) static PARAMETERS: Kernel =
    Kernel::new("normalise", "parameter_sums", TEXT, &["y", "x", "runs", "scale", "shift", "g"]);

/// What is normalised together.
#[derive(Debug)]
enum Over {
    /// So many groups of the channels of `[batch, channels, ..]`, each with all its places.
    Groups(usize),
    /// So many of the last axes.
    LastAxes(usize),
}

#[derive(Debug)]
struct Normalise {
    over: Over,
    epsilon: f64,
    silu: bool,
}

impl Normalise {
    /// Layout of an operand and shape of its parameters.
    fn layout(&self, shape: &Shape) -> Option<(cpu::Layout, Shape)> {
        let dims = shape.dims();
        let product = |dims: &[usize]| dims.iter().product::<usize>();
        match self.over {
            Over::Groups(count) => {
                let &[batch, channels, ref places @ ..] = dims else { return None };
                if count == 0 || channels % count != 0 {
                    return None;
                }
                let inner = product(places);
                let len = channels / count * inner;
                let layout = cpu::Layout { groups: batch * count, len, inner, parameters: channels };
                Some((layout, Shape::from([channels])))
            }
            Over::LastAxes(axes) => {
                let (outer, last) = dims.split_at(dims.len().checked_sub(axes).filter(|_| axes > 0)?);
                let len = product(last);
                Some((cpu::Layout { groups: product(outer), len, inner: 1, parameters: len }, Shape::from(last)))
            }
        }
    }

    fn cpu<'a, T: Real>(&self, inputs: &[&'a Tensor]) -> cpu::Normalise<'a, T> {
        let (layout, _) = self.layout(inputs[0].shape()).expect("checked by infer");
        let affine = (inputs.len() == 3).then(|| [inputs[1].slice::<T>(), inputs[2].slice::<T>()]);
        cpu::Normalise { layout, x: inputs[0].slice(), affine, epsilon: self.epsilon, silu: self.silu }
    }

    /// The words of the kernels' parameters, and the operands; without scale and shift, others stand in for them.
    fn gpu<'a>(&self, inputs: &[&'a Tensor]) -> (cpu::Layout, [u32; 8], [&'a Tensor; 3]) {
        let (layout, _) = self.layout(inputs[0].shape()).expect("checked by infer");
        let cpu::Layout { groups, len, inner, parameters } = layout;
        let affine = inputs.len() == 3;
        let total = inputs[0].len();
        let mut sizes = words([total, groups, len, inner, parameters, usize::from(affine), usize::from(self.silu), 0]);
        sizes[7] = (self.epsilon as f32).to_bits();
        let operands = if affine { [inputs[0], inputs[1], inputs[2]] } else { [inputs[0]; 3] };
        (layout, sizes, operands)
    }

    fn backward_gpu(&self, gpu: &Gpu, inputs: &[&Tensor], runs: &Tensor, g: &Tensor) -> Result<(Tensor, Tensor)> {
        let (layout, sizes, [x, scale, shift]) = self.gpu(inputs);
        let operands = [x, runs, scale, shift, g];
        let spec = |count| Spec::new([count], x.dtype());
        let means = gpu.launch(&MEANS, &operands, &sizes, spec(2 * layout.groups), Work::Groups(layout.groups))?;
        let with_means = [x, runs, scale, shift, g, &means];
        let dx = gpu.launch(&BACKWARD, &with_means, &sizes, x.spec(), Work::Invocations(x.len()))?;
        let parameters = layout.parameters;
        let sums = gpu.launch(&PARAMETERS, &operands, &sizes, spec(2 * parameters), Work::Groups(parameters))?;
        Ok((dx, sums))
    }
}

impl Op for Normalise {
    fn name(&self) -> &'static str {
        match self.over {
            Over::Groups(_) => "group_norm",
            Over::LastAxes(_) => "layer_norm",
        }
    }

    fn infer(&self, inputs: &[Spec]) -> Result<Spec> {
        let x = &Spec::between(self.name(), inputs, 1..=3)?[0];
        let layout = self.layout(&x.shape).filter(|_| inputs.len() != 2);
        let fits = layout.is_some_and(|(_, parameters)| inputs[1..].iter().all(|p| p.shape == parameters));
        if !fits || !x.dtype.is_real() || inputs.iter().any(|other| other.dtype != x.dtype) {
            let wanted = match self.over {
                Over::Groups(groups) => format!(
                    "[batch, channels, ..] with channels a multiple of {groups} groups, and scale and shift [channels]"
                ),
                Over::LastAxes(axes) => {
                    format!("at least {axes} axes, not 0, and scale and shift of the shape of the last {axes}")
                }
            };
            return Err(Error::new(ErrorKind::Shape, format!("{}: the operands do not fit", self.name()))
                .found(format!("{inputs:?}"))
                .wanted(format!("{wanted}, all f32 or all f64")));
        }
        Ok(x.clone())
    }

    fn forward_cpu(&self, inputs: Operands<'_>) -> Result<Forward> {
        let operands: Vec<_> = inputs.iter().collect();
        for_real!(inputs[0].dtype(), T => {
            let (y, statistics) = self.cpu::<T>(&operands).forward();
            let count = statistics.len();
            let y = Tensor::from_vec(y, inputs[0].shape());
            Ok(Forward::with_residual(y, Tensor::from_vec(statistics, [count])).holding(count * size_of::<T>()))
        })
    }

    fn forward_gpu(&self, gpu: &Gpu, inputs: Operands<'_>) -> Result<Forward> {
        let (layout, sizes, [x, scale, shift]) = self.gpu(&inputs.iter().collect::<Vec<_>>());
        let spec = Spec::new([3 * layout.groups], x.dtype());
        let runs = gpu.launch(&STATISTICS, &[x], &sizes, spec, Work::Groups(layout.groups))?;
        let y = gpu.launch(&FORWARD, &[x, &runs, scale, shift], &sizes, x.spec(), Work::Invocations(x.len()))?;
        Ok(Forward::with_residual(y, runs).holding(12 * layout.groups))
    }

    fn reads(&self, _wanted: &[bool]) -> Reads {
        Reads::inputs()
    }

    fn vjp(&self, cx: &Backward<'_>) -> Result<Vec<Option<Var>>> {
        cx.first_order_only(self.name())?;
        let inputs: Vec<_> = cx.inputs().iter().map(Var::tensor).collect();
        let (statistics, g) = (cx.residual::<Tensor>(), cx.gradient().tensor());
        let constant = |x: Tensor| cx.gradient().tape().constant(x);
        let shape = inputs.last().expect("an operand").shape();
        let (dx, affine) = match cx.gradient().device() {
            Device::Cpu => for_real!(g.dtype(), T => {
                let found = self.cpu::<T>(&inputs).backward(statistics.slice::<T>(), g.slice::<T>());
                let affine = found.affine.map(|sums| sums.map(|sum| constant(Tensor::from_vec(sum, shape))));
                (Tensor::from_vec(found.x, g.shape()), affine)
            }),
            Device::Gpu(gpu) => {
                let (dx, sums) = self.backward_gpu(&gpu, &inputs, statistics, g)?;
                let count = sums.len() / 2;
                let sums = constant(sums);
                let part = |n: usize| sums.slice(0, n * count..(n + 1) * count).reshape(shape);
                (dx, (inputs.len() == 3).then(|| [part(0), part(1)]))
            }
        };
        let mut cotangents = vec![Some(constant(dx))];
        cotangents.extend(affine.into_iter().flatten().map(Some));
        Ok(cotangents)
    }
}

impl Var {
    /// Group norm of `[batch, channels, ..]`: each of `groups` groups of channels, over all its places, gets mean 0 and
    /// variance 1 (`ε` is added to the variance); then each channel is scaled and shifted by `affine`, two `[channels]`.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0f64, 3.0, 10.0, 30.0], [1, 2, 2]));
    /// let y = x.group_norm(2, 0.0, None);
    /// assert_eq!(y.value()?.slice::<f64>(), &[-1.0, 1.0, -1.0, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the channels cannot be divided so, or the shapes do not fit.
    #[track_caller]
    #[must_use]
    pub fn group_norm(&self, groups: usize, epsilon: f64, affine: Option<(&Self, &Self)>) -> Self {
        self.normalised(Normalise { over: Over::Groups(groups), epsilon, silu: false }, affine)
    }

    /// [`Var::group_norm`] followed by SiLU, `y · logistic(y)`, in one pass.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, -1.0], [1, 1, 2]));
    /// let y = x.group_norm_silu(1, 0.0, None);
    /// let y = y.value()?.slice::<f64>();
    /// assert!((y[0] - 1.0 / (1.0 + (-1.0f64).exp())).abs() < 1e-12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// As [`Var::group_norm`].
    #[track_caller]
    #[must_use]
    pub fn group_norm_silu(&self, groups: usize, epsilon: f64, affine: Option<(&Self, &Self)>) -> Self {
        self.normalised(Normalise { over: Over::Groups(groups), epsilon, silu: true }, affine)
    }

    /// Layer norm: what lies along the last `axes` axes together gets mean 0 and variance 1 (`ε` is added to the variance);
    /// then each element is scaled and shifted by `affine`, two tensors of the shape of these axes.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 3.0], [1, 2]));
    /// assert_eq!(x.layer_norm(1, 0.0, None).value()?.slice::<f64>(), [-1.0, 1.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When there are not as many axes, or the shapes do not fit.
    #[track_caller]
    #[must_use]
    pub fn layer_norm(&self, axes: usize, epsilon: f64, affine: Option<(&Self, &Self)>) -> Self {
        self.normalised(Normalise { over: Over::LastAxes(axes), epsilon, silu: false }, affine)
    }

    #[track_caller]
    fn normalised(&self, op: Normalise, affine: Option<(&Self, &Self)>) -> Self {
        match affine {
            None => Self::run(Rc::new(op), &[self]),
            Some((scale, shift)) => Self::run(Rc::new(op), &[self, scale, shift]),
        }
    }
}
