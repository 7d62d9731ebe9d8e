//! Shapes: sizes per axis, row-major, and the broadcasting rule.

use std::fmt;
use std::hash::{Hash, Hasher};
use std::ops::RangeInclusive;

use smallvec::SmallVec;

use crate::tensor::DType;
use crate::{Error, ErrorKind, Result};

/// Sizes per axis, outermost first. A scalar has no axes.
///
/// ```
/// use gradreel::Shape;
///
/// let image = Shape::from([4, 1, 3]);
/// assert_eq!(image.len(), 12);
/// assert_eq!(image.broadcast(&Shape::from([5, 1])).unwrap(), Shape::from([4, 5, 3]));
/// assert!(image.broadcast(&Shape::from([2])).is_err());
/// ```
#[derive(Clone)]
pub struct Shape(Dims);

/// The sizes of up to four axes lie in place: ops on small tensors must not pay for an allocation.
#[derive(Clone)]
enum Dims {
    Few(u8, [usize; 4]),
    Many(Box<[usize]>),
}

impl Shape {
    /// The shape of a scalar: no axes, one element.
    ///
    /// ```
    /// # use gradreel::Shape;
    /// assert_eq!(Shape::scalar().len(), 1);
    /// ```
    pub fn scalar() -> Self {
        Self::default()
    }

    /// Sizes per axis.
    ///
    /// ```
    /// # use gradreel::Shape;
    /// let shape = Shape::from([2, 3]);
    /// assert_eq!(shape.dims(), [2, 3]);
    /// ```
    pub fn dims(&self) -> &[usize] {
        match &self.0 {
            Dims::Few(rank, sizes) => &sizes[..usize::from(*rank)],
            Dims::Many(sizes) => sizes,
        }
    }

    /// Number of axes.
    ///
    /// ```
    /// # use gradreel::Shape;
    /// let shape = Shape::from([2, 3]);
    /// assert_eq!(shape.rank(), 2);
    /// ```
    pub fn rank(&self) -> usize {
        self.dims().len()
    }

    /// Number of elements; 1 for a scalar, 0 when an axis is empty.
    ///
    /// ```
    /// # use gradreel::Shape;
    /// let shape = Shape::from([2, 3]);
    /// assert_eq!(shape.len(), 6);
    /// ```
    pub fn len(&self) -> usize {
        self.dims().iter().product()
    }

    /// Whether there are no elements.
    ///
    /// ```
    /// # use gradreel::Shape;
    /// assert!(Shape::from([2, 0]).is_empty());
    /// ```
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Distance in elements between neighbours along each axis.
    ///
    /// ```
    /// # use gradreel::Shape;
    /// let shape = Shape::from([2, 3]);
    /// assert_eq!(shape.strides(), [3, 1]);
    /// ```
    pub fn strides(&self) -> Vec<usize> {
        let mut strides = vec![1; self.rank()];
        for axis in (1..self.rank()).rev() {
            strides[axis - 1] = strides[axis] * self.dims()[axis];
        }
        strides
    }

    /// The common shape of two operands: axes are aligned at the last one, and an axis of size 1 stretches.
    ///
    /// ```
    /// # use gradreel::Shape;
    /// let shape = Shape::from([2, 3]);
    /// assert_eq!(shape.broadcast(&Shape::from([2, 1]))?, shape);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] when two sizes differ and neither is 1.
    pub fn broadcast(&self, other: &Self) -> Result<Self> {
        if self == other {
            return Ok(self.clone());
        }
        let rank = self.rank().max(other.rank());
        let size = |shape: &Self, axis: usize| (axis + shape.rank()).checked_sub(rank).map_or(1, |a| shape.dims()[a]);
        let mut sizes = SmallVec::<[usize; 4]>::new();
        for axis in 0..rank {
            sizes.push(match (size(self, axis), size(other, axis)) {
                (a, b) if a == b => a,
                (1, b) => b,
                (a, 1) => a,
                (a, b) => {
                    return Err(Error::new(ErrorKind::Shape, "shapes do not broadcast")
                        .found(format!("{self} and {other}"))
                        .wanted(format!("equal sizes or 1 on axis {axis}, not {a} and {b}")));
                }
            });
        }
        if !Self::fits(&sizes) {
            return Err(Error::new(ErrorKind::Shape, "shapes broadcast to too many elements")
                .found(format!("{self} and {other}")));
        }
        Ok(Self::from(&sizes[..]))
    }

    /// Whether numbers of elements, offsets and bytes can be counted in a `usize`, also where another axis is empty.
    pub(crate) fn fits(dims: &[usize]) -> bool {
        dims.iter()
            .try_fold(1usize, |count, &size| count.checked_mul(size.max(1)))
            .is_some_and(|count| count <= isize::MAX as usize / size_of::<f64>())
    }

    /// The flat offset of a multi-index.
    ///
    /// ```
    /// # use gradreel::Shape;
    /// let shape = Shape::from([2, 3]);
    /// assert_eq!(shape.offset(&[1, 2]), 5);
    /// ```
    pub fn offset(&self, index: &[usize]) -> usize {
        index.iter().zip(self.dims()).fold(0, |offset, (i, size)| offset * size + i)
    }

