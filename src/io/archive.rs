//! Named tensors of a file, listed without being read.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use crate::io::element::{Stored, decode, decode_as, gather, is_dense, negate};
use crate::io::foreign::refuse_foreign;
use crate::io::source::Source;
use crate::io::{TensorFile, checkpoint, npz, safetensors, zip};
use crate::{DType, Error, ErrorKind, Result, Shape, Spec, Tensor};

/// What an [`Archive`] was read from.
///
/// ```
/// use gradreel::Tensor;
/// use gradreel::io::{Archive, Format, TensorFile};
/// let mut file = TensorFile::default();
/// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0], [1]));
/// let archive = Archive::from_bytes(file.to_bytes()?)?;
/// assert_eq!(archive.format(), Format::Safetensors);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// safetensors.
    Safetensors,
    /// PyTorch's container since 1.6: a ZIP archive around a pickle.
    TorchZip,
    /// PyTorch's container before 1.6: a sequence of pickles and raw storages.
    TorchLegacy,
    /// NumPy's archive of uncompressed arrays.
    Npz,
}

/// A tensor in a file: its type, its shape, and where its numbers are.
///
/// ```
/// use gradreel::Tensor;
/// use gradreel::io::{Archive, TensorFile};
/// let mut file = TensorFile::default();
/// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
/// let archive = Archive::from_bytes(file.to_bytes()?)?;
/// assert_eq!(archive.entry("slope")?.shape.dims(), [2]);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The type in the file; [`Stored::dtype`] says what it becomes.
    pub stored: Stored,
    /// Sizes per axis.
    pub shape: Shape,
    /// Elements between neighbours, per axis.
    pub(super) strides: Vec<usize>,
    /// First element, counted from the start of the storage.
    pub(super) offset: usize,
    /// The bytes of the storage in the file.
    pub(super) storage: Range<usize>,
    /// Whether the bytes of an element are in the order of a big-endian machine.
    pub(super) big_endian: bool,
    /// Whether the tensor is the negative of what is stored.
    pub(super) negative: bool,
}

impl Entry {
    /// A view of a storage that lies whole in the file, checked: the shape can be held in memory, every element lies within
    /// the storage, and the elements are not many more than the storage has (a stride of 0 repeats them).
    pub(super) fn new(
        stored: Stored,
        dims: Vec<usize>,
        strides: Vec<usize>,
        offset: usize,
        storage: Range<usize>,
    ) -> Result<Self> {
        let held = storage.len() / stored.size();
        let refuse = |what: &str, wanted: String| {
            Error::new(ErrorKind::Input, what)
                .found(format!("shape {dims:?}, strides {strides:?}, offset {offset} in {held} elements"))
                .wanted(wanted)
                .fix("copy or download the file again, or save it again without that tensor")
        };
        if dims.len() > LARGEST_RANK {
            return Err(Error::new(ErrorKind::Input, "a tensor has too many axes")
                .found(dims.len())
                .wanted(format!("at most {LARGEST_RANK}")));
        }
        // axes of size 0 count as 1 here, so that strides of an empty shape do not overflow either
        let bytes = dims.iter().try_fold(8usize, |n, d| n.checked_mul((*d).max(1)));
        if bytes.is_none_or(|n| isize::try_from(n).is_err()) {
            return Err(refuse("the shape of a tensor is beyond memory", "a product that fits 63 bits".to_owned()));
        }
        let count: usize = dims.iter().product();
        let last = dims
            .iter()
            .zip(&strides)
            .try_fold(offset, |last, (d, s)| last.checked_add((d.max(&1) - 1).checked_mul(*s)?));
        if count > 0 && last.is_none_or(|last| last >= held) {
            return Err(refuse("a tensor reaches beyond its storage", format!("a last element below {held}")));
        }
        // an element takes up to eight bytes once it is read
        if count.saturating_mul(8) > LARGEST_REPEAT.saturating_mul(storage.len()).saturating_add(1 << 19) {
            let wanted = format!("at most {LARGEST_REPEAT} times the bytes of the storage");
            return Err(refuse("a tensor repeats its storage too often", wanted));
        }
        let shape = Shape::from(dims);
        Ok(Self { stored, shape, strides, offset, storage, big_endian: false, negative: false })
    }

