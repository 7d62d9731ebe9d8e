//! Element types of files, and how they become elements of tensors.

use std::borrow::Cow;
use std::fmt;

use half::{bf16, f16};

use crate::backend::cpu;
use crate::{DType, Element, Error, ErrorKind, Result, Shape, Tensor};

/// The type of the numbers in a file. Tensors have fewer: see [`Stored::dtype`].
///
/// ```
/// use gradreel::{DType, io::Stored};
/// assert_eq!(Stored::Bf16.dtype(), DType::F32);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names are the documentation")]
pub enum Stored {
    Bool,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F16,
    Bf16,
    F32,
    F64,
}

impl Stored {
    /// Bytes per element.
    ///
    /// ```
    /// assert_eq!(gradreel::io::Stored::F64.size(), 8);
    /// ```
    pub fn size(self) -> usize {
        match self {
            Self::Bool | Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 | Self::F16 | Self::Bf16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// What it is read as: `f16`, `f32` and `f64` as they are; `bf16` as `f32`, which holds every value of it exactly
    /// (`f16` would not); booleans as 0 and 1, and integers, as `u32`. A tensor with an integer that `u32` does not hold, a
    /// negative one for instance, becomes `f64`, if that holds all of its numbers exactly (up to 2⁵³).
    ///
    /// ```
    /// use gradreel::{DType, io::Stored};
    /// assert_eq!(Stored::F16.dtype(), DType::F16);
    /// ```
    pub fn dtype(self) -> DType {
        match self {
            Self::F16 => DType::F16,
            Self::Bf16 | Self::F32 => DType::F32,
            Self::F64 => DType::F64,
            _ => DType::U32,
        }
    }

    /// Whether it is one of the four types of floats.
    ///
    /// ```
    /// assert!(gradreel::io::Stored::F32.is_float());
    /// ```
    pub fn is_float(self) -> bool {
        matches!(self, Self::F16 | Self::Bf16 | Self::F32 | Self::F64)
    }
}

impl fmt::Display for Stored {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&format!("{self:?}").to_lowercase())
    }
}

/// A tensor of the numbers in `bytes` (little-endian, in row-major order), as [`Stored::dtype`].
///
/// Every element is checked: a boolean other than 0 and 1, and an integer that neither `u32` nor `f64` holds, is an error.
pub(super) fn decode(stored: Stored, bytes: &[u8], shape: Shape) -> Result<Tensor> {
    Ok(match stored {
        Stored::F16 => floats(bytes, shape, f16::from_le_bytes),
        Stored::Bf16 => floats(bytes, shape, |b| bf16::from_le_bytes(b).to_f32()),
        Stored::F32 => floats(bytes, shape, f32::from_le_bytes),
        Stored::F64 => floats(bytes, shape, f64::from_le_bytes),
        Stored::Bool => integers(bytes, shape, DType::U32, 0..=1, |[b]| i128::from(b))?,
        _ => whole(stored, bytes, shape.clone(), DType::U32).or_else(|_| whole(stored, bytes, shape, DType::F64))?,
    })
}

/// As [`decode`], in another dtype: floats are rounded to the nearest, integers must be held exactly.
pub(super) fn decode_as(stored: Stored, bytes: &[u8], shape: Shape, dtype: DType) -> Result<Tensor> {
    match (stored.is_float(), dtype) {
        (true, dtype) if dtype == stored.dtype() => decode(stored, bytes, shape),
        (true, DType::U32) => Err(Error::new(ErrorKind::Unsupported, "floats are not read as integers").found(stored)),
        (true, _) => decode(stored, bytes, shape)?.cast(dtype),
        (false, _) if stored == Stored::Bool => decode(stored, bytes, shape)?.cast(dtype),
        (false, _) => whole(stored, bytes, shape, dtype),
    }
}

