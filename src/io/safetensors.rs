//! The safetensors format: named tensors and text metadata; nothing in it can be executed.
//!
//! A file of any size is listed and read in parts with [`Archive::open`](super::Archive::open).

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt;
use std::path::Path;

use half::f16;
use safetensors::tensor::TensorInfo;
use safetensors::{Dtype, View};
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};

use crate::io::archive::{Contents, Entry, unknown};
use crate::io::bytes::write_whole;
use crate::io::source::Source;
use crate::io::{Archive, Stored};
use crate::{DType, Device, Error, ErrorKind, Result, Tensor};

/// Named tensors with text metadata, in memory.
///
/// ```
/// use gradreel::{Tensor, io::TensorFile};
/// let mut file = TensorFile::default();
/// file.tensors.insert("slope".into(), Tensor::from_vec(vec![2.0], [1]));
/// assert_eq!(TensorFile::from_bytes(&file.to_bytes()?)?.get("slope")?.item()?, 2.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct TensorFile {
    /// Tensors by name.
    pub tensors: BTreeMap<String, Tensor>,
    /// Free text by key.
    pub metadata: BTreeMap<String, String>,
}

impl TensorFile {
    /// The tensor of this name.
    ///
    /// ```
    /// use gradreel::{Tensor, io::TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![2.0], [1]));
    /// assert_eq!(file.get("slope")?.item()?, 2.0);
    /// assert!(file.get("offset").is_err());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when there is none.
    pub fn get(&self, name: &str) -> Result<&Tensor> {
        self.tensors.get(name).ok_or_else(|| unknown(name, self.tensors.keys().map(String::as_str)))
    }

    /// Reads a whole file, of any format that [`Archive`] reads.
    ///
    /// ```
    /// use gradreel::io::TensorFile;
    /// assert!(TensorFile::read("no-such-file.safetensors").is_err());
    /// ```
    ///
    /// # Errors
    /// As [`Archive::open`] and [`Archive::load_all`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        Archive::open(path)?.load_all().map_err(|e| e.within(path.display()))
    }

    /// Reads a file that is already in memory.
    ///
    /// ```
    /// use gradreel::{Tensor, io::TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![2.0], [1]));
    /// assert_eq!(TensorFile::from_bytes(&file.to_bytes()?)?.tensors.len(), 1);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`TensorFile::read`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        Archive::from_bytes(bytes.to_vec())?.load_all()
    }

    /// Writes a safetensors file: a new one beside `path`, which then takes its place. Whoever opens `path`, even after a
    /// crash, finds the old content or the new.
    ///
    /// ```
    /// use gradreel::{Tensor, io::TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![2.0], [1]));
    /// let path = std::env::temp_dir().join(format!("gradreel-write-{}.safetensors", std::process::id()));
    /// file.write(&path)?;
    /// assert_eq!(TensorFile::read(&path)?.get("slope")?.item()?, 2.0);
    /// # std::fs::remove_file(path).unwrap();
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Io`] when writing fails, [`ErrorKind::Input`] when the folder is missing or not writable,
    /// [`ErrorKind::Device`] when a tensor cannot be read back from its GPU.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let (tensors, metadata) = self.parts()?;
        write_whole(path, |partial| {
            safetensors::serialize_to_file(&tensors, metadata, partial).map_err(|e| match e {
                safetensors::SafeTensorError::IoError(e) => Error::io(path, "write the tensor file", &e),
                other => refused(other).at(path.display()),
            })
        })
    }

    /// The safetensors file as bytes.
    ///
    /// ```
    /// use gradreel::{Tensor, io::TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![2.0], [1]));
    /// assert!(!file.to_bytes()?.is_empty());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when a tensor cannot be read back from its GPU; [`ErrorKind::Io`] when the format refuses.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let (tensors, metadata) = self.parts()?;
        safetensors::serialize(&tensors, metadata).map_err(refused)
    }

    #[expect(clippy::type_complexity, reason = "what the format's crate takes")]
    fn parts(&self) -> Result<(BTreeMap<String, OnCpu>, Option<HashMap<String, String>>)> {
        let on_cpu = self.tensors.iter().map(|(name, t)| Ok((name.clone(), OnCpu(t.to_device(&Device::Cpu)?))));
        // the format's crate writes no valid header of empty metadata without tensors
        let metadata = (!self.metadata.is_empty()).then(|| self.metadata.clone().into_iter().collect());
        Ok((on_cpu.collect::<Result<_>>()?, metadata))
    }
}

pub(super) fn refused(e: safetensors::SafeTensorError) -> Error {
    Error::new(ErrorKind::Io, "cannot write a safetensors file").found(e)
}

/// A longer header is refused, as by the format's own crate \[bytes\].
const LARGEST_HEADER: usize = 100_000_000;

