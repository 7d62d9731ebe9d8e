//! Weights in a file: looked up by path and loaded on first use.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use gradreel::io::Archive;
use gradreel::{Device, Error, ErrorKind, Result, Shape, Tape, Tensor, Var};

use super::{ModelSizes, UNUSED};
use crate::layers::{Init, Weights};

/// The weights of a safetensors file or a PyTorch checkpoint, as constants.
///
/// A weight is read when a layer first requests it, in its stored type, and is cached. With a mapped file
/// ([`FileWeights::open_mapped`]) a CPU weight *is* the file's memory: nothing is read before a layer uses it, and
/// the system may evict its pages. Layers cast weights to the type they compute in. Only `bf16` and non-contiguous
/// weights are converted to `f32` in memory. On a GPU each weight is uploaded once, on first request.
///
/// Names are those of the published checkpoint. Those of its single-view parent model, whose image encoder is under
/// `cond_stage_model`, are recognised, too.
#[derive(Clone)]
pub struct FileWeights {
    file: Arc<File>,
    tape: Tape,
}

/// The file itself, which threads may share; each thread looks weights up for its own tape.
pub(super) struct File {
    path: PathBuf,
    archive: Archive,
    device: Device,
    /// Uploaded or read weights, by name in the file.
    kept: Mutex<BTreeMap<String, Tensor>>,
}

/// Prefixes of the published checkpoint and their equivalents in related checkpoints.
const ELSEWHERE: &[[&str; 2]] = &[["clip_image_encoder.model.", "cond_stage_model.model."]];

/// Prefix of averaged weights in related checkpoints.
const AVERAGES: &str = "model_ema.";

impl FileWeights {
    /// Opens a safetensors file or a PyTorch checkpoint (its `state_dict`, if it has one) and lists its weights;
    /// [`FileWeights::BUILT_IN`] opens those shipped with the crate.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if the file is missing, damaged or of another format.
    pub fn open(path: impl AsRef<Path>, device: &Device) -> Result<Self> {
        let path = path.as_ref();
        let archive = match path == Self::BUILT_IN {
            true => Archive::from_bytes(Self::built_in()?.to_vec())?,
            false => Archive::open(path)?,
        };
        Ok(Self::of_archive(path, archive, device))
    }

    /// Like [`FileWeights::open`], with the file mapped: a model larger than the memory can run, and unused weights
    /// are never read.
    ///
    /// # Safety
    /// As [`Archive::open_mapped`]: the file must not be changed or truncated while these weights, or anything
    /// built from them, exist.
    ///
    /// # Errors
    /// As [`FileWeights::open`].
    pub unsafe fn open_mapped(path: impl AsRef<Path>, device: &Device) -> Result<Self> {
        let path = path.as_ref();
        // SAFETY: the caller's promise.
        let archive = unsafe { Archive::open_mapped(path) }?;
        Ok(Self::of_archive(path, archive, device))
    }

    fn of_archive(path: &Path, archive: Archive, device: &Device) -> Self {
        let file = File { path: path.to_owned(), archive, device: device.clone(), kept: Mutex::default() };
        Self { file: Arc::new(file), tape: Tape::new() }
    }

    /// Placeholder path of the small model shipped with the crate ([`ModelSizes::small`]).
    pub const BUILT_IN: &str = "built-in";

