//! The safetensors format: named tensors and text metadata; nothing in it can be executed.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use half::f16;
use safetensors::{Dtype, SafeTensors, View};

use crate::{DType, Device, Error, ErrorKind, Result, Shape, Tensor};

/// Named tensors with text metadata.
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
        self.tensors.get(name).ok_or_else(|| {
            let names: Vec<_> = self.tensors.keys().take(8).collect();
            Error::new(ErrorKind::Input, "the file has no tensor of this name").at(name).found(format!("{names:?}"))
        })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a file that is missing, truncated or not of this format, or holds a dtype that tensors do
    /// not have.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read the tensor file", &e))?;
        Self::from_bytes(&bytes).map_err(|e| e.at(path.display()))
    }

    /// Reads a file that is already in memory.
    ///
    /// # Errors
    /// As [`TensorFile::read`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let bad = |e: safetensors::SafeTensorError| {
            Error::new(ErrorKind::Input, "not a readable safetensors file").found(e).fix("write or copy the file again")
        };
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(bad)?;
        let metadata = header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
        let file = SafeTensors::deserialize(bytes).map_err(bad)?;
        let tensors = file.tensors().into_iter().map(|(name, view)| {
            let shape = Shape::from(view.shape());
            let data = view.data();
            let tensor = match view.dtype() {
                Dtype::F16 => Tensor::from_vec(bytemuck::pod_collect_to_vec::<u8, f16>(data), shape),
                Dtype::F32 => Tensor::from_vec(bytemuck::pod_collect_to_vec::<u8, f32>(data), shape),
                Dtype::F64 => Tensor::from_vec(bytemuck::pod_collect_to_vec::<u8, f64>(data), shape),
                Dtype::U32 => Tensor::from_vec(bytemuck::pod_collect_to_vec::<u8, u32>(data), shape),
                other => {
                    return Err(Error::new(ErrorKind::Unsupported, "a tensor has a dtype that is not read")
                        .at(name)
                        .found(format!("{other:?}"))
                        .wanted("f16, f32, f64 or u32"));
                }
            };
            Ok((name, tensor))
        });
        Ok(Self { tensors: tensors.collect::<Result<_>>()?, metadata })
    }

    /// The file as bytes.
    ///
    /// # Errors
    /// [`ErrorKind::Device`] when a tensor cannot be read back from its GPU; [`ErrorKind::Io`] when the format refuses.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let on_cpu = self.tensors.iter().map(|(name, t)| Ok((name.clone(), OnCpu(t.to_device(&Device::Cpu)?))));
        let on_cpu: BTreeMap<String, OnCpu> = on_cpu.collect::<Result<_>>()?;
        let metadata: HashMap<String, String> = self.metadata.clone().into_iter().collect();
        safetensors::serialize(&on_cpu, Some(metadata))
            .map_err(|e| Error::new(ErrorKind::Io, "cannot write a safetensors file").found(e))
    }
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
        Cow::Borrowed(match self.0.dtype() {
            DType::F16 => bytemuck::cast_slice(self.0.slice::<f16>()),
            DType::F32 => bytemuck::cast_slice(self.0.slice::<f32>()),
            DType::F64 => bytemuck::cast_slice(self.0.slice::<f64>()),
            DType::U32 => bytemuck::cast_slice(self.0.slice::<u32>()),
        })
    }

    fn data_len(&self) -> usize {
        self.0.len() * self.0.dtype().size()
    }
}