/// Lists a file.
pub(super) fn list(source: &Source) -> Result<Contents> {
    let unreadable = |found: String| {
        Error::new(ErrorKind::Input, "not a readable file of tensors")
            .found(format!("as safetensors: {found}"))
            .wanted("safetensors, a PyTorch checkpoint or an .npz")
            .fix("write or copy the file again")
    };
    let len = source.head(8)?.first_chunk().map(|len| u64::from_le_bytes(*len));
    let len = len.ok_or_else(|| unreadable(format!("{} bytes, fewer than its first number has", source.len())))?;
    let start = usize::try_from(len).ok().filter(|len| *len <= LARGEST_HEADER).map(|len| 8 + len);
    let start = start.filter(|start| *start <= source.len());
    let start = start.ok_or_else(|| unreadable(format!("a header of {len} bytes in a file of {}", source.len())))?;
    let text = source.read(8..start)?;
    let mut header: Header = serde_json::from_slice(&text).map_err(|e| unreadable(e.to_string()))?;
    header.tensors.sort_by_key(|(_, info)| info.data_offsets);
    let mut contents = Contents { metadata: header.metadata, ..Contents::default() };
    let mut end = 0;
    for (name, info) in header.tensors {
        let (from, to) = info.data_offsets;
        let bits = info.shape.iter().try_fold(info.dtype.bitsize(), |bits, size| bits.checked_mul(*size));
        if from != end || to < from || bits.is_none_or(|bits| bits % 8 != 0 || bits / 8 != to - from) {
            let found = format!("bytes {from} to {to} for {:?} of {:?}", info.shape, info.dtype);
            let wanted = format!("from byte {end} on as many as the tensor has");
            return Err(unreadable(found).at(&name).wanted(wanted));
        }
        if to > source.len() - start {
            let found = format!("a tensor up to byte {to} of {}", source.len() - start);
            return Err(unreadable(found).at(&name).fix("copy or download the file again: it may be cut short"));
        }
        end = to;
        let entry = match stored(info.dtype) {
            Some(stored) => Entry::contiguous(stored, info.shape, start + from..start + to),
            None => Err(Error::new(ErrorKind::Unsupported, "a tensor has a dtype that is not read")
                .found(format!("{:?}", info.dtype))
                .wanted("bool, an integer type, f16, bf16, f32 or f64")),
        };
        let entry = entry.map_err(|e| e.at(&name));
        contents.entries.insert(name, entry);
    }
    match end == source.len() - start {
        true => Ok(contents),
        false => Err(unreadable(format!("{} bytes behind the last tensor", source.len() - start - end))),
    }
}

/// The header of a file, in which each name stands once.
struct Header {
    tensors: Vec<(String, TensorInfo)>,
    metadata: BTreeMap<String, String>,
}

impl<'de> Deserialize<'de> for Header {
    fn deserialize<D: Deserializer<'de>>(header: D) -> Result<Self, D::Error> {
        header.deserialize_map(Entries)
    }
}

struct Entries;

impl<'de> Visitor<'de> for Entries {
    type Value = Header;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table of tensors by name")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Header, A::Error> {
        let (mut tensors, mut metadata) = (Vec::new(), None);
        let mut names = HashSet::new();
        while let Some(name) = map.next_key::<String>()? {
            if !names.insert(name.clone()) {
                return Err(twice(&name));
            }
            match &*name {
                "__metadata__" => metadata = map.next_value::<Option<Texts>>()?,
                _ => tensors.push((name, map.next_value()?)),
            }
        }
        Ok(Header { tensors, metadata: metadata.map(|texts| texts.0).unwrap_or_default() })
    }
}

/// Texts by key, each of which stands once.
struct Texts(BTreeMap<String, String>);

impl<'de> Deserialize<'de> for Texts {
    fn deserialize<D: Deserializer<'de>>(texts: D) -> Result<Self, D::Error> {
        texts.deserialize_map(Pairs)
    }
}

struct Pairs;

impl<'de> Visitor<'de> for Pairs {
    type Value = Texts;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("texts by key")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Texts, A::Error> {
        let mut texts = BTreeMap::new();
        while let Some((key, text)) = map.next_entry::<String, String>()? {
            if texts.contains_key(&key) {
                return Err(twice(&key));
            }
            texts.insert(key, text);
        }
        Ok(Texts(texts))
    }
}

fn twice<E: serde::de::Error>(name: &str) -> E {
    E::custom(format_args!("the name {name:?} stands twice in the header"))
}

fn stored(dtype: Dtype) -> Option<Stored> {
    Some(match dtype {
        Dtype::BOOL => Stored::Bool,
        Dtype::U8 => Stored::U8,
        Dtype::I8 => Stored::I8,
        Dtype::U16 => Stored::U16,
        Dtype::I16 => Stored::I16,
        Dtype::U32 => Stored::U32,
        Dtype::I32 => Stored::I32,
        Dtype::U64 => Stored::U64,
        Dtype::I64 => Stored::I64,
        Dtype::F16 => Stored::F16,
        Dtype::BF16 => Stored::Bf16,
        Dtype::F32 => Stored::F32,
        Dtype::F64 => Stored::F64,
        _ => return None,
    })
}

struct OnCpu(Tensor);

impl View for &OnCpu {
    fn dtype(&self) -> Dtype {
        match self.0.dtype() {
            DType::F16 => Dtype::F16,
            DType::F32 => Dtype::F32,
            DType::F64 => Dtype::F64,
            DType::U32 => Dtype::U32,
        }
    }

    fn shape(&self) -> &[usize] {
        self.0.dims()
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(raw_bytes(&self.0))
    }

    fn data_len(&self) -> usize {
        self.0.len() * self.0.dtype().size()
    }
}

/// The bytes of a tensor on the CPU, in the order of this machine (little-endian on all that are supported).
pub(super) fn raw_bytes(tensor: &Tensor) -> &[u8] {
    match tensor.dtype() {
        DType::F16 => bytemuck::cast_slice(tensor.slice::<f16>()),
        DType::F32 => bytemuck::cast_slice(tensor.slice::<f32>()),
        DType::F64 => bytemuck::cast_slice(tensor.slice::<f64>()),
        DType::U32 => bytemuck::cast_slice(tensor.slice::<u32>()),
    }
}
