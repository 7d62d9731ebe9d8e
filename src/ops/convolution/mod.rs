//! Convolutions in one, two and three dimensions: settings, and the methods that apply them.
//!
//! A family of three ops that is closed under differentiation: [`convolution`](forward) makes a result of image and weight,
//! [`transposed_convolution`](transposed) an image of result and weight (the gradient in the image), and
//! [`convolution_weights`](weights) a weight of image and result (the gradient in the weight). All three are linear in both
//! operands, and the derivatives of each are the other two.

pub(super) mod forward;
mod geometry;
pub(super) mod transposed;
pub(super) mod weights;

use std::rc::Rc;

pub(crate) use geometry::{Geometry, Links, Phase};

use crate::backend::gpu::Kernel;
use crate::ops::{Case, PerAxis};
use crate::{Error, ErrorKind, Var};
use forward::Convolution;
use transposed::TransposedConvolution;

const TEXT: &str = include_str!("../../../kernels/convolution.wgsl");
pub(super) static FORWARD: Kernel = Kernel::new("convolution", "forward", TEXT, &["y", "x", "w", "bias"]);
pub(super) static TRANSPOSED: Kernel = Kernel::new("convolution", "transposed", TEXT, &["y", "x", "w", "bias"]);
pub(super) static WEIGHTS: Kernel = Kernel::new("convolution", "weights", TEXT, &["y", "x", "w"]);

/// The settings of a convolution; [`Conv::new`] has stride 1, no padding, dilation 1 and one group. What takes a
/// [`PerAxis`] takes one number for all axes, or an array with one for each.
///
/// ```
/// use gradreel::{Tape, Tensor, ops::Conv};
/// let tape = Tape::new();
/// let image = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [1, 1, 4]));
/// let weight = tape.leaf(Tensor::from_vec(vec![1.0, 1.0], [1, 1, 2]));
/// let y = image.conv(&weight, None, &Conv::new().stride(2));
/// assert_eq!(y.value()?.slice::<f64>(), [3.0, 7.0]);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Conv {
    stride: PerAxis,
    padding: PerAxis,
    dilation: PerAxis,
    output_padding: PerAxis,
    groups: usize,
}

impl Default for Conv {
    fn default() -> Self {
        Self::new()
    }
}

