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
mod arg_extremum;
mod attention;
mod average_pool;
mod axes;
mod broadcast_to;
mod cast;
mod choose;
mod clamp;
mod concat;
mod convolution;
mod cos;
mod cumsum;
mod density_to_alpha;
mod depth_attention;
mod div;
mod elu;
mod encoding;
mod eq;
mod erf;
mod exp;
mod exp_m1;
mod flip;
mod floor;
mod gather;
mod ge;
mod gelu;
mod gelu_sigmoid;
mod gelu_tanh;
pub(crate) mod grid;
mod grid_sample;
mod grid_scatter;
mod gt;
mod index_add;
mod index_select;
mod le;
mod leaky_relu;
mod linear;
mod ln;
mod ln_1p;
mod logistic;
mod logsumexp;
mod lt;
mod map;
mod matmul;
mod max;
mod max_pool;
mod maximum;
mod min;
mod minimum;
mod mlp;
mod mul;
mod ne;
mod neg;
mod normalise;
mod operators;
mod pad;
mod per_axis;
mod permute;
mod pool;
mod pow;
mod powf;
mod prod;
mod put;
mod ray_transmittance;
mod ray_weights;
mod recip;
mod recurrence;
mod reduction;
mod relu;
mod resample;
mod reshape;
mod resize;
mod rsqrt;
mod segment_repeat;
mod segment_sum;
mod segments;
mod sign;
mod silu;
mod sin;
mod slice;
mod softmax;
mod softplus;
mod sqrt;
mod square;
mod sub;
mod sum;
mod take;
mod tanh;

use std::rc::Rc;

pub use crate::backend::cpu::gemm::Activation;
pub use convolution::Conv;
pub(crate) use convolution::{Geometry, Phase};
pub use grid::{GridSampling, Interpolation, NodeGrid, Padding};
pub use map::{Map, Pointwise};
pub use per_axis::PerAxis;
pub use pool::Pool;
pub use resize::Resampling;
pub use segments::segment_offsets;

use crate::backend::gpu::{Kernel, NARROW, SORT_BLOCKS, SORT_STEPS, SORT_TAILS, STRIDED, WIDEN};
use crate::{DType, GradCheck, GradReport, Key, Op, Result, Shape, Tape, Tensor, Var, random};

/// An op of the crate with the cases its tests feed it.
///
/// ```
/// let ops = gradreel::ops::registry();
/// assert!(ops.iter().any(|op| op.name == "matmul" && op.gpu));
/// ```
pub struct Entry {
    /// The op's name.
    pub name: &'static str,
    /// Whether it has a WGSL kernel; the comparison with the CPU runs where it has.
    pub gpu: bool,
    /// What the shared tests feed it, including the places where it could break.
    pub cases: fn() -> Vec<Case>,
}

/// One application of an op to fixed inputs: `f64`, or `u32` for indices.
///
/// ```
/// use gradreel::{ops::{Case, Map, uniform}, scalar::Program};
/// let square = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
/// let case = Case::new(square, [uniform(1, [3], 0.5..2.0)]);
/// assert_eq!(case.inputs.len(), 1);
/// ```
pub struct Case {
    /// The op with its settings.
    pub op: Rc<dyn Op>,
    /// Its operands.
    pub inputs: Vec<Tensor>,
    /// Whether the result answers a question (is x below y? where is the largest?), so that NaN gives an answer, too.
    pub condition: bool,
}

impl Case {
    /// An op applied to these operands.
    ///
    /// ```
    /// use gradreel::{Tensor, ops::{Case, Map, uniform}, scalar::Program};
    /// let square = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0] * x[0]]));
    /// let case = Case::new(square, [uniform(1, [3], 0.5..2.0)]);
    /// assert!(case.gradcheck("square")?.expect("it has a derivative").passed());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn new(op: impl Op, inputs: impl Into<Vec<Tensor>>) -> Self {
        Self::of(Rc::new(op), inputs)
    }

    /// An op that exists already, applied to these operands.
    ///
    /// ```
    /// use gradreel::{ops::{Case, Map, uniform}, scalar::Program};
    /// let square = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
    /// let case = Case::of(std::rc::Rc::new(square), [uniform(1, [3], 0.5..2.0)]);
    /// assert!(!case.condition);
    /// ```
    pub fn of(op: Rc<dyn Op>, inputs: impl Into<Vec<Tensor>>) -> Self {
        Self { op, inputs: inputs.into(), condition: false }
    }

    /// The same case of an op whose result answers a question, so that NaN gives an answer instead of NaN.
    ///
    /// ```
    /// use gradreel::{ops::{Case, Map, uniform}, scalar::Program};
    /// let square = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
    /// assert!(Case::new(square, [uniform(1, [3], 0.5..2.0)]).condition().condition);
    /// ```
    #[must_use]
    pub fn condition(self) -> Self {
        Self { condition: true, ..self }
    }
}