    /// A tensor whose numbers lie one behind the other.
    pub(super) fn contiguous(stored: Stored, dims: Vec<usize>, storage: Range<usize>) -> Result<Self> {
        let mut strides = vec![1usize; dims.len()];
        for axis in (1..dims.len()).rev() {
            strides[axis - 1] = strides[axis].saturating_mul(dims[axis]);
        }
        Self::new(stored, dims, strides, 0, storage)
    }

    /// The bytes of the elements, little-endian and in row-major order; borrowed where the file is in memory and has them so.
    pub(super) fn numbers<'f>(&self, file: &'f Source) -> Result<Cow<'f, [u8]>> {
        if self.shape.is_empty() {
            return Ok(Cow::Borrowed(&[]));
        }
        let size = self.stored.size();
        // the view alone: many views of one large storage are many small parts of the file
        let reach: usize = self.shape.dims().iter().zip(&self.strides).map(|(d, s)| (d - 1) * s).sum();
        let start = self.storage.start + self.offset * size;
        let mut bytes = match file.read(start..start + (reach + 1) * size)? {
            Cow::Borrowed(part) => gather(part, size, &self.shape, &self.strides, 0),
            Cow::Owned(part) if is_dense(&self.shape, &self.strides) => Cow::Owned(part),
            Cow::Owned(part) => Cow::Owned(gather(&part, size, &self.shape, &self.strides, 0).into_owned()),
        };
        if self.big_endian {
            bytes.to_mut().chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        if self.negative {
            negate(self.stored, bytes.to_mut());
        }
        Ok(bytes)
    }

    /// Where the bytes of the elements lie in the file, if they lie there one behind the other in the order and the type of
    /// the tensor that they become.
    fn place(&self) -> Option<Range<usize>> {
        let same = matches!(self.stored, Stored::F16 | Stored::F32 | Stored::F64);
        let usable = same && !self.big_endian && !self.negative && is_dense(&self.shape, &self.strides);
        let start = self.storage.start + self.offset * self.stored.size();
        usable.then(|| start..start + self.shape.len() * self.stored.size())
    }

    /// Bytes of the tensor once it is read (twice that for integers that become `f64`).
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// assert_eq!(archive.entry("slope")?.bytes(), 8);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn bytes(&self) -> usize {
        self.shape.len() * self.stored.dtype().size()
    }
}

/// NumPy and PyTorch have no tensors of more axes.
const LARGEST_RANK: usize = 64;
/// How many times as many bytes as its storage a tensor may have, with eight bytes an element.
const LARGEST_REPEAT: usize = 64;

/// The tensors of a safetensors file, a PyTorch checkpoint or an `.npz`, listed without being read.
///
/// Names are dotted paths; of a PyTorch checkpoint they are those of its `state_dict` where it has one. A tensor is read from
/// the file when it is asked for, so that a part of a file of many gigabytes needs the memory of that part. Nothing in a file
/// is ever executed: see [`checkpoint`].
///
/// ```
/// use gradreel::Tensor;
/// use gradreel::io::{Archive, TensorFile};
///
/// let mut file = TensorFile::default();
/// file.tensors.insert("line.slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
/// let archive = Archive::from_bytes(file.to_bytes()?)?;
/// assert_eq!(archive.entry("line.slope")?.shape.dims(), [2]);
/// assert_eq!(archive.load("line.slope")?.slice::<f32>(), [1.0, 2.0]);
/// # Ok::<(), gradreel::Error>(())
/// ```
pub struct Archive {
    pub(super) source: Source,
    format: Format,
    contents: Contents,
}

/// What a reader found: tensors, or why one of them cannot be read, and text.
#[derive(Default)]
pub(super) struct Contents {
    pub entries: BTreeMap<String, Result<Entry>>,
    pub metadata: BTreeMap<String, String>,
}

