//! The safetensors format: named tensors and text metadata; nothing in it can be executed.
//!
//! A file of any size is listed and read in parts with [`Archive::open`](super::Archive::open).

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use half::f16;
use safetensors::{Dtype, SafeTensors, View};

use crate::io::archive::{Contents, Entry, unknown};
use crate::io::bytes::write_whole;
use crate::io::{Archive, Stored};
use crate::{DType, Device, Error, ErrorKind, Result, Tensor};

/// Named tensors with text metadata, in memory.
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
    /// # Errors
    /// [`ErrorKind::Input`] when there is none.
    pub fn get(&self, name: &str) -> Result<&Tensor> {
        self.tensors.get(name).ok_or_else(|| unknown(name, self.tensors.keys().map(String::as_str)))
    }

    /// Reads a whole file, of any format that [`Archive`] reads.
    ///
    /// # Errors
    /// As [`Archive::open`] and [`Archive::load_all`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        Archive::open(path)?.load_all().map_err(|e| e.within(path.display()))
    }

    /// Reads a file that is already in memory.
    ///
    /// # Errors
    /// As [`TensorFile::read`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        Archive::from_bytes(bytes.to_vec())?.load_all()
    }

    /// Writes a safetensors file: a new one beside `path`, which then takes its place. Whoever opens `path`, even after a
    /// crash, finds the old content or the new.
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
    /// # Errors
    /// [`ErrorKind::Device`] when a tensor cannot be read back from its GPU; [`ErrorKind::Io`] when the format refuses.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let (tensors, metadata) = self.parts()?;
        safetensors::serialize(&tensors, metadata).map_err(refused)
    }

    #[expect(clippy::type_complexity, reason = "what the format's crate takes")]
    fn parts(&self) -> Result<(BTreeMap<String, OnCpu>, Option<HashMap<String, String>>)> {
        let on_cpu = self.tensors.iter().map(|(name, t)| Ok((name.clone(), OnCpu(t.to_device(&Device::Cpu)?))));
        Ok((on_cpu.collect::<Result<_>>()?, Some(self.metadata.clone().into_iter().collect())))
    }
}

pub(super) fn refused(e: safetensors::SafeTensorError) -> Error {
    Error::new(ErrorKind::Io, "cannot write a safetensors file").found(e)
}

/// Lists a file.
pub(super) fn list(bytes: &[u8]) -> Result<Contents> {
    let (header, about) = SafeTensors::read_metadata(bytes).map_err(|e| {
        Error::new(ErrorKind::Input, "not a readable file of tensors")
            .found(format!("as safetensors: {e}"))
            .wanted("safetensors, a PyTorch checkpoint or an .npz")
            .fix("write or copy the file again")
    })?;
    let start = 8 + header;
    let entries = about.tensors().into_iter().map(|(name, info)| {
        let (from, to) = info.data_offsets;
        let entry = match stored(info.dtype) {
            Some(stored) => Entry::contiguous(stored, info.shape.clone(), start + from..start + to),
            None => Err(Error::new(ErrorKind::Unsupported, "a tensor has a dtype that is not read")
                .found(format!("{:?}", info.dtype))
                .wanted("bool, an integer type, f16, bf16, f32 or f64")),
        };
        let entry = entry.map_err(|e| e.at(&name));
        (name, entry)
    });
    let metadata = about.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone()));
    Ok(Contents { entries: entries.collect(), metadata: metadata.collect() })
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
