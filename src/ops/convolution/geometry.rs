//! Which elements of image, weight and result a convolution brings together.

use crate::backend::gpu::words;
use crate::ops::per_axis::three;
use crate::{Error, ErrorKind, Result, Spec};

/// How the places of a result are linked to those of an image: `x = y · stride + tap · dilation − padding` on each of the
/// last `rank` of three axes. The absent axes have stride and dilation 1 and no padding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Links {
    pub(crate) rank: usize,
    pub(crate) groups: usize,
    pub(crate) stride: [usize; 3],
    pub(crate) padding: [usize; 3],
    pub(crate) dilation: [usize; 3],
}

/// All sizes of one convolution. `x` is the image `[batch, groups · inputs, x…]`, `y` the result `[batch, groups · outputs,
/// y…]`, and the weight is `[groups · outputs, inputs, kernel…]`, whichever of the three is being computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Geometry {
    pub(crate) batch: usize,
    pub(crate) groups: usize,
    /// Channels of one group of the image.
    pub(crate) inputs: usize,
    /// Channels of one group of the result.
    pub(crate) outputs: usize,
    pub(crate) x: [usize; 3],
    pub(crate) y: [usize; 3],
    pub(crate) kernel: [usize; 3],
    pub(crate) stride: [usize; 3],
    pub(crate) padding: [usize; 3],
    pub(crate) dilation: [usize; 3],
}

impl Links {
    /// The most places that a result can have along each of the `rank` axes; 0 where the kernel does not fit.
    pub(crate) fn places(&self, x: &[usize], kernel: &[usize]) -> Vec<usize> {
        let first = 3 - self.rank;
        (0..self.rank)
            .map(|axis| {
                let (stride, padding) = (self.stride[first + axis], self.padding[first + axis]);
                let reach =
                    self.dilation[first + axis].saturating_mul(kernel[axis].saturating_sub(1)).saturating_add(1);
                let padded = x[axis].saturating_add(padding.saturating_mul(2));
                padded.checked_sub(reach).map_or(0, |free| free / stride + 1)
            })
            .collect()
    }

    /// The sizes that the three tensors agree on.
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] when they do not.
    pub(crate) fn fit(&self, op: &str, x: &Spec, weight: &Spec, y: &Spec) -> Result<Geometry> {
        // what is an image to one op is a result to its transpose
        let [image, result] = if op.starts_with("transposed") { ["result", "image"] } else { ["image", "result"] };
        let wrong = |wanted: String, fix: &str| {
            Error::new(ErrorKind::Shape, format!("{op}: the operands do not fit"))
                .found(format!("{image} {x:?}, weight {weight:?}, {result} {y:?}, groups {}", self.groups))
                .wanted(wanted)
                .fix(fix)
        };
        let (a, w, b) = (x.shape.dims(), weight.shape.dims(), y.shape.dims());
        if a.len() != self.rank + 2 || w.len() != self.rank + 2 || b.len() != self.rank + 2 {
            return Err(wrong(format!("batch, channels and {} spatial axes", self.rank), "reshape the operands"));
        }
        if x.dtype != weight.dtype || x.dtype != y.dtype || !x.dtype.is_real() {
            return Err(wrong("all of f32, or all of f64".to_owned(), "cast one of them"));
        }
        let groups = self.groups;
        if groups == 0 || a[1] % groups != 0 || b[1] % groups != 0 {
            let wanted = format!("numbers of channels that are multiples of {} groups", groups.max(1));
            return Err(wrong(wanted, "choose a number of groups that divides both numbers of channels"));
        }
        if w[0] != b[1] || w[1] != a[1] / groups || a[0] != b[0] {
            let [inputs, outputs] = [a[1] / groups, b[1]];
            let wanted = format!("a weight of [{outputs}, {inputs}, kernel…] and equal batches");
            return Err(wrong(wanted, "permute the weight's first axes, or set the groups"));
        }
        if [self.stride, self.dilation].iter().flatten().any(|&n| n == 0) {
            let fix = "a stride or dilation of 1 takes every place";
            return Err(wrong("strides and dilations of at least 1".to_owned(), fix));
        }
        let most = self.places(&a[2..], &w[2..]);
        if w[2..].contains(&0) || most.contains(&0) || b[2..].iter().zip(&most).any(|(b, most)| b > most) {
            let wanted = format!("a kernel that fits the padded image, and at most {most:?} places");
            return Err(wrong(wanted, "use a smaller kernel or dilation, or more padding"));
        }
        if a[2..].contains(&0) || b[2..].contains(&0) {
            return Err(wrong("spatial axes that are not empty".to_owned(), "leave the convolution of nothing out"));
        }
        let spatial = |dims: &[usize]| {
            three(&dims[2..], 1).ok_or_else(|| wrong("at most 3 spatial axes".to_owned(), "merge axes"))
        };
        Ok(Geometry {
            batch: a[0],
            groups,
            inputs: a[1] / groups,
            outputs: b[1] / groups,
            x: spatial(a)?,
            y: spatial(b)?,
            kernel: spatial(w)?,
            stride: self.stride,
            padding: self.padding,
            dilation: self.dilation,
        })
    }
}

impl Geometry {
    /// Places of the image, of the result and of the kernel.
    pub(crate) fn volumes(&self) -> [usize; 3] {
        [self.x, self.y, self.kernel].map(|size| size.iter().product())
    }

    /// The parameter struct of `kernels/convolution.wgsl`.
    pub(super) fn words(&self, with_bias: bool) -> Vec<u32> {
        let mut all = words([self.batch, self.groups, self.inputs, self.outputs]).to_vec();
        let with = [usize::from(with_bias), 0, 0, 0, 0, 0];
        let axes = [self.x, self.y, self.kernel, self.stride, self.padding, self.dilation];
        for (axis, last) in axes.into_iter().zip(with) {
            all.extend(words([axis[0], axis[1], axis[2], last]));
        }
        all
    }

    /// The places of the image along `axis` by the taps that meet them.
    pub(crate) fn phases(&self, axis: usize) -> Vec<Phase> {
        let (stride, dilation, padding) = (self.stride[axis], self.dilation[axis], self.padding[axis]);
        let phase = |remainder: usize| {
            let first = (remainder + stride - padding % stride) % stride;
            Phase {
                first,
                count: self.x[axis].saturating_sub(first).div_ceil(stride),
                taps: (0..self.kernel[axis]).filter(|tap| tap * dilation % stride == remainder).collect(),
            }
        };
        (0..stride).map(phase).filter(|phase| phase.count > 0).collect()
    }

    /// The parameter struct of `kernels/convolution.wgsl` for one phase of a transposed convolution.
    pub(super) fn words_of(&self, phase: [&Phase; 3], with_bias: bool) -> Vec<u32> {
        let mut all = self.words(with_bias);
        let step = |phase: &Phase| phase.taps.get(1).map_or(1, |second| second - phase.taps[0]);
        for axis in [
            phase.map(|phase| phase.first),
            phase.map(|phase| phase.count),
            phase.map(|phase| phase.taps.first().copied().unwrap_or(0)),
            phase.map(step),
            phase.map(|phase| phase.taps.len()),
        ] {
            all.extend(words([axis[0], axis[1], axis[2], 0]));
        }
        all
    }
}

/// Places `first + i · stride` of an image along one axis, for `i` below `count`: to all of them the same taps of the kernel
/// lead, evenly spaced, and among them a transposed convolution is one of stride 1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Phase {
    pub(crate) first: usize,
    pub(crate) count: usize,
    pub(crate) taps: Vec<usize>,
}
