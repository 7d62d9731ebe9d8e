//! A file of tensors written again as safetensors, one tensor in memory at a time.

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::path::Path;

use half::{bf16, f16};
use rayon::prelude::*;
use safetensors::tensor::{Dtype, View};

use crate::io::archive::Entry;
use crate::io::bytes::write_whole;
use crate::io::safetensors::{raw_bytes, refused};
use crate::io::{Archive, Stored};
use crate::{DType, Error, ErrorKind, Result, Tensor};

impl Archive {
    /// Writes all tensors into a safetensors file, under the same names and with the same metadata. `stored` says in which
    /// type: the one a tensor has, which keeps its bytes, or another type of floats, to which it is rounded. `progress` is told
    /// the bytes written so far and those of the whole file.
    ///
    /// One tensor at a time is in memory. Whoever opens `path`, even after a crash, finds the old content or the new.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, Stored, TensorFile};
    ///
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("w".into(), Tensor::from_vec(vec![1.0f32, -0.1], [2]));
    /// let path = std::env::temp_dir().join("gradreel-rewrite.safetensors");
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// archive.rewrite(&path, |_, _| Stored::F16, |_, _| ())?;
    /// let halves = Archive::open(&path)?;
    /// assert_eq!(halves.entry("w")?.stored, Stored::F16);
    /// assert!((halves.load("w")?.to_vec()?[1] + 0.1).abs() < 1e-4);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for an entry that is no tensor, and for a finite number that the wanted type does not hold;
    /// [`ErrorKind::Unsupported`] for integers in another type; [`ErrorKind::Io`] when writing fails.
    pub fn rewrite(
        &self,
        path: impl AsRef<Path>,
        stored: impl Fn(&str, &Entry) -> Stored,
        progress: impl Fn(usize, usize),
    ) -> Result<()> {
        let path = path.as_ref();
        let mut plan = Vec::new();
        for name in self.names() {
            let entry = self.entry(name)?;
            let stored = stored(name, entry);
            if stored != entry.stored && !(stored.is_float() && entry.stored.is_float()) {
                return Err(Error::new(ErrorKind::Unsupported, "only floats become other floats")
                    .at(name)
                    .found(format!("{} to {stored}", entry.stored)));
            }
            plan.push((name, entry, stored));
        }
        let total = plan.iter().map(|(_, entry, stored)| entry.shape.len() * stored.size()).sum();
        let written = Cell::new(0);
        let say = |bytes: usize| {
            written.set(written.get() + bytes);
            progress(written.get(), total);
        };
        let fault = RefCell::new(None);
        let views = plan.into_iter().map(|(name, entry, stored)| {
            (name, OnDemand { archive: self, name, entry, stored, fault: &fault, say: &say })
        });
        let metadata = self.metadata().clone().into_iter().collect();
        write_whole(path, |partial| {
            let done = safetensors::serialize_to_file(views, Some(metadata), partial).map_err(|e| match e {
                safetensors::SafeTensorError::IoError(e) => Error::io(path, "write the tensor file", &e),
                other => refused(other).at(path.display()),
            });
            fault.take().map_or(done, Err)
        })
    }

    /// The bytes of an entry in a type of floats.
    fn bytes_as(&self, name: &str, entry: &Entry, stored: Stored) -> Result<Cow<'_, [u8]>> {
        if stored == entry.stored {
            return entry.numbers(&self.source);
        }
        let read = self.load(name)?;
        let written = match stored {
            Stored::F16 => owned(&read.cast(DType::F16)?),
            Stored::F32 => owned(&read.cast(DType::F32)?),
            Stored::F64 => owned(&read.cast(DType::F64)?),
            _ => brain_floats(&read),
        };
        let infinite = |bytes: &[u8]| match stored {
            Stored::F16 => bytes.par_chunks(2).any(|b| f16::from_le_bytes([b[0], b[1]]).is_infinite()),
            Stored::Bf16 => bytes.par_chunks(2).any(|b| bf16::from_le_bytes([b[0], b[1]]).is_infinite()),
            Stored::F32 => bytes.par_chunks(4).any(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]).is_infinite()),
            _ => false,
        };
        if infinite(&written) && read.all_finite()? {
            let largest = read.to_vec()?.into_iter().fold(0.0f64, |m, x| m.max(x.abs()));
            return Err(Error::new(ErrorKind::Input, "a number is beyond the type it is to be stored in")
                .at(name)
                .found(format!("{largest:e}"))
                .wanted(format!("numbers that {stored} holds"))
                .fix("store it in f32, or in bf16, which has the range of f32 and fewer digits"));
        }
        Ok(Cow::Owned(written))
    }
}

fn owned(tensor: &Tensor) -> Vec<u8> {
    raw_bytes(tensor).to_vec()
}

fn brain_floats(tensor: &Tensor) -> Vec<u8> {
    let each = |x: bf16| x.to_le_bytes();
    let values: Vec<[u8; 2]> = match tensor.dtype() {
        DType::F64 => tensor.slice::<f64>().par_iter().map(|x| each(bf16::from_f64(*x))).collect(),
        DType::F16 => tensor.slice::<f16>().par_iter().map(|x| each(bf16::from_f32(x.to_f32()))).collect(),
        _ => tensor.slice::<f32>().par_iter().map(|x| each(bf16::from_f32(*x))).collect(),
    };
    bytemuck::cast_vec(values)
}

/// A tensor that is read, converted and dropped again when its turn to be written comes.
struct OnDemand<'a> {
    archive: &'a Archive,
    name: &'a str,
    entry: &'a Entry,
    stored: Stored,
    fault: &'a RefCell<Option<Error>>,
    say: &'a dyn Fn(usize),
}

impl View for OnDemand<'_> {
    fn dtype(&self) -> Dtype {
        match self.stored {
            Stored::Bool => Dtype::BOOL,
            Stored::U8 => Dtype::U8,
            Stored::I8 => Dtype::I8,
            Stored::U16 => Dtype::U16,
            Stored::I16 => Dtype::I16,
            Stored::U32 => Dtype::U32,
            Stored::I32 => Dtype::I32,
            Stored::U64 => Dtype::U64,
            Stored::I64 => Dtype::I64,
            Stored::F16 => Dtype::F16,
            Stored::Bf16 => Dtype::BF16,
            Stored::F32 => Dtype::F32,
            Stored::F64 => Dtype::F64,
        }
    }

    fn shape(&self) -> &[usize] {
        self.entry.shape.dims()
    }

    fn data(&self) -> Cow<'_, [u8]> {
        (self.say)(self.data_len());
        let failed = self.fault.borrow().is_some();
        let bytes = match failed {
            true => None,
            false => {
                self.archive.bytes_as(self.name, self.entry, self.stored).map_err(|e| self.fault.replace(Some(e))).ok()
            }
        };
        // after a fault the file is thrown away; until then its lengths must be right
        bytes.unwrap_or_else(|| Cow::Owned(vec![0; self.data_len()]))
    }

    fn data_len(&self) -> usize {
        self.entry.shape.len() * self.stored.size()
    }
}
