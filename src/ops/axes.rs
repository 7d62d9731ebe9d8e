//! Axes added, dropped, exchanged, stacked and repeated: composed of reshape, permute, slice, concat and broadcast.

use std::ops::Range;

use crate::{Shape, Var};

impl Var {
    /// Drops an axis of size 1.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2, 1]));
    /// assert_eq!(x.squeeze(1).dims(), [2]);
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist or has another size.
    #[track_caller]
    #[must_use]
    pub fn squeeze(&self, axis: usize) -> Self {
        assert!(self.dims().get(axis) == Some(&1), "squeeze: axis {axis} of {:?} has not size 1", self.spec());
        let mut dims = self.dims().to_vec();
        dims.remove(axis);
        self.reshape(dims)
    }

    /// Puts in an axis of size 1 before axis `axis`, or behind the last one.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
    /// assert_eq!(x.unsqueeze(0).dims(), [1, 2]);
    /// ```
    ///
    /// # Panics
    /// When `axis` is beyond the number of axes.
    #[track_caller]
    #[must_use]
    pub fn unsqueeze(&self, axis: usize) -> Self {
        assert!(axis <= self.shape().rank(), "unsqueeze: {:?} has no place {axis}", self.spec());
        let mut dims = self.dims().to_vec();
        dims.insert(axis, 1);
        self.reshape(dims)
    }

    /// Exchanges two axes.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [2, 2]));
    /// assert_eq!(x.transpose(0, 1).value()?.slice::<f64>(), [1.0, 3.0, 2.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When one of them does not exist.
    #[track_caller]
    #[must_use]
    pub fn transpose(&self, a: usize, b: usize) -> Self {
        let rank = self.shape().rank();
        assert!(a < rank && b < rank, "transpose: {:?} has not both axes {a} and {b}", self.spec());
        let mut order: Vec<usize> = (0..rank).collect();
        order.swap(a, b);
        self.permute(&order)
    }

    /// Merges neighbouring axes into one: `x.flatten(1..3)` makes `[n, a, b, c]` to `[n, a · b, c]`.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::zeros([2, 3, 4], gradreel::DType::F64));
    /// assert_eq!(x.flatten(1..3).dims(), [2, 12]);
    /// ```
    ///
    /// # Panics
    /// When one of the axes does not exist or there is none.
    #[track_caller]
    #[must_use]
    pub fn flatten(&self, axes: Range<usize>) -> Self {
        let fits = axes.start < axes.end && axes.end <= self.shape().rank();
        assert!(fits, "flatten: {axes:?} are no axes of {:?}", self.spec());
        let mut dims = self.dims().to_vec();
        let merged = dims[axes.clone()].iter().product();
        dims.splice(axes, [merged]);
        self.reshape(dims)
    }

    /// Parts of these sizes, one after the other along an axis.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// let parts = x.split(0, &[1, 2]);
    /// assert_eq!(parts[1].value()?.slice::<f64>(), [2.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist or the sizes do not add up to its own.
    #[track_caller]
    #[must_use]
    pub fn split(&self, axis: usize, sizes: &[usize]) -> Vec<Self> {
        let whole = self.dims().get(axis).copied();
        let total: usize = sizes.iter().sum();
        assert!(whole == Some(total), "split: {sizes:?} do not fill axis {axis} of {:?}", self.spec());
        let mut start = 0;
        let mut parts = Vec::with_capacity(sizes.len());
        for size in sizes {
            parts.push(self.slice(axis, start..start + size));
            start += size;
        }
        parts
    }

    /// As many parts of one size along an axis.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [4]));
    /// let halves = x.chunk(0, 2);
    /// assert_eq!(halves[1].value()?.slice::<f64>(), [3.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist or its size is no multiple of `count`.
    #[track_caller]
    #[must_use]
    pub fn chunk(&self, axis: usize, count: usize) -> Vec<Self> {
        let size = self.dims().get(axis).copied().filter(|size| count > 0 && size % count == 0);
        let Some(size) = size else { panic!("chunk: axis {axis} of {:?} has not {count} equal parts", self.spec()) };
        self.split(axis, &vec![size / count; count])
    }

    /// This tensor and others of its shape side by side along a new axis.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [2]));
    /// let y = tape.leaf(Tensor::from_vec(vec![3.0, 4.0], [2]));
    /// assert_eq!(x.stack(&[&y], 1).value()?.slice::<f64>(), [1.0, 3.0, 2.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the shapes or dtypes differ, or `axis` is beyond the number of axes.
    #[track_caller]
    #[must_use]
    pub fn stack(&self, others: &[&Self], axis: usize) -> Self {
        if let Some(other) = others.iter().find(|other| other.shape() != self.shape()) {
            panic!("stack: the shapes {} and {} differ", self.shape(), other.shape());
        }
        let others: Vec<Self> = others.iter().map(|x| x.unsqueeze(axis)).collect();
        self.unsqueeze(axis).concat(&others.iter().collect::<Vec<_>>(), axis)
    }

    /// The tensor repeated along each axis: `[a, b]` repeated `[2, 3]` times is `[2 a, 3 b]`, copies side by side.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0], [1, 2]));
    /// assert_eq!(x.repeat(&[1, 2]).value()?.slice::<f64>(), [1.0, 2.0, 1.0, 2.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When there is not one number for each axis.
    #[track_caller]
    #[must_use]
    pub fn repeat(&self, times: &[usize]) -> Self {
        assert!(times.len() == self.shape().rank(), "repeat: {times:?} for {:?}", self.spec());
        let interleaved = |first: fn(usize) -> usize| -> Vec<usize> {
            times.iter().zip(self.dims()).flat_map(|(count, size)| [first(*count), *size]).collect()
        };
        let whole: Vec<usize> = times.iter().zip(self.dims()).map(|(count, size)| count * size).collect();
        self.reshape(interleaved(|_| 1)).broadcast_to(interleaved(|count| count)).reshape(whole)
    }

    /// Moves the elements along an axis by `shift` places; what leaves at the end comes in at the beginning.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0], [3]));
    /// assert_eq!(x.roll(0, 1).value()?.slice::<f64>(), [3.0, 1.0, 2.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the axis does not exist.
    #[track_caller]
    #[must_use]
    pub fn roll(&self, axis: usize, shift: isize) -> Self {
        let Some(&size) = self.dims().get(axis) else { panic!("roll: {:?} has no axis {axis}", self.spec()) };
        if size == 0 {
            return self.clone();
        }
        let shift = shift.rem_euclid(size.cast_signed()).cast_unsigned();
        if shift == 0 {
            return self.clone();
        }
        self.slice(axis, size - shift..size).concat(&[&self.slice(axis, 0..size - shift)], axis)
    }

    /// The same number in every place of a shape, in this tensor's dtype and on its device.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0], [1]));
    /// assert_eq!(x.full_like(7.0, [2]).value()?.slice::<f64>(), [7.0, 7.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    #[track_caller]
    #[must_use]
    pub fn full_like(&self, value: f64, shape: impl Into<Shape>) -> Self {
        self.number(value).broadcast_to(shape)
    }
}