    /// The file of that model: safetensors in `f16`.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] in a build without the feature `built-in-weights`.
    #[cfg(feature = "built-in-weights")]
    pub fn built_in() -> Result<&'static [u8]> {
        // a static, so that the bytes are embedded only once
        static BYTES: &[u8] = include_bytes!("../../weights/novel_view.safetensors");
        Ok(BYTES)
    }

    /// The file of that model: safetensors in `f16`.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] in a build without the feature `built-in-weights`.
    #[cfg(not(feature = "built-in-weights"))]
    pub fn built_in() -> Result<&'static [u8]> {
        Err(Error::new(ErrorKind::Input, "this build comes without the small multi-view model")
            .at(Self::BUILT_IN)
            .found("no feature `built-in-weights`")
            .wanted("a file of weights")
            .fix("give a file, such as models/weights/novel_view.safetensors of the sources: --weights FILE, --imagine=FILE; or build with the \
                  feature `built-in-weights`"))
    }

    /// The same weights as constants of another tape, for layers whose other weights are trained on it.
    #[must_use]
    pub fn on(&self, tape: &Tape) -> Self {
        Self::of(&self.file, tape)
    }

    pub(super) fn of(file: &Arc<File>, tape: &Tape) -> Self {
        Self { file: file.clone(), tape: tape.clone() }
    }

    pub(super) fn file(&self) -> &Arc<File> {
        &self.file
    }

    /// The file's names, types and metadata.
    pub fn archive(&self) -> &Archive {
        &self.file.archive
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    /// Device of the weights.
    pub fn device(&self) -> &Device {
        &self.file.device
    }

    /// Model sizes stored in the file ([`ModelSizes::METADATA`]), or the published ones.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] if the stored sizes are invalid.
    pub fn sizes(&self) -> Result<ModelSizes> {
        match self.file.archive.metadata().get(ModelSizes::METADATA) {
            Some(text) => ModelSizes::from_json(text).map_err(|e| e.within(self.file.path.display())),
            None => Ok(ModelSizes::published()),
        }
    }

    /// Compares the file with the weights that a model requires ([`super::ModelSizes::weights`]).
    pub fn check(&self, wanted: &[(String, Shape)]) -> Report {
        let mut left: BTreeSet<&str> = self.file.archive.names().collect();
        let mut report = Report { path: self.file.path.clone(), wanted: wanted.len(), ..Report::default() };
        for (path, shape) in wanted {
            let Some(name) = self.file.name(path) else {
                report.missing.push(path.clone());
                continue;
            };
            left.remove(&*name);
            match self.file.archive.entry(&name) {
                Err(error) => report.unreadable.push((name, error.to_string())),
                Ok(entry) if !entry.stored.is_float() => {
                    report.unreadable.push((name, format!("it holds {}, not floats", entry.stored)));
                }
                Ok(entry) if entry.shape != *shape => {
                    report.misshaped.push((name, entry.shape.clone(), shape.clone()));
                }
                Ok(_) => {}
            }
        }
        let of_no_use = |name: &&str| {
            let published = ELSEWHERE.iter().find_map(|[here, there]| Some((here, name.strip_prefix(there)?)));
            let published = published.map_or((*name).to_owned(), |(here, rest)| format!("{here}{rest}"));
            UNUSED.contains(&&*published) || name.starts_with(AVERAGES)
        };
        let (unused, unexpected): (Vec<&str>, Vec<&str>) = left.into_iter().partition(of_no_use);
        report.unused = unused.into_iter().map(str::to_owned).collect();
        report.unexpected = unexpected.into_iter().map(str::to_owned).collect();
        report
    }

    /// A weight as it is stored.
    ///
    /// # Errors
    /// As [`Weights::weight`].
    pub fn tensor(&self, path: &str, shape: &Shape) -> Result<Tensor> {
        let file = &*self.file;
        let found = self.find(path, shape);
        found.map_err(|e| e.within(file.path.display()))
    }

    fn find(&self, path: &str, shape: &Shape) -> Result<Tensor> {
        let file = &*self.file;
        let name = file.name(path).unwrap_or_else(|| path.to_owned());
        if let Some(kept) = file.kept().get(&name) {
            return Ok(kept.clone());
        }
        let entry = file.archive.entry(&name)?;
        if entry.shape != *shape {
            return Err(Error::new(ErrorKind::Shape, "a weight has another shape than its layer")
                .at(name)
                .found(&entry.shape)
                .wanted(shape)
                .fix("choose the checkpoint that belongs to this configuration"));
        }
        if !entry.stored.is_float() {
            return Err(Error::new(ErrorKind::Input, "a weight is not of floats").at(name).found(entry.stored));
        }
        let stored = entry.stored;
        let weight = file.archive.map(&name)?;
        let weight = match file.device {
            Device::Cpu => weight,
            // GPUs do not support f64
            Device::Gpu(_) if weight.dtype() == gradreel::DType::F64 => weight.cast(gradreel::DType::F32)?,
            Device::Gpu(_) => weight,
        };
        let weight = weight.to_device(&file.device)?;
        if file.device != Device::Cpu || stored == gradreel::io::Stored::Bf16 || !file.archive.is_held() {
            file.kept().insert(name, weight.clone());
        }
        Ok(weight)
    }
}