impl Conv {
    /// Stride 1, no padding, dilation 1, one group.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Conv};
    /// let tape = Tape::new();
    /// let image = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [1, 1, 4]));
    /// let weight = tape.leaf(Tensor::from_vec(vec![1.0, 1.0], [1, 1, 2]));
    /// let y = image.conv(&weight, None, &Conv::new());
    /// assert_eq!(y.value()?.slice::<f64>(), [3.0, 5.0, 7.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn new() -> Self {
        Self { stride: 1.into(), padding: 0.into(), dilation: 1.into(), output_padding: 0.into(), groups: 1 }
    }

    /// Distance in the image between neighbours of the result.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Conv};
    /// let tape = Tape::new();
    /// let image = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [1, 1, 4]));
    /// let weight = tape.leaf(Tensor::from_vec(vec![1.0, 1.0], [1, 1, 2]));
    /// let y = image.conv(&weight, None, &Conv::new().stride(2));
    /// assert_eq!(y.value()?.slice::<f64>(), [3.0, 7.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn stride(mut self, stride: impl Into<PerAxis>) -> Self {
        self.stride = stride.into();
        self
    }

    /// Zeros around the image, so many on each side.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Conv};
    /// let tape = Tape::new();
    /// let image = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [1, 1, 4]));
    /// let weight = tape.leaf(Tensor::from_vec(vec![1.0, 1.0], [1, 1, 2]));
    /// let y = image.conv(&weight, None, &Conv::new().padding(1));
    /// assert_eq!(y.value()?.slice::<f64>(), [1.0, 3.0, 5.0, 7.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn padding(mut self, padding: impl Into<PerAxis>) -> Self {
        self.padding = padding.into();
        self
    }

    /// Distance in the image between neighbours of the kernel.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Conv};
    /// let tape = Tape::new();
    /// let image = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [1, 1, 4]));
    /// let weight = tape.leaf(Tensor::from_vec(vec![1.0, 1.0], [1, 1, 2]));
    /// let y = image.conv(&weight, None, &Conv::new().dilation(2));
    /// assert_eq!(y.value()?.slice::<f64>(), [4.0, 6.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn dilation(mut self, dilation: impl Into<PerAxis>) -> Self {
        self.dilation = dilation.into();
        self
    }

    /// For transposed convolutions: places added at the end of each axis of the result, less than the larger of stride and
    /// dilation. With a stride, images of several sizes give a result of the same size; this says which is meant.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Conv};
    /// let tape = Tape::new();
    /// let image = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [1, 1, 4]));
    /// let weight = tape.leaf(Tensor::from_vec(vec![1.0, 1.0], [1, 1, 2]));
    /// let settings = Conv::new().stride(2).output_padding(1);
    /// assert_eq!(image.conv_transpose(&weight, None, &settings).dims(), [1, 1, 9]);
    /// ```
    #[must_use]
    pub fn output_padding(mut self, padding: impl Into<PerAxis>) -> Self {
        self.output_padding = padding.into();
        self
    }

    /// Splits the channels into so many groups that do not see each other; as many as channels make it depth-wise.
    ///
    /// ```
    /// use gradreel::{DType, Tape, Tensor, ops::Conv};
    /// let tape = Tape::new();
    /// // two channels, each with a kernel of its own
    /// let image = tape.leaf(Tensor::full(1.0, [1, 2, 3], DType::F64));
    /// let weight = tape.leaf(Tensor::full(1.0, [2, 1, 3], DType::F64));
    /// let y = image.conv(&weight, None, &Conv::new().groups(2));
    /// assert_eq!(y.value()?.slice::<f64>(), [3.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn groups(mut self, groups: usize) -> Self {
        self.groups = groups;
        self
    }

    /// The links of `rank` spatial axes, or what the settings would have to be.
    fn links(&self, rank: usize) -> std::result::Result<Links, [&'static str; 2]> {
        let settings = [(&self.stride, 1), (&self.padding, 0), (&self.dilation, 1)];
        let [Some(stride), Some(padding), Some(dilation)] =
            settings.map(|(setting, absent)| setting.three(rank, absent))
        else {
            return Err(["settings for as many axes as the weight has", "give one number, or one for each axis"]);
        };
        if [stride, dilation].iter().flatten().any(|&step| step == 0) {
            return Err(["strides and dilations of at least 1", "a stride or dilation of 1 takes every place"]);
        }
        Ok(Links { rank, groups: self.groups, stride, padding, dilation })
    }

    /// The links between an image and a weight that have as many axes.
    #[track_caller]
    fn links_of(&self, op: &str, image: &Var, weight: &Var) -> Links {
        let rank = weight.dims().len().saturating_sub(2);
        let links = if (1..=3).contains(&rank) && image.dims().len() == rank + 2 {
            self.links(rank)
        } else {
            Err([
                "batch, channels and one to three spatial axes, as many for the image as for the weight",
                "reshape one of them; an axis of size 1 changes nothing",
            ])
        };
        links.unwrap_or_else(|reason| refuse(op, self, image, weight, reason))
    }

    /// The size of a transposed convolution's result, or what the settings would have to be.
    fn transposed_size(
        &self,
        links: &Links,
        y: &[usize],
        kernel: &[usize],
    ) -> std::result::Result<Vec<usize>, [&'static str; 2]> {
        let Some(extra) = self.output_padding.resolve(links.rank) else {
            return Err(["an output padding for as many axes as the weight has", "give one number, or one for each"]);
        };
        let first = 3 - links.rank;
        let most = |axis: usize| links.stride[first + axis].max(links.dilation[first + axis]);
        if (0..links.rank).any(|axis| extra[axis] >= most(axis)) {
            return Err([
                "an output padding below the larger of stride and dilation on each axis",
                "pad the result, or enlarge the stride",
            ]);
        }
        let size = |axis: usize| {
            let (stride, dilation) = (links.stride[first + axis], links.dilation[first + axis]);
            let reach = y[axis].checked_sub(1)?.checked_mul(stride)?;
            let whole =
                reach.checked_add(dilation.checked_mul(kernel[axis].checked_sub(1)?)?)?.checked_add(1 + extra[axis])?;
            whole.checked_sub(links.padding[first + axis].checked_mul(2)?).filter(|&size| size > 0)
        };
        (0..links.rank)
            .map(size)
            .collect::<Option<_>>()
            .ok_or(["a result of at least one place on each axis", "use less padding, or a larger image or kernel"])
    }
}

