//! NumPy's `.npy`: one array.
//!
//! Read are format versions 1 to 3, C and Fortran order, both byte orders, booleans, integers and floats (see
//! [`Stored::dtype`]); arrays of objects, text and records are refused. Written is version 1 (2 for a shape that needs it),
//! C order, little-endian. Headers of Python 2 (`(2L, 3L)`) are read, too. `.npz` archives are read by [`Archive`](super::Archive).

use std::ops::Range;
use std::path::Path;

use crate::io::archive::Entry;
use crate::io::bytes::write_whole;
use crate::io::element::{Stored, decode};
use crate::io::foreign::refuse_foreign;
use crate::io::safetensors::raw_bytes;
use crate::io::source::Source;
use crate::{DType, Device, Error, ErrorKind, Result, Tensor};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Reads a file.
///
/// ```
/// use gradreel::io::npy;
/// assert!(npy::read("no-such-file.npy").is_err());
/// ```
///
/// # Errors
/// [`ErrorKind::Input`] for a file that is missing, cut short or not of this format, [`ErrorKind::Unsupported`] for
/// elements that tensors do not hold.
pub fn read(path: impl AsRef<Path>) -> Result<Tensor> {
    let path = path.as_ref();
    let source = Source::open(path)?;
    array(&source, 0..source.len()).map_err(|e| e.within(path.display()))
}

/// Reads an array that is already in memory.
///
/// ```
/// use gradreel::Tensor;
/// use gradreel::io::npy;
///
/// let x = Tensor::from_vec(vec![1.0f32, 2.0, 3.0, 4.0], [2, 2]);
/// assert_eq!(npy::from_bytes(&npy::to_bytes(&x)?)?.slice::<f32>(), x.slice::<f32>());
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// As [`read`].
pub fn from_bytes(bytes: &[u8]) -> Result<Tensor> {
    array(&bytes.to_vec().into(), 0..bytes.len())
}

fn array(source: &Source, file: Range<usize>) -> Result<Tensor> {
    refuse_foreign(source, "a NumPy array (.npy)")?;
    let entry = entry(source, file)?;
    decode(entry.stored, &entry.numbers(source)?, entry.shape.clone())
}

/// Writes a file, whole or not at all.
///
/// ```
/// use gradreel::{Tensor, io::npy};
/// let x = Tensor::from_vec(vec![1.0, 2.0], [2]);
/// let path = std::env::temp_dir().join(format!("gradreel-npy-write-{}.npy", std::process::id()));
/// npy::write(&path, &x)?;
/// assert_eq!(npy::read(&path)?.slice::<f64>(), [1.0, 2.0]);
/// # std::fs::remove_file(path).unwrap();
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// [`ErrorKind::Io`] when writing fails, [`ErrorKind::Device`] when the tensor cannot be read back from its GPU.
pub fn write(path: impl AsRef<Path>, tensor: &Tensor) -> Result<()> {
    let (path, bytes) = (path.as_ref(), to_bytes(tensor)?);
    write_whole(path, |partial| std::fs::write(partial, &bytes).map_err(|e| Error::io(path, "write the array", &e)))
}

/// The file as bytes.
///
/// ```
/// use gradreel::{Tensor, io::npy};
/// let x = Tensor::from_vec(vec![1.0, 2.0], [2]);
/// assert_eq!(npy::from_bytes(&npy::to_bytes(&x)?)?.slice::<f64>(), [1.0, 2.0]);
/// # Ok::<(), gradreel::Error>(())
/// ```
///
/// # Errors
/// [`ErrorKind::Device`] when the tensor cannot be read back from its GPU.
pub fn to_bytes(tensor: &Tensor) -> Result<Vec<u8>> {
    let tensor = tensor.to_device(&Device::Cpu)?;
    let descr = match tensor.dtype() {
        DType::F16 => "<f2",
        DType::F32 => "<f4",
        DType::F64 => "<f8",
        DType::U32 => "<u4",
    };
    let mut shape = tensor.dims().iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    if tensor.dims().len() == 1 {
        shape.push(',');
    }
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    let version: u8 = if header.len() < usize::from(u16::MAX) - 128 { 1 } else { 2 };
    let before = MAGIC.len() + if version == 1 { 4 } else { 6 };
    // the numbers start at a multiple of 64
    let end = (before + header.len() + 1).next_multiple_of(64);
    header.extend(std::iter::repeat_n(' ', end - before - header.len() - 1));
    header.push('\n');
    let mut bytes = MAGIC.to_vec();
    bytes.extend([version, 0]);
    let len = header.len() as u32;
    bytes.extend(&len.to_le_bytes()[..if version == 1 { 2 } else { 4 }]);
    bytes.extend(header.bytes());
    bytes.extend(raw_bytes(&tensor));
    Ok(bytes)
}

/// A header names three things; one of an array with 64 axes has about 1 kB.
const LONGEST_HEADER: usize = 1 << 20;