impl File {
    /// Device of the weights.
    pub fn device(&self) -> &Device {
        &self.device
    }

    fn kept(&self) -> MutexGuard<'_, BTreeMap<String, Tensor>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Name in the file of the weight at a path.
    fn name(&self, path: &str) -> Option<String> {
        let has = |name: &str| self.archive.has(name);
        if has(path) {
            return Some(path.to_owned());
        }
        let elsewhere = |[here, there]: &[&str; 2]| Some(format!("{there}{}", path.strip_prefix(here)?));
        ELSEWHERE.iter().find_map(elsewhere).filter(|name| has(name))
    }
}

impl Weights for FileWeights {
    fn weight(&self, path: &str, shape: &Shape, _: Init) -> Result<Var> {
        Ok(self.tape.constant(self.tensor(path, shape)?))
    }
}

impl fmt::Debug for FileWeights {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({:?}) on {}", self.file.path.display(), self.file.archive, self.file.device)
    }
}

/// Differences between a weights file and a model's requirements. `Display` prints the whole list.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// The file.
    pub path: PathBuf,
    /// Number of weights that the model requires.
    pub wanted: usize,
    /// Paths missing in the file.
    pub missing: Vec<String>,
    /// Names in the file that the model does not recognise.
    pub unexpected: Vec<String>,
    /// Name, shape in the file, shape in the model.
    pub misshaped: Vec<(String, Shape, Shape)>,
    /// Name, and reason why it cannot be read.
    pub unreadable: Vec<(String, String)>,
    /// Recognised names that the model does not use.
    pub unused: Vec<String>,
}

impl Report {
    /// Whether the model can be loaded: everything it requires is present. Unrecognised names are harmless.
    pub fn is_complete(&self) -> bool {
        self.missing.is_empty() && self.misshaped.is_empty() && self.unreadable.is_empty()
    }

    /// Whether there are no differences.
    pub fn is_exact(&self) -> bool {
        self.is_complete() && self.unexpected.is_empty()
    }

    /// Converts to an error with the whole list, unless the model can be loaded.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] with the whole list.
    pub fn into_result(self) -> Result<()> {
        if self.is_complete() {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "the file does not hold the weights of this model")
            .at(self.path.display())
            .found(&self)
            .wanted(format!("the {} weights of the model", self.wanted))
            .fix("choose the checkpoint that belongs to this model; `gradreel weights check` lists what a file has"))
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bad = self.missing.len() + self.misshaped.len() + self.unreadable.len();
        writeln!(f, "{} of {} weights fit, {} more are of no use", self.wanted - bad, self.wanted, self.unused.len())?;
        let mut list = |what: &str, rows: &[String]| {
            if rows.is_empty() {
                return Ok(());
            }
            writeln!(f, "{} {what}:", rows.len())?;
            rows.iter().try_for_each(|row| writeln!(f, "    {row}"))
        };
        list("missing", &self.missing)?;
        list("unexpected", &self.unexpected)?;
        let shapes = self.misshaped.iter().map(|(name, found, wanted)| format!("{name}: {found}, not {wanted}"));
        list("of another shape", &shapes.collect::<Vec<_>>())?;
        let reasons = self.unreadable.iter().map(|(name, why)| format!("{name}: {why}"));
        list("that cannot be read", &reasons.collect::<Vec<_>>())
    }
}