impl Archive {
    /// Opens a file and lists its tensors; the format is told from the content.
    ///
    /// A file up to 64 MiB is read at once. Of a larger one a tensor is read when it is asked for; when the file is changed
    /// meanwhile (not replaced by a rename, as [`TensorFile::write`] does), what is read is an error or other numbers.
    ///
    /// ```
    /// use gradreel::io::Archive;
    /// let error = Archive::open("no-such-file.safetensors").err().expect("there is none");
    /// assert!(error.to_string().contains("no-such-file"));
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a file that is missing, damaged or of another format, with what was found where, and for what
    /// is no regular file, such as a folder, a pipe or a device.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_at(path, &[])
    }

    /// As [`Archive::open`]; of a PyTorch checkpoint, the tensors of a nested dictionary or list, such as
    /// `["optimizer_states", "0", "state"]`. Without keys, that is `["state_dict"]` where there is one, else everything.
    ///
    /// ```
    /// use gradreel::io::Archive;
    /// let state = Archive::open_at("no-such-file.ckpt", &["optimizer_states", "0", "state"]);
    /// assert!(state.is_err());
    /// ```
    ///
    /// # Errors
    /// As [`Archive::open`], and for a key that is not there, or keys for a file of another format.
    pub fn open_at(path: impl AsRef<Path>, keys: &[&str]) -> Result<Self> {
        let path = path.as_ref();
        Self::parse(Source::open(path)?, keys).map_err(|e| e.within(path.display()))
    }

    /// As [`Archive::open`], with the file mapped, so that [`Archive::map`] copies nothing and a model may be larger than the
    /// memory.
    ///
    /// ```
    /// use gradreel::io::Archive;
    /// // SAFETY: there is no such file, so that nobody changes it
    /// assert!(unsafe { Archive::open_mapped("no-such-file.safetensors") }.is_err());
    /// ```
    ///
    /// # Safety
    /// Nobody, in this process or another, changes or shortens the file while the archive, or a tensor that
    /// [`Archive::map`] gave, lives. Replacing it by a rename is allowed.
    ///
    /// # Errors
    /// As [`Archive::open`].
    pub unsafe fn open_mapped(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        // SAFETY: the caller's promise.
        let source = unsafe { Source::map(path) }?;
        Self::parse(source, &[]).map_err(|e| e.within(path.display()))
    }

    /// Lists the tensors of a file that is already in memory.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// assert!(archive.has("slope"));
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Archive::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self> {
        Self::parse(bytes.into(), &[])
    }

    fn parse(source: Source, keys: &[&str]) -> Result<Self> {
        let nested_only_in_checkpoints = || match keys {
            [] => Ok(()),
            _ => Err(Error::new(ErrorKind::Input, "only a PyTorch checkpoint has nested dictionaries")
                .found(format!("the keys {keys:?} for another format"))),
        };
        refuse_foreign(&source, "safetensors, a PyTorch checkpoint or an .npz")?;
        let start = source.head(checkpoint::LONGEST_START)?;
        let (format, contents) = match &start[..] {
            [b'P', b'K', 3 | 5, 4 | 6, ..] => {
                let directory = zip::directory(&source)?;
                match checkpoint::in_zip(&source, &directory, keys)? {
                    Some(contents) => (Format::TorchZip, contents),
                    None => (Format::Npz, nested_only_in_checkpoints().and_then(|()| npz::list(&source, directory))?),
                }
            }
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => {
                return Err(Error::new(ErrorKind::Input, "an .npy file holds one array without a name")
                    .fix("save it with numpy.savez under a name; in a program, gradreel::io::npy::read reads it"));
            }
            start if checkpoint::is_stream(start) => (Format::TorchLegacy, checkpoint::in_stream(&source, keys)?),
            _ => (Format::Safetensors, nested_only_in_checkpoints().and_then(|()| safetensors::list(&source))?),
        };
        drop(start);
        Ok(Self { source, format, contents })
    }

    /// What the file is.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// println!("{:?}", archive.format());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn format(&self) -> Format {
        self.format
    }

    /// Every name, in order, including those of entries that cannot be read.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// assert_eq!(archive.names().collect::<Vec<_>>(), ["slope"]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.contents.entries.keys().map(String::as_str)
    }

    /// Whether there is an entry of this name, readable or not.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// assert!(!archive.has("offset"));
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn has(&self, name: &str) -> bool {
        self.contents.entries.contains_key(name)
    }

    /// Text and constants by name: the metadata of safetensors; of a PyTorch checkpoint the numbers and texts beside the
    /// tensors, such as `epoch` and `global_step`.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// assert!(archive.metadata().is_empty());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.contents.metadata
    }

    /// Type and shape of a tensor.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// assert_eq!(archive.entry("slope")?.shape.len(), 2);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when there is none of this name or what is there is no tensor; [`ErrorKind::Unsupported`] when
    /// its type is not read.
    pub fn entry(&self, name: &str) -> Result<&Entry> {
        match self.contents.entries.get(name) {
            Some(Ok(entry)) => Ok(entry),
            Some(Err(error)) => Err(error.clone()),
            None => Err(unknown(name, self.names())),
        }
    }

    /// Reads a tensor, as [`Stored::dtype`].
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// assert_eq!(archive.load("slope")?.slice::<f32>(), [1.0, 2.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Archive::entry`]; [`ErrorKind::Unsupported`] for an integer that neither `u32` nor `f64` holds.
    pub fn load(&self, name: &str) -> Result<Tensor> {
        let entry = self.entry(name)?;
        decode(entry.stored, &entry.numbers(&self.source)?, entry.shape.clone()).map_err(|e| e.at(name))
    }

    /// A tensor as [`Archive::load`] reads it, but where the file is in memory or mapped ([`Archive::open_mapped`]) and has its
    /// numbers as memory would (floats other than `bf16`, contiguous, at a multiple of their size), it *is* a part of the file:
    /// nothing is copied. Pages of a mapped file are read when they are first used, and the system may drop them again. The
    /// tensor keeps the file after the archive is gone.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    ///
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// let slope = archive.map("slope")?;
    /// drop(archive);
    /// assert_eq!(slope.slice::<f32>(), [1.0, 2.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Archive::load`].
    pub fn map(&self, name: &str) -> Result<Tensor> {
        let entry = self.entry(name)?;
        let spec = Spec::new(&entry.shape, entry.stored.dtype());
        let held = match &self.source {
            Source::Held(bytes) => Some(bytes),
            Source::Disk { .. } => None,
        };
        let mapped = held.zip(entry.place()).and_then(|(bytes, place)| Tensor::in_file(bytes, place, spec));
        mapped.map_or_else(|| self.load(name), Ok)
    }

    /// Whether the file is in memory or mapped, so that [`Archive::map`] need not copy.
    ///
    /// ```
    /// use gradreel::io::{Archive, TensorFile};
    /// let archive = Archive::from_bytes(TensorFile::default().to_bytes()?)?;
    /// assert!(archive.is_held());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn is_held(&self) -> bool {
        matches!(self.source, Source::Held(_))
    }

    /// Reads a tensor in another dtype: floats are rounded to the nearest, integers must be held exactly.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// assert_eq!(archive.load_as("slope", gradreel::DType::F64)?.slice::<f64>(), [1.0, 2.0]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Archive::load`]; [`ErrorKind::Unsupported`] for floats as `u32`.
    pub fn load_as(&self, name: &str, dtype: DType) -> Result<Tensor> {
        let entry = self.entry(name)?;
        decode_as(entry.stored, &entry.numbers(&self.source)?, entry.shape.clone(), dtype).map_err(|e| e.at(name))
    }

    /// Reads everything.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::{Archive, TensorFile};
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("slope".into(), Tensor::from_vec(vec![1.0f32, 2.0], [2]));
    /// let archive = Archive::from_bytes(file.to_bytes()?)?;
    /// assert_eq!(archive.load_all()?.tensors.len(), 1);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Archive::load`] of the first entry that cannot be read; [`ErrorKind::Input`] when entries that share storages
    /// would together be much larger than the file.
    pub fn load_all(&self) -> Result<TensorFile> {
        let mut total = 0usize;
        for name in self.names() {
            total = total.saturating_add(self.entry(name)?.bytes());
        }
        if total > self.source.len().saturating_mul(LARGEST_REPEAT).saturating_add(1 << 20) {
            return Err(Error::new(ErrorKind::Input, "the tensors of the file are too large together")
                .found(format!("{total} bytes in a file of {}", self.source.len()))
                .fix("load the tensors that are needed one by one"));
        }
        let tensors = self.names().map(|name| Ok((name.to_owned(), self.load(name)?)));
        Ok(TensorFile { tensors: tensors.collect::<Result<_>>()?, metadata: self.contents.metadata.clone() })
    }
}

impl std::fmt::Debug for Archive {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?} of {} entries", self.format, self.contents.entries.len())
    }
}

/// The error for a name that a file does not have.
pub(super) fn unknown<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Error {
    let known: Vec<_> = known.take(8).collect();
    Error::new(ErrorKind::Input, "the file has no tensor of this name").at(name).found(format!("{known:?}"))
}