/// Where the array of the `.npy` in this range is.
pub(super) fn entry(source: &Source, file: Range<usize>) -> Result<Entry> {
    let start = source.read(file.start..file.end.min(file.start + 12))?;
    let rest = start.strip_prefix(MAGIC).ok_or_else(|| damaged("another magic number"))?;
    let (len, before) = match rest {
        [1, _, a, b, ..] => (usize::from(u16::from_le_bytes([*a, *b])), 10),
        [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, 12),
        [1..=3, ..] => return Err(damaged("an end within the header")),
        [version, ..] => return Err(damaged(&format!("version {version}")).wanted("1, 2 or 3")),
        [] => return Err(damaged("an end after the magic number")),
    };
    let data = (file.start + before).checked_add(len).filter(|data| *data <= file.end && len <= LONGEST_HEADER);
    let data = data.ok_or_else(|| damaged("a header that is longer than the file"))?..file.end;
    let header = source.read(file.start + before..data.start)?;
    let header = &header[..];
    let header = str::from_utf8(header).map_err(|_| damaged("a header that is not UTF-8"))?;
    let Header { descr, fortran_order, dims } = Header::parse(header).ok_or_else(|| {
        let found: String = header.chars().take(200).collect();
        damaged(found.trim()).wanted("a header with descr, fortran_order and shape")
    })?;
    let (big_endian, stored) = element(descr).ok_or_else(|| {
        Error::new(ErrorKind::Unsupported, "the array has elements that are not read")
            .found(descr.chars().take(80).collect::<String>())
            .wanted("b1, i1 to i8, u1 to u8, or f2 to f8")
    })?;
    let bytes_wanted = dims.iter().try_fold(stored.size(), |n, d| n.checked_mul(*d));
    if bytes_wanted != Some(data.len()) {
        return Err(damaged(&format!("{} bytes for shape {dims:?} of {stored}", data.len())));
    }
    let mut entry = if fortran_order {
        let mut strides = vec![1usize; dims.len()];
        for axis in 1..dims.len() {
            strides[axis] = strides[axis - 1].saturating_mul(dims[axis - 1]);
        }
        Entry::new(stored, dims, strides, 0, data)?
    } else {
        Entry::contiguous(stored, dims, data)?
    };
    entry.big_endian = big_endian;
    Ok(entry)
}

fn damaged(found: &str) -> Error {
    Error::new(ErrorKind::Input, "not a readable .npy array")
        .found(found)
        .fix("copy it, or save it with numpy.save, again")
}

/// Byte order and element type of a `descr` such as `<f4`.
fn element(descr: &str) -> Option<(bool, Stored)> {
    let (order, kind) = descr.split_at_checked(1)?;
    let stored = match kind {
        "b1" => Stored::Bool,
        "i1" => Stored::I8,
        "i2" => Stored::I16,
        "i4" => Stored::I32,
        "i8" => Stored::I64,
        "u1" => Stored::U8,
        "u2" => Stored::U16,
        "u4" => Stored::U32,
        "u8" => Stored::U64,
        "f2" => Stored::F16,
        "f4" => Stored::F32,
        "f8" => Stored::F64,
        _ => return None,
    };
    match order {
        "<" => Some((false, stored)),
        ">" => Some((true, stored)),
        "|" if stored.size() == 1 => Some((false, stored)),
        _ => None,
    }
}

/// The three entries of a header, which is a dictionary in Python's notation.
struct Header<'a> {
    descr: &'a str,
    fortran_order: bool,
    dims: Vec<usize>,
}

impl<'a> Header<'a> {
    fn parse(text: &'a str) -> Option<Self> {
        let mut rest = text.trim().strip_prefix('{')?;
        let (mut descr, mut fortran_order, mut dims) = (None, None, None);
        loop {
            rest = rest.trim_start();
            if rest == "}" {
                return Some(Self { descr: descr?, fortran_order: fortran_order?, dims: dims? });
            }
            let (key, after) = quoted(rest)?;
            let value = after.trim_start().strip_prefix(':')?.trim_start();
            match key {
                // a list, which is a record, is no element type that is read, but its text says so in the error
                "descr" if value.starts_with('[') => {
                    let end = value.rfind(']')? + 1;
                    (descr, rest) = (Some(&value[..end]), &value[end..]);
                }
                "descr" => {
                    let (value, after) = quoted(value)?;
                    (descr, rest) = (Some(value), after);
                }
                "fortran_order" => {
                    let word = value.split([',', '}']).next()?;
                    fortran_order = Some(match word.trim() {
                        "True" => true,
                        "False" => false,
                        _ => return None,
                    });
                    rest = &value[word.len()..];
                }
                "shape" => {
                    let (inside, after) = value.strip_prefix('(')?.split_once(')')?;
                    let sizes = inside.split(',').map(str::trim).filter(|size| !size.is_empty());
                    // Python 2 writes its long integers with an L
                    let size = |size: &str| size.strip_suffix('L').unwrap_or(size).parse().ok();
                    dims = Some(sizes.map(size).collect::<Option<Vec<usize>>>()?);
                    rest = after;
                }
                _ => return None,
            }
            rest = rest.trim_start();
            rest = rest.strip_prefix(',').unwrap_or(rest);
        }
    }
}

fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text[1..].split_once(quote)
}