fn whole(stored: Stored, bytes: &[u8], shape: Shape, dtype: DType) -> Result<Tensor> {
    let range = match dtype {
        DType::U32 => 0..=i128::from(u32::MAX),
        DType::F16 => -(1 << 11)..=1 << 11,
        DType::F32 => -(1 << 24)..=1 << 24,
        DType::F64 => -(1 << 53)..=1 << 53,
    };
    match stored {
        Stored::U8 => integers(bytes, shape, dtype, range, |b| u8::from_le_bytes(b).into()),
        Stored::I8 => integers(bytes, shape, dtype, range, |b| i8::from_le_bytes(b).into()),
        Stored::U16 => integers(bytes, shape, dtype, range, |b| u16::from_le_bytes(b).into()),
        Stored::I16 => integers(bytes, shape, dtype, range, |b| i16::from_le_bytes(b).into()),
        Stored::U32 => integers(bytes, shape, dtype, range, |b| u32::from_le_bytes(b).into()),
        Stored::I32 => integers(bytes, shape, dtype, range, |b| i32::from_le_bytes(b).into()),
        Stored::U64 => integers(bytes, shape, dtype, range, |b| u64::from_le_bytes(b).into()),
        Stored::I64 => integers(bytes, shape, dtype, range, |b| i64::from_le_bytes(b).into()),
        _ => unreachable!("{stored} is no integer"),
    }
}

fn floats<const N: usize, T: Element>(bytes: &[u8], shape: Shape, read: impl Fn([u8; N]) -> T + Sync) -> Tensor {
    let (elements, _) = bytes.as_chunks::<N>();
    let values = cpu::filled(elements.len(), cpu::CHUNK, |start, part: &mut [T]| {
        let end = start + part.len();
        for (value, element) in part.iter_mut().zip(&elements[start..end]) {
            *value = read(*element);
        }
    });
    Tensor::from_vec(values, shape)
}

fn integers<const N: usize>(
    bytes: &[u8],
    shape: Shape,
    dtype: DType,
    range: std::ops::RangeInclusive<i128>,
    read: impl Fn([u8; N]) -> i128 + Sync,
) -> Result<Tensor> {
    let (elements, _) = bytes.as_chunks::<N>();
    if let Some(position) = elements.iter().position(|element| !range.contains(&read(*element))) {
        return Err(Error::new(ErrorKind::Unsupported, "a number in the file does not fit the tensor")
            .found(format!("{} as element {position}", read(elements[position])))
            .wanted(format!("{} to {}, which {dtype} holds exactly", range.start(), range.end())));
    }
    Ok(match dtype {
        DType::U32 => floats(bytes, shape, |b: [u8; N]| read(b) as u32),
        DType::F16 => floats(bytes, shape, |b: [u8; N]| f16::from_f64(read(b) as f64)),
        DType::F32 => floats(bytes, shape, |b: [u8; N]| read(b) as f32),
        DType::F64 => floats(bytes, shape, |b: [u8; N]| read(b) as f64),
    })
}

/// Negates little-endian elements: floats exactly, integers as PyTorch does, modulo their range.
pub(super) fn negate(stored: Stored, bytes: &mut [u8]) {
    for element in bytes.chunks_exact_mut(stored.size()) {
        if stored.is_float() {
            *element.last_mut().expect("one byte at least") ^= 0x80;
        } else {
            let mut carry = true;
            for byte in element {
                (*byte, carry) = (!*byte).overflowing_add(u8::from(carry));
            }
        }
    }
}

/// Whether the elements lie one behind the other in row-major order.
pub(super) fn is_dense(shape: &Shape, strides: &[usize]) -> bool {
    let dense = shape.strides();
    shape.dims().iter().zip(strides.iter().zip(&dense)).all(|(d, (s, t))| *d == 1 || s == t)
}