impl Case {
    /// Compares the op's derivative with central differences in `f64`; `None` where nothing has a derivative.
    ///
    /// ```
    /// use gradreel::{ops::{Case, Map, uniform}, scalar::Program};
    /// let square = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
    /// let report = Case::new(square, [uniform(1, [3], 0.5..2.0)]).gradcheck("square")?;
    /// assert!(report.expect("it has a derivative").passed());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// What the op and its derivative return.
    pub fn gradcheck(&self, name: &str) -> Result<Option<GradReport>> {
        self.checked(name, |inputs, op| GradCheck::default().function(name, inputs, op))
    }

    /// As [`Case::gradcheck`] for the derivative of the derivative.
    ///
    /// ```
    /// use gradreel::{ops::{Case, Map, uniform}, scalar::Program};
    /// let square = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
    /// let report = Case::new(square, [uniform(1, [3], 0.5..2.0)]).gradcheck_twice("square")?;
    /// assert!(report.expect("it has a derivative").passed());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Case::gradcheck`]; [`ErrorKind::Unsupported`](crate::ErrorKind::Unsupported) when the derivative is a kernel
    /// of its own, which says so.
    pub fn gradcheck_twice(&self, name: &str) -> Result<Option<GradReport>> {
        // a gradient is the small rest of large terms more often than a result is: its rounding shows in its differences
        let check = GradCheck { tolerance: 1e-5, ..GradCheck::default() };
        self.checked(name, |inputs, op| check.gradient(name, inputs, op))
    }

    fn checked(
        &self,
        name: &str,
        check: impl FnOnce(&[(&str, Tensor)], &dyn Fn(&Tape, &[Var]) -> Result<Var>) -> Result<GradReport>,
    ) -> Result<Option<GradReport>> {
        let specs: Vec<_> = self.inputs.iter().map(Tensor::spec).collect();
        let result = self.op.infer(&specs).map_err(|e| e.at(name))?;
        let names: Vec<String> = (0..self.inputs.len()).map(|i| format!("x{i}")).collect();
        let differentiable = |x: &Tensor| x.dtype() == DType::F64;
        let picked: Vec<usize> = (0..names.len()).filter(|&i| differentiable(&self.inputs[i])).collect();
        let inputs: Vec<_> = picked.iter().map(|&i| (names[i].as_str(), self.inputs[i].clone())).collect();
        if !result.dtype.is_real() || inputs.iter().all(|(_, x)| x.is_empty()) {
            return Ok(None);
        }
        let op = |tape: &Tape, vars: &[Var]| {
            let mut operands: Vec<Var> = self.inputs.iter().map(|x| tape.constant(x.clone())).collect();
            picked.iter().zip(vars).for_each(|(&i, var)| operands[i] = var.clone());
            tape.apply(self.op.clone(), &operands.iter().collect::<Vec<_>>())
        };
        check(&inputs, &op).map(Some)
    }
}

/// Uniform numbers in `range`, the same ones at every call with the same seed.
///
/// ```
/// let x = gradreel::ops::uniform(7, [100], -1.0..1.0);
/// assert!(x.slice::<f64>().iter().all(|x| (-1.0..1.0).contains(x)));
/// ```
pub fn uniform(seed: u64, shape: impl Into<Shape>, range: std::ops::Range<f64>) -> Tensor {
    let shape = shape.into();
    let values: Vec<f64> =
        Key::new(seed).uniform(shape.len()).map(|u| range.start + u * (range.end - range.start)).collect();
    Tensor::from_vec(values, shape)
}