    /// The multi-index of a flat offset.
    ///
    /// ```
    /// # use gradreel::Shape;
    /// let shape = Shape::from([2, 3]);
    /// assert_eq!(shape.index(5), [1, 2]);
    /// ```
    pub fn index(&self, offset: usize) -> Vec<usize> {
        let mut rest = offset;
        let mut index = vec![0; self.rank()];
        for (i, size) in index.iter_mut().zip(self.dims()).rev() {
            (*i, rest) = (rest % size, rest / size);
        }
        index
    }
}

impl PartialEq for Shape {
    #[inline]
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            // what is beyond the rank is 0 in both: no call, no loop
            (Dims::Few(rank, sizes), Dims::Few(others, theirs)) => rank == others && sizes == theirs,
            _ => self.dims() == other.dims(),
        }
    }
}

impl Eq for Shape {}

impl Hash for Shape {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.dims().hash(state);
    }
}

impl Default for Shape {
    fn default() -> Self {
        Self(Dims::Few(0, [0; 4]))
    }
}

impl<const N: usize> From<[usize; N]> for Shape {
    fn from(dims: [usize; N]) -> Self {
        Self::from(&dims[..])
    }
}

impl From<Vec<usize>> for Shape {
    fn from(dims: Vec<usize>) -> Self {
        Self::from(&dims[..])
    }
}

impl From<&[usize]> for Shape {
    fn from(dims: &[usize]) -> Self {
        assert!(Self::fits(dims), "a shape of too many elements: {dims:?}");
        let mut few = [0; 4];
        match few.get_mut(..dims.len()) {
            Some(part) => {
                part.copy_from_slice(dims);
                Self(Dims::Few(dims.len() as u8, few))
            }
            None => Self(Dims::Many(dims.into())),
        }
    }
}

impl From<&Shape> for Shape {
    fn from(shape: &Shape) -> Self {
        shape.clone()
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.dims())
    }
}

impl fmt::Debug for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

/// What an op needs to know of an operand before it runs: its shape and dtype.
///
/// ```
/// # use gradreel::{DType, Spec};
/// let spec = Spec::new([2, 3], DType::F32);
/// assert_eq!(spec.shape.dims(), [2, 3]);
/// ```
#[derive(Clone, PartialEq, Eq)]
pub struct Spec {
    /// Sizes per axis.
    pub shape: Shape,
    /// Element type.
    pub dtype: DType,
}

impl Spec {
    /// A spec of this shape and dtype.
    ///
    /// ```
    /// # use gradreel::{DType, Spec};
    /// assert_eq!(Spec::new([2], DType::F64).dtype, DType::F64);
    /// ```
    pub fn new(shape: impl Into<Shape>, dtype: DType) -> Self {
        Self { shape: shape.into(), dtype }
    }

    /// The specs of an op that takes `N` operands.
    ///
    /// ```
    /// # use gradreel::{DType, Spec};
    /// let specs = [Spec::new([2], DType::F64)];
    /// let [x] = Spec::exactly("square", &specs)?;
    /// assert_eq!(x.shape.len(), 2);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] when there are not `N`.
    pub fn exactly<'a, const N: usize>(op: &str, inputs: &'a [Self]) -> Result<&'a [Self; N]> {
        Self::between(op, inputs, N..=N)?.try_into().map_err(|_| unreachable!("they were counted"))
    }

    /// The specs of an op that takes so many operands.
    ///
    /// ```
    /// # use gradreel::{DType, Spec};
    /// let specs = [Spec::new([2], DType::F64)];
    /// assert!(Spec::between("linear", &specs, 2..=3).is_err());
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Shape`] when there are fewer or more.
    pub fn between<'a>(op: &str, inputs: &'a [Self], count: RangeInclusive<usize>) -> Result<&'a [Self]> {
        if count.contains(&inputs.len()) {
            return Ok(inputs);
        }
        let (least, most) = (count.start(), count.end());
        let wanted = if least == most { format!("{least}") } else { format!("{least} to {most}") };
        Err(Error::new(ErrorKind::Shape, format!("{op}: wrong number of operands"))
            .found(format!("{}: {inputs:?}", inputs.len()))
            .wanted(wanted))
    }

    /// The spec of an op that takes one operand, of a type that ops compute in.
    pub(crate) fn one_real<'a>(op: &str, inputs: &'a [Self]) -> Result<&'a Self> {
        let [x] = Self::exactly(op, inputs)?;
        x.real(op)
    }

    /// The spec of an operand of a type that ops compute in.
    pub(crate) fn real(&self, op: &str) -> Result<&Self> {
        if self.dtype.is_real() {
            return Ok(self);
        }
        Err(Error::new(ErrorKind::Shape, format!("{op} does not compute in {}", self.dtype))
            .found(format!("{self:?}"))
            .wanted("f32 or f64")
            .fix("cast it, with .cast(DType::F32)"))
    }
}

impl fmt::Debug for Spec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.dtype, self.shape)
    }
}
