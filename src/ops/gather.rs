//! `gather`, `scatter_add` and `select_along`: elements by indices along any axis. They are
//! [`index_select`](super::index_select) and [`index_add`](super::index_add) over positions that are computed from the
//! indices on the host: one pair of kernels, sums in a fixed order on both backends.

use crate::backend::cpu::{CHUNK, filled};
use crate::tensor::Device;
use crate::{DType, Error, ErrorKind, Result, Shape, Tensor, Var};

/// The indices as the host knows them.
fn indices(index: &Tensor) -> Result<&[u32]> {
    match index.device() {
        Device::Cpu => Ok(index.slice()),
        Device::Gpu(_) => index.gpu_buffer().indices(),
    }
}

/// Fails if an index is not below the size of its axis.
fn check(op: &str, index: &Tensor, axis: usize, size: usize) -> Result<()> {
    match indices(index)?.iter().position(|&i| i as usize >= size) {
        None => Ok(()),
        Some(at) => Err(Error::new(ErrorKind::Input, format!("{op}: an index is outside axis {axis}"))
            .at(format!("index{:?}", index.shape().index(at)))
            .found(indices(index)?[at])
            .wanted(format!("below {size}"))),
    }
}

/// For each index, the flat position of its element in a tensor of shape `x`, where the other axes count on as in `index`.
fn positions(op: &str, index: &Var, axis: usize, x: &Shape) -> Result<Var> {
    let tensor = index.tensor();
    check(op, tensor, axis, x.dims()[axis])?;
    if u32::try_from(x.len()).is_err() {
        return Err(Error::new(ErrorKind::Unsupported, format!("{op}: too many elements to number by u32")).found(x));
    }
    let list = indices(tensor)?;
    let (dims, strides) = (tensor.dims(), x.strides());
    #[allow(clippy::cast_possible_truncation)]
    let values = filled(list.len(), CHUNK, |start, out: &mut [u32]| {
        let mut place = tensor.shape().index(start);
        for (out, &i) in out.iter_mut().zip(&list[start..]) {
            let others = place.iter().zip(&strides).enumerate().filter(|(a, _)| *a != axis);
            let base: usize = others.map(|(_, (i, stride))| i * stride).sum();
            *out = (base + i as usize * strides[axis]) as u32;
            for (i, size) in place.iter_mut().zip(dims).rev() {
                *i += 1;
                if *i < *size {
                    break;
                }
                *i = 0;
            }
        }
    });
    let positions = Tensor::from_vec(values, [list.len()]).to_device(&index.device())?;
    Ok(index.tape().constant(positions))
}

/// # Panics
/// When `index` is not `u32` or has another rank than `x`, is longer along another axis, or the axis does not exist.
#[track_caller]
fn check_shapes(op: &str, index: &Var, axis: usize, x: &Shape) {
    let fits = index.dtype() == DType::U32
        && index.shape().rank() == x.rank()
        && axis < x.rank()
        && (0..x.rank()).all(|a| a == axis || index.dims()[a] <= x.dims()[a]);
    assert!(fits, "{op}: {:?} does not index {x} along axis {axis}", index.spec());
}

impl Var {
    /// For each index, the element at that index along `axis` and at the index's own place along the others:
    /// `y[i, j, k] = x[i, index[i, j, k], k]` for axis 1.
    ///
    /// ```
    /// use gradreel::{Tape, Tensor};
    ///
    /// let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0f64, 2.0, 3.0, 4.0], [2, 2]));
    /// let index = tape.constant(Tensor::from_vec(vec![0u32, 0, 1, 0], [2, 2]));
    /// assert_eq!(x.gather(1, &index)?.value()?.slice::<f64>(), &[1.0, 1.0, 4.0, 3.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when an index is not below the size of the axis.
    ///
    /// # Panics
    /// When `index` is not `u32`, has another rank, or is longer along another axis; when the axis does not exist.
    #[track_caller]
    pub fn gather(&self, axis: usize, index: &Self) -> Result<Self> {
        check_shapes("gather", index, axis, self.shape());
        let positions = positions("gather", index, axis, self.shape())?;
        Ok(self.reshape([self.len()]).index_select(&positions)?.reshape(index.shape()))
    }

    /// This tensor with values added at the places that [`Var::gather`] would read with the same index:
    /// `y[i, index[i, j, k], k] += values[i, j, k]` for axis 1. Values for one place are added in row-major order.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![0.0, 0.0, 0.0], [3]));
    /// let index = tape.constant(Tensor::from_vec(vec![2u32, 2], [2]));
    /// let values = tape.leaf(Tensor::from_vec(vec![1.0, 5.0], [2]));
    /// assert_eq!(x.scatter_add(0, &index, &values)?.value()?.slice::<f64>(), [0.0, 0.0, 6.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when an index is not below the size of the axis.
    ///
    /// # Panics
    /// As [`Var::gather`], and when `values` has another shape than `index`.
    #[track_caller]
    pub fn scatter_add(&self, axis: usize, index: &Self, values: &Self) -> Result<Self> {
        check_shapes("scatter_add", index, axis, self.shape());
        assert!(values.shape() == index.shape(), "scatter_add: {:?} for {:?}", values.spec(), index.spec());
        let positions = positions("scatter_add", index, axis, self.shape())?;
        let added = values.reshape([values.len()]).index_add(&positions, self.len())?;
        Ok(self + added.reshape(self.shape()))
    }

    /// The slices at these indices, a list of `u32`, along `axis`: [`Var::index_select`] for any axis.
    ///
    /// ```
    /// # use gradreel::{Tape, Tensor};
    /// # let tape = Tape::new();
    /// let x = tape.leaf(Tensor::from_vec(vec![1.0, 2.0, 3.0, 4.0], [2, 2]));
    /// let index = tape.constant(Tensor::from_vec(vec![1u32], [1]));
    /// assert_eq!(x.select_along(1, &index)?.value()?.slice::<f64>(), [2.0, 4.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when an index is not below the size of the axis.
    ///
    /// # Panics
    /// When `index` is not a list of `u32`; when the axis does not exist.
    #[track_caller]
    pub fn select_along(&self, axis: usize, index: &Self) -> Result<Self> {
        let rank = self.shape().rank();
        assert!(axis < rank, "select_along: {:?} has no axis {axis}", self.spec());
        assert!(index.shape().rank() == 1 && index.dtype() == DType::U32, "select_along: {:?}", index.spec());
        if axis == 0 {
            return self.index_select(index);
        }
        // slices of every place of the axes before are rows
        let (before, size) = (&self.dims()[..axis], self.dims()[axis]);
        let outer: usize = before.iter().product();
        check("select_along", index.tensor(), axis, size)?;
        if u32::try_from(outer * size).is_err() {
            return Err(Error::new(ErrorKind::Unsupported, "select_along: too many rows to number by u32")
                .found(format!("{:?}", self.spec())));
        }
        let list = indices(index.tensor())?;
        #[allow(clippy::cast_possible_truncation)]
        let rows: Vec<u32> = (0..outer).flat_map(|o| list.iter().map(move |i| (o * size) as u32 + i)).collect();
        let count = rows.len();
        let rows = self.tape().constant(Tensor::from_vec(rows, [count]).to_device(&index.device())?);
        let inner = &self.dims()[axis + 1..];
        let row = inner.iter().product::<usize>();
        let picked = self.reshape([outer * size, row]).index_select(&rows)?;
        Ok(picked.reshape([before, &[list.len()], inner].concat()))
    }
}
