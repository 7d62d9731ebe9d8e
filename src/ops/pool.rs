//! The windows of pooling: settings and what follows from them.

use std::ops::Range;

use crate::ops::PerAxis;
use crate::ops::per_axis::three;
use crate::{Error, ErrorKind, Result, Spec};

/// The settings of pooling; [`Pool::new`] has windows side by side without padding. What takes a [`PerAxis`] takes one number
/// for all axes, or an array with one for each.
///
/// ```
/// use gradreel::{Tape, Tensor, ops::Pool};
/// let tape = Tape::new();
/// let x = tape.leaf(Tensor::from_vec(vec![1.0, 4.0, 2.0, 3.0], [1, 1, 4]));
/// assert_eq!(x.max_pool(&Pool::new(2)).value()?.slice::<f64>(), [4.0, 3.0]);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pool {
    kernel: PerAxis,
    stride: Option<PerAxis>,
    padding: PerAxis,
    counts_padding: bool,
}

impl Pool {
    /// Windows of this size, side by side.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Pool};
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 4.0, 2.0, 3.0], [1, 1, 4]));
    /// assert_eq!(x.max_pool(&Pool::new(2)).value()?.slice::<f64>(), [4.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn new(kernel: impl Into<PerAxis>) -> Self {
        Self { kernel: kernel.into(), stride: None, padding: 0.into(), counts_padding: true }
    }

    /// Distance between neighbouring windows; their size, if it is not set.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Pool};
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 4.0, 2.0, 3.0], [1, 1, 4]));
    /// assert_eq!(x.max_pool(&Pool::new(2).stride(1)).value()?.slice::<f64>(), [4.0, 4.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn stride(mut self, stride: impl Into<PerAxis>) -> Self {
        self.stride = Some(stride.into());
        self
    }

    /// Places around the image on each side, at most half a window. They count as zeros in a mean and never are a maximum.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Pool};
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 4.0, 2.0, 3.0], [1, 1, 4]));
    /// assert_eq!(x.max_pool(&Pool::new(2).padding(1)).value()?.slice::<f64>(), [1.0, 4.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn padding(mut self, padding: impl Into<PerAxis>) -> Self {
        self.padding = padding.into();
        self
    }

    /// Takes means over pixels alone: the padding is not counted (`count_include_pad=False` in PyTorch).
    ///
    /// ```
    /// use gradreel::{Tape, Tensor, ops::Pool};
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 4.0, 2.0, 3.0], [1, 1, 4]));
    /// let settings = Pool::new(2).padding(1).without_padding();
    /// assert_eq!(x.average_pool(&settings).value()?.slice::<f64>(), [1.0, 3.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[must_use]
    pub fn without_padding(mut self) -> Self {
        self.counts_padding = false;
        self
    }

    pub(super) fn counts_padding(&self) -> bool {
        self.counts_padding
    }

    /// The windows over images `[batch, channels, …]`.
    pub(super) fn windows(&self, op: &str, image: &Spec) -> Result<Windows> {
        let dims = image.shape.dims();
        let windows = dims.len().checked_sub(2).filter(|rank| (1..=3).contains(rank)).and_then(|rank| {
            let kernel = self.kernel.three(rank, 1)?;
            let stride = self.stride.as_ref().unwrap_or(&self.kernel).three(rank, 1)?;
            let padding = self.padding.three(rank, 0)?;
            let x = three(&dims[2..], 1)?;
            let mut y = [0; 3];
            for axis in 0..3 {
                let fits = kernel[axis] > 0 && stride[axis] > 0 && 2 * padding[axis] <= kernel[axis] && x[axis] > 0;
                let free = (x[axis] + 2 * padding[axis]).checked_sub(kernel[axis]).filter(|_| fits)?;
                y[axis] = free / stride[axis] + 1;
            }
            Some(Windows { rank, planes: dims[0] * dims[1], x, y, kernel, stride, padding })
        });
        windows.filter(|_| image.dtype.is_real()).ok_or_else(|| {
            Error::new(ErrorKind::Shape, format!("{op}: the settings do not fit"))
                .found(format!("{image:?}, {self:?}"))
                .wanted(
                    "batch, channels and one to three spatial axes, windows that fit, strides of at least 1, padding of \
                     at most half of one",
                )
                .fix("use smaller windows or less padding; one number sets all axes")
        })
    }
}

/// Windows over the planes of an image; absent axes have size 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Windows {
    pub(super) rank: usize,
    pub(super) planes: usize,
    pub(super) x: [usize; 3],
    pub(super) y: [usize; 3],
    pub(super) kernel: [usize; 3],
    pub(super) stride: [usize; 3],
    pub(super) padding: [usize; 3],
}

impl Windows {
    /// The pixels of a window along an axis.
    pub(super) fn window(&self, axis: usize, i: usize) -> Range<usize> {
        let start = i * self.stride[axis];
        let end = (start + self.kernel[axis]).saturating_sub(self.padding[axis]).min(self.x[axis]);
        start.saturating_sub(self.padding[axis])..end
    }

    /// Pixels and windows of a plane.
    pub(super) fn volumes(&self) -> [usize; 2] {
        [self.x, self.y].map(|size| size.iter().product())
    }
}
