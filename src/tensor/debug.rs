//! Tensors as text for people: dtype, shape, device and the first numbers.

use std::fmt;

use half::f16;

use crate::tensor::storage::Storage;
use crate::{DType, Element, Tensor};

/// Numbers up to which all are shown.
const ALL: usize = 16;
/// Numbers shown at the beginning of an axis that is cut short; one more is shown at its end.
const FIRST: usize = 3;

/// One line: `f64[2, 3] on cpu: [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]`, with `…` where numbers are left out.
///
/// Numbers on a GPU are not read back for it.
impl fmt::Debug for Tensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} on {}", self.spec(), self.device())?;
        match self.storage() {
            Storage::Gpu(_) => f.write_str(", not read back"),
            Storage::Hollow(..) => f.write_str(", freed"),
            Storage::Cpu(_) | Storage::One(_) => {
                f.write_str(": ")?;
                match self.dtype() {
                    DType::F16 => numbers(f, self.slice::<f16>(), self.dims()),
                    DType::F32 => numbers(f, self.slice::<f32>(), self.dims()),
                    DType::F64 => numbers(f, self.slice::<f64>(), self.dims()),
                    DType::U32 => numbers(f, self.slice::<u32>(), self.dims()),
                }
            }
        }
    }
}

/// The numbers under these axes, nested like them.
fn numbers<T: Element>(f: &mut fmt::Formatter<'_>, values: &[T], dims: &[usize]) -> fmt::Result {
    let whole = values.len() <= ALL;
    nested(f, values, dims, whole)
}

fn nested<T: Element>(f: &mut fmt::Formatter<'_>, values: &[T], dims: &[usize], whole: bool) -> fmt::Result {
    let Some((&size, inner)) = dims.split_first() else { return write!(f, "{:?}", values[0]) };
    let step = values.len() / size.max(1);
    // few of the outer axes, so that a line stays a line
    let first = if inner.len() < 2 { FIRST } else { 1 };
    f.write_str("[")?;
    let mut i = 0;
    while i < size {
        if i > 0 {
            f.write_str(", ")?;
        }
        if !whole && i == first && size > first + 1 {
            f.write_str("…, ")?;
            i = size - 1;
        }
        nested(f, &values[i * step..(i + 1) * step], inner, whole)?;
        i += 1;
    }
    f.write_str("]")
}