/// The elements of a view in row-major order. `strides` and `offset` count elements of `size` bytes; the caller has checked
/// that the view lies within `storage`.
pub(super) fn gather<'a>(
    storage: &'a [u8],
    size: usize,
    shape: &Shape,
    strides: &[usize],
    offset: usize,
) -> Cow<'a, [u8]> {
    if shape.is_empty() {
        return Cow::Borrowed(&[]);
    }
    if is_dense(shape, strides) {
        return Cow::Borrowed(&storage[offset * size..(offset + shape.len()) * size]);
    }
    let inner = shape.dims().last().copied().unwrap_or(1);
    let step = strides.last().copied().unwrap_or(1);
    let mut gathered = Vec::with_capacity(shape.len() * size);
    let mut index = vec![0; shape.rank() - 1];
    let mut row = offset;
    loop {
        if step == 1 {
            gathered.extend_from_slice(&storage[row * size..(row + inner) * size]);
        } else {
            for i in 0..inner {
                let at = (row + i * step) * size;
                gathered.extend_from_slice(&storage[at..at + size]);
            }
        }
        // the next row: count up the outer axes like an odometer
        let mut axis = index.len();
        loop {
            if axis == 0 {
                return Cow::Owned(gathered);
            }
            axis -= 1;
            index[axis] += 1;
            row += strides[axis];
            if index[axis] < shape.dims()[axis] {
                break;
            }
            row -= index[axis] * strides[axis];
            index[axis] = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transposed_slice_is_gathered_in_row_major_order() {
        let storage: Vec<u8> = (0..24).collect();
        // [2, 3, 4] permuted to [4, 2] at row 1 of the middle axis
        let view = gather(&storage, 1, &Shape::from([4, 2]), &[1, 12], 4);
        assert_eq!(*view, [4, 16, 5, 17, 6, 18, 7, 19]);
        let wide = gather(&storage, 2, &Shape::from([3]), &[0], 5);
        assert_eq!(*wide, [10, 11, 10, 11, 10, 11]);
    }

    #[test]
    fn an_integer_that_does_not_fit_is_named_with_its_position() {
        let read = |values: [i64; 2], dtype: Option<DType>| {
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            match dtype {
                None => decode(Stored::I64, &bytes, Shape::from([2])),
                Some(dtype) => decode_as(Stored::I64, &bytes, Shape::from([2]), dtype),
            }
        };
        assert_eq!(read([3, 7], None).unwrap().slice::<u32>(), [3, 7]);
        assert_eq!(read([3, -7], None).unwrap().slice::<f64>(), [3.0, -7.0]);
        assert_eq!(read([3, 7], Some(DType::F64)).unwrap().slice::<f64>(), [3.0, 7.0]);
        for (values, dtype) in [([3, -7], Some(DType::U32)), ([3, (1 << 53) + 1], None), ([3, 2049], Some(DType::F16))]
        {
            let error = read(values, dtype).unwrap_err().to_string();
            assert!(error.contains(&format!("{} as element 1", values[1])), "{error}");
        }
    }

    #[test]
    fn negatives_are_exact() {
        let mut floats: Vec<u8> = [1.5f32, 0.0, f32::INFINITY].iter().flat_map(|v| v.to_le_bytes()).collect();
        negate(Stored::F32, &mut floats);
        let read = decode(Stored::F32, &floats, Shape::from([3])).unwrap();
        assert_eq!(read.slice::<f32>(), [-1.5, -0.0, f32::NEG_INFINITY]);
        assert!(read.slice::<f32>()[1].is_sign_negative());
        let mut integers: Vec<u8> = [0i16, 256, -3].iter().flat_map(|v| v.to_le_bytes()).collect();
        negate(Stored::I16, &mut integers);
        assert_eq!(integers, [0i16, -256, 3].map(i16::to_le_bytes).concat());
    }

    #[test]
    fn bf16_widens_exactly() {
        let bytes: Vec<u8> = [1.0f32, -3.140625, 1e30].iter().flat_map(|v| bf16::from_f32(*v).to_le_bytes()).collect();
        let read = decode(Stored::Bf16, &bytes, Shape::from([3])).unwrap();
        assert_eq!(read.slice::<f32>()[..2], [1.0, -3.140625]);
        assert!((read.slice::<f32>()[2] / 1e30 - 1.0).abs() < 1.0 / 256.0);
    }
}