/// A wrong setting is the programmer's mistake.
#[track_caller]
fn refuse(op: &str, settings: &Conv, image: &Var, weight: &Var, [wanted, fix]: [&str; 2]) -> ! {
    let error = Error::new(ErrorKind::Shape, format!("{op}: the settings do not fit"))
        .found(format!("image {:?}, weight {:?}, {settings:?}", image.spec(), weight.spec()))
        .wanted(wanted)
        .fix(fix);
    panic!("{error}");
}

impl Var {
    /// The convolution of images `[batch, channels, (d,) (h,) w]` with a weight `[out, channels / groups, (d,) (h,) w]`, plus
    /// a bias `[out]`, in as many dimensions as the weight has:
    ///
    /// ```text
    /// y[n, o, p] = bias[o] + Σ_c Σ_k weight[o, c, k] · x[n, c, p · stride + k · dilation − padding]
    /// ```
    ///
    /// with zeros outside the image. The result is `[batch, out, …]` with
    /// `⌊(size + 2 padding − dilation (kernel − 1) − 1) / stride⌋ + 1` places along each axis. Differentiable in image,
    /// weight and bias, any number of times.
    ///
    /// ```
    /// use gradreel::{DType, Tape, Tensor, ops::Conv};
    ///
    /// let tape = Tape::new();
    /// let image = tape.leaf(Tensor::full(1.0, [1, 2, 5, 5], DType::F32));
    /// let (weight, bias) = (Tensor::full(0.5, [3, 2, 3, 3], DType::F32), Tensor::zeros([3], DType::F32));
    /// let y = image.conv(&tape.leaf(weight), Some(&tape.leaf(bias)), &Conv::new().padding(1).stride(2));
    /// assert_eq!(y.dims(), [1, 3, 3, 3]);
    /// assert_eq!(y.value()?.view::<f32>()[[0, 0, 1, 1]], 9.0); // all 18 taps are inside
    /// assert_eq!(y.value()?.view::<f32>()[[0, 0, 0, 0]], 4.0); // 8 of them are
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When shapes, dtypes or settings do not fit.
    #[track_caller]
    #[must_use]
    pub fn conv(&self, weight: &Self, bias: Option<&Self>, settings: &Conv) -> Self {
        let links = settings.links_of("convolution", self, weight);
        let size = links.places(&self.dims()[2..], &weight.dims()[2..]);
        let operands = [self, weight].into_iter().chain(bias).collect::<Vec<_>>();
        Self::run(Rc::new(Convolution { links, size }), &operands)
    }