/// Every op of the crate. Adding one here adds its tests.
///
/// ```
/// for entry in gradreel::ops::registry() {
///     println!("{} with {} cases", entry.name, (entry.cases)().len());
/// }
/// ```
pub fn registry() -> Vec<Entry> {
    vec![
        abs::ABS.entry(),
        add::ADD.entry(),
        choose::CHOOSE.entry(),
        clamp::CLAMP.entry(),
        cos::COS.entry(),
        density_to_alpha::DENSITY_TO_ALPHA.entry(),
        div::DIV.entry(),
        elu::ELU.entry(),
        eq::EQ.entry(),
        erf::ERF.entry(),
        exp::EXP.entry(),
        exp_m1::EXP_M1.entry(),
        floor::FLOOR.entry(),
        ge::GE.entry(),
        gelu::GELU.entry(),
        gelu_sigmoid::GELU_SIGMOID.entry(),
        gelu_tanh::GELU_TANH.entry(),
        gt::GT.entry(),
        le::LE.entry(),
        leaky_relu::LEAKY_RELU.entry(),
        ln::LN.entry(),
        ln_1p::LN_1P.entry(),
        logistic::LOGISTIC.entry(),
        lt::LT.entry(),
        maximum::MAXIMUM.entry(),
        minimum::MINIMUM.entry(),
        mul::MUL.entry(),
        ne::NE.entry(),
        neg::NEG.entry(),
        powf::POWF.entry(),
        recip::RECIP.entry(),
        relu::RELU.entry(),
        rsqrt::RSQRT.entry(),
        sign::SIGN.entry(),
        silu::SILU.entry(),
        sin::SIN.entry(),
        softplus::SOFTPLUS.entry(),
        sqrt::SQRT.entry(),
        square::SQUARE.entry(),
        sub::SUB.entry(),
        tanh::TANH.entry(),
        arg_extremum::ENTRY,
        attention::ENTRY,
        broadcast_to::ENTRY,
        cast::ENTRY,
        concat::ENTRY,
        convolution::forward::ENTRY,
        convolution::transposed::ENTRY,
        convolution::weights::ENTRY,
        cumsum::ENTRY,
        depth_attention::ENTRY,
        flip::ENTRY,
        grid_sample::ENTRY,
        grid_scatter::ENTRY,
        index_add::ENTRY,
        index_select::ENTRY,
        linear::ENTRY,
        matmul::ENTRY,
        max::ENTRY,
        max_pool::PICK_ENTRY,
        max_pool::UNPOOL_ENTRY,
        min::ENTRY,
        mlp::ENTRY,
        normalise::GROUP_ENTRY,
        normalise::LAYER_ENTRY,
        pad::ENTRY,
        permute::ENTRY,
        pow::ENTRY,
        prod::ENTRY,
        put::ENTRY,
        ray_transmittance::ENTRY,
        ray_weights::ENTRY,
        recurrence::ENTRY,
        resample::ENTRY,
        reshape::ENTRY,
        segment_repeat::ENTRY,
        segment_sum::ENTRY,
        slice::ENTRY,
        softmax::ADJOINT_ENTRY,
        softmax::ENTRY,
        softmax::LOG_ENTRY,
        sum::ENTRY,
        take::ENTRY,
    ]
}

/// Every kernel of the crate but those made around scalar programs ([`Map::kernel`]). Adding one here adds its tests.
///
/// ```
/// assert!(gradreel::ops::kernels().iter().any(|kernel| kernel.name() == "matmul"));
/// ```
pub fn kernels() -> Vec<&'static Kernel> {
    vec![
        &arg_extremum::FIND,
        &arg_extremum::ROWS,
        &arg_extremum::TREE,
        &attention::FORWARD,
        &attention::FOR_KEYS,
        &attention::FOR_QUERIES,
        &attention::FOR_SCORES,
        &attention::FOR_VALUES,
        &attention::SUMS,
        &concat::KERNEL,
        &cumsum::KERNEL,
        &depth_attention::MIX,
        &depth_attention::SLOPES,
        &depth_attention::SOFTMAX,
        &depth_attention::SPREAD,
        &grid_sample::SAMPLE,
        &grid_sample::SLOPE,
        &grid_scatter::CELLS,
        &grid_scatter::GATHER,
        &grid_scatter::STARTS,
        &index_add::KERNEL,
        &index_select::KERNEL,
        &matmul::BIASED,
        &matmul::KERNEL,
        &normalise::BACKWARD,
        &normalise::FORWARD,
        &normalise::MEANS,
        &normalise::PARAMETERS,
        &normalise::STATISTICS,
        &pad::KERNEL,
        &put::KERNEL,
        &ray_transmittance::LEFT,
        &ray_transmittance::SLOPE,
        &ray_weights::SLOPE,
        &ray_weights::WEIGHTS,
        &recurrence::KERNEL,
        &*random::KERNEL,
        &reduction::ROWS,
        &reduction::TREE,
        &NARROW,
        &softmax::ADJOINT_GROUPS,
        &softmax::ADJOINT_LINES,
        &softmax::GROUPS,
        &softmax::LINES,
        &segment_repeat::KERNEL,
        &segment_sum::KERNEL,
        &SORT_BLOCKS,
        &SORT_STEPS,
        &SORT_TAILS,
        &convolution::FORWARD,
        &convolution::TRANSPOSED,
        &convolution::WEIGHTS,
        &max_pool::PICK,
        &max_pool::UNPOOL,
        &resample::KERNEL,
        &STRIDED,
        &take::KERNEL,
        &WIDEN,
    ]
}