    /// The transposed convolution of images `[batch, channels, (d,) (h,) w]` with a weight `[channels, out / groups, (d,) (h,)
    /// w]`, plus a bias `[out]`: the gradient of [`Var::conv`] in its image, as a layer that enlarges images. The result is
    /// `[batch, out, …]` with `(size − 1) stride − 2 padding + dilation (kernel − 1) + output_padding + 1` places along each
    /// axis. Differentiable in image, weight and bias, any number of times.
    ///
    /// ```
    /// use gradreel::{DType, Tape, Tensor, ops::Conv};
    ///
    /// let tape = Tape::new();
    /// let image = tape.leaf(Tensor::full(1.0, [1, 4, 8, 8, 8], DType::F32));
    /// let weight = tape.leaf(Tensor::full(0.1, [4, 2, 3, 3, 3], DType::F32));
    /// let doubled = Conv::new().stride(2).padding(1).output_padding(1);
    /// assert_eq!(image.conv_transpose(&weight, None, &doubled).dims(), [1, 2, 16, 16, 16]);
    /// ```
    ///
    /// # Panics
    /// When shapes, dtypes or settings do not fit.
    #[track_caller]
    #[must_use]
    pub fn conv_transpose(&self, weight: &Self, bias: Option<&Self>, settings: &Conv) -> Self {
        let op = "transposed_convolution";
        let links = settings.links_of(op, self, weight);
        let size = settings.transposed_size(&links, &self.dims()[2..], &weight.dims()[2..]);
        let size = size.unwrap_or_else(|reason| refuse(op, settings, self, weight, reason));
        let operands = [self, weight].into_iter().chain(bias).collect::<Vec<_>>();
        Self::run(Rc::new(TransposedConvolution { links, size }), &operands)
    }
}

/// Refuses a bias that is not one number for each channel of the result.
fn check_bias(op: &str, bias: Option<&crate::Spec>, result: &crate::Spec) -> crate::Result<()> {
    match bias {
        Some(bias) if bias.shape.dims() != &result.shape.dims()[1..2] || bias.dtype != result.dtype => {
            Err(Error::new(ErrorKind::Shape, format!("{op}: the bias does not fit"))
                .found(format!("{bias:?} for {result:?}"))
                .wanted(format!("{}[{}]", result.dtype, result.shape.dims()[1]))
                .fix("give one number for each channel of the result"))
        }
        _ => Ok(()),
    }
}

/// The gradient in a bias: sums over everything but the channels.
fn channel_sums(g: &Var) -> Var {
    g.sum(&(0..g.dims().len()).filter(|&axis| axis != 1).collect::<Vec<_>>())
}

/// The cases of all three ops: every rank, odd sizes, strides, dilations, groups, images that the kernel does not fill.
fn cases(case: impl Fn(Links, [Vec<usize>; 3], bool) -> Case) -> Vec<Case> {
    let make = |settings: Conv, x: &[usize], weight: &[usize], bias: bool| {
        let links = settings.links(weight.len() - 2).expect("settings for these axes");
        let mut y = vec![x[0], weight[0]];
        y.extend(links.places(&x[2..], &weight[2..]));
        case(links, [x.to_vec(), weight.to_vec(), y], bias)
    };
    vec![
        make(Conv::new().padding(1), &[2, 3, 5], &[2, 3, 3], true),
        make(Conv::new().padding(1), &[1, 2, 5, 4], &[3, 2, 3, 3], true),
        make(Conv::new(), &[2, 3, 3, 2], &[4, 3, 1, 1], false),
        make(Conv::new().stride(2).padding([1, 0]), &[1, 2, 6, 5], &[3, 2, 3, 2], false),
        make(Conv::new().dilation([2, 1]).padding([2, 1]), &[1, 2, 4, 5], &[2, 2, 3, 3], true),
        make(Conv::new().stride([2, 3]).dilation(2).padding(3), &[1, 1, 5, 7], &[2, 1, 2, 3], false),
        make(Conv::new().groups(2).padding(1), &[1, 4, 3, 3], &[6, 2, 3, 3], true),
        make(Conv::new().groups(3).stride(2).padding(1), &[2, 3, 5, 4], &[3, 1, 3, 3], false),
        make(Conv::new().padding(1), &[1, 2, 3, 4, 3], &[2, 2, 3, 3, 3], false),
        make(Conv::new().stride(2).padding([1, 1, 0]), &[1, 2, 4, 3, 5], &[2, 2, 3, 2, 3], true),
        make(Conv::new().stride([1, 2, 2]).groups(2), &[1, 2, 2, 3, 3], &[2, 1, 2, 3, 2], false),
        make(Conv::new().padding(1), &[0, 2, 3, 3], &[3, 2, 3, 3], true),
        make(Conv::new().padding(1), &[1, 17, 3, 6], &[18, 17, 3, 3], true),
    ]
}
