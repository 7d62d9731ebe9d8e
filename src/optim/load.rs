//! Parameters from files and into files.

use std::collections::BTreeSet;
use std::fmt::Write;

use crate::io::{Archive, TensorFile};
use crate::optim::Params;
use crate::optim::params::join;
use crate::optim::state::{RESERVED, is_state};
use crate::{DType, Error, ErrorKind, Result, Shape, Tensor};

/// Where parameters can be loaded from: an open [`Archive`], of which only what is needed is read, or a [`TensorFile`].
///
/// ```
/// use gradreel::io::TensorFile;
/// use gradreel::optim::{Load, Params};
/// use gradreel::{DType, Tensor};
/// let mut saved = Params::new();
/// saved.set("weight", Tensor::full(2.0, [1], DType::F64));
/// let mut file = TensorFile::default();
/// saved.save(&mut file)?;
/// let mut params = Params::new();
/// params.set("weight", Tensor::zeros([1], DType::F64));
/// params.load(&file, &Load::strict())?;
/// assert_eq!(params.get("weight")?.item()?, 2.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
pub trait TensorSource {
    /// Every name.
    fn names(&self) -> Box<dyn Iterator<Item = &str> + '_>;

    /// The shape of a tensor, and whether it is of floats.
    ///
    /// # Errors
    /// When there is no such tensor, or it cannot be read.
    fn describe(&self, name: &str) -> Result<(&Shape, bool)>;

    /// The tensor in this dtype.
    ///
    /// # Errors
    /// As [`TensorSource::describe`], and when the numbers do not fit the dtype.
    fn tensor(&self, name: &str, dtype: DType) -> Result<Tensor>;
}

impl TensorSource for Archive {
    fn names(&self) -> Box<dyn Iterator<Item = &str> + '_> {
        Box::new(Archive::names(self))
    }

    fn describe(&self, name: &str) -> Result<(&Shape, bool)> {
        let entry = self.entry(name)?;
        Ok((&entry.shape, entry.stored.is_float()))
    }

    fn tensor(&self, name: &str, dtype: DType) -> Result<Tensor> {
        self.load_as(name, dtype)
    }
}

impl TensorSource for TensorFile {
    fn names(&self) -> Box<dyn Iterator<Item = &str> + '_> {
        Box::new(self.tensors.keys().map(String::as_str))
    }

    fn describe(&self, name: &str) -> Result<(&Shape, bool)> {
        let tensor = self.get(name)?;
        Ok((tensor.shape(), tensor.dtype() != DType::U32))
    }

    fn tensor(&self, name: &str, dtype: DType) -> Result<Tensor> {
        self.get(name)?.cast(dtype)
    }
}

/// How names in a file are matched with paths. By default both sets must be equal.
///
/// ```
/// use gradreel::io::TensorFile;
/// use gradreel::optim::{Load, Params};
/// use gradreel::{DType, Tensor};
/// let mut saved = Params::new();
/// saved.set("weight", Tensor::full(2.0, [1], DType::F64));
/// let mut file = TensorFile::default();
/// saved.save(&mut file)?;
/// let mut params = Params::new();
/// params.set("net.weight", Tensor::zeros([1], DType::F64));
/// params.load(&file, &Load::strict().into_prefix("net"))?;
/// assert_eq!(params.get("net.weight")?.item()?, 2.0);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Load {
    file_prefix: String,
    prefix: String,
    missing: bool,
    unexpected: bool,
}

impl Load {
    /// Every path has its name in the file, and the other way round.
    ///
    /// ```
    /// use gradreel::optim::Load;
    /// let load = Load::strict();
    /// # let _ = load;
    /// ```
    pub fn strict() -> Self {
        Self::default()
    }

    /// Takes from the file only what is under this prefix, which is removed from the names.
    ///
    /// ```
    /// use gradreel::optim::Load;
    /// let load = Load::strict().from_prefix("model.unet");
    /// # let _ = load;
    /// ```
    #[must_use]
    pub fn from_prefix(mut self, prefix: impl Into<String>) -> Self {
        self.file_prefix = prefix.into();
        self
    }

    /// Loads only the parameters under this prefix; the names in the file are the rest of their paths.
    ///
    /// ```
    /// use gradreel::optim::Load;
    /// let load = Load::strict().into_prefix("unet");
    /// # let _ = load;
    /// ```
    #[must_use]
    pub fn into_prefix(mut self, prefix: impl Into<String>) -> Self {
        self.prefix = prefix.into();
        self
    }

    /// Leaves parameters that the file does not have as they are.
    ///
    /// ```
    /// use gradreel::optim::Load;
    /// let load = Load::strict().allow_missing();
    /// # let _ = load;
    /// ```
    #[must_use]
    pub fn allow_missing(mut self) -> Self {
        self.missing = true;
        self
    }

    /// Ignores what the file has beyond the parameters.
    ///
    /// ```
    /// use gradreel::optim::Load;
    /// let load = Load::strict().allow_unexpected();
    /// # let _ = load;
    /// ```
    #[must_use]
    pub fn allow_unexpected(mut self) -> Self {
        self.unexpected = true;
        self
    }
}

impl Params {
    /// Replaces the parameters by tensors of the same names and shapes from a file. Dtypes and devices stay as they are here:
    /// floats are rounded to the nearest where the file has more digits. Names under `optimizer` and `ema` are states of a
    /// training, not parameters.
    ///
    /// ```
    /// use gradreel::Tensor;
    /// use gradreel::io::TensorFile;
    /// use gradreel::optim::{Load, Params};
    ///
    /// let mut params = Params::new();
    /// params.set("out.weight", Tensor::from_vec(vec![0.0f32; 6], [2, 3]));
    /// params.set("out.bias", Tensor::from_vec(vec![0.0f32; 2], [2]));
    /// let mut file = TensorFile::default();
    /// file.tensors.insert("net.out.weight".into(), Tensor::from_vec(vec![1.0f32; 6], [3, 2]));
    /// let error = params.load(&file, &Load::strict().from_prefix("net")).unwrap_err().to_string();
    /// assert!(error.contains("1 missing: net.out.bias") && error.contains("out.weight [3, 2], not [2, 3]"), "{error}");
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] with the lists of what is missing, unexpected or of another shape or kind; nothing is changed
    /// then. What reading a tensor returns.
    pub fn load(&mut self, source: &dyn TensorSource, how: &Load) -> Result<()> {
        let (mut missing, mut mismatched) = (Vec::new(), Vec::new());
        let mut wanted = BTreeSet::new();
        let mut plan = Vec::new();
        let names: BTreeSet<&str> = source.names().collect();
        for (path, tensor) in self.scope(&*how.prefix).iter() {
            let name = join(&how.file_prefix, path);
            if !names.contains(&*name) {
                missing.push(name);
                continue;
            }
            let (shape, floats) = source.describe(&name)?;
            if shape != tensor.shape() {
                mismatched.push(format!("{name} {shape}, not {}", tensor.shape()));
            } else if floats != (tensor.dtype() != DType::U32) {
                let kind = |floats| if floats { "floats" } else { "integers" };
                mismatched.push(format!("{name} of {}, not {}", kind(floats), kind(!floats)));
            }
            plan.push((join(&how.prefix, path), name.clone(), tensor.dtype(), tensor.device()));
            wanted.insert(name);
        }
        let inside = |name: &str| match name.strip_prefix(&*how.file_prefix) {
            Some(rest) => how.file_prefix.is_empty() || rest.is_empty() || rest.starts_with('.'),
            None => false,
        };
        let beyond = names.iter().filter(|name| inside(name) && !is_state(name) && !wanted.contains(**name));
        let unexpected: Vec<String> = beyond.map(|name| (*name).to_owned()).collect();
        let mut report = String::new();
        list(&mut report, "missing", if how.missing { &[] } else { &missing });
        list(&mut report, "unexpected", if how.unexpected { &[] } else { &unexpected });
        list(&mut report, "of another shape or kind", &mismatched);
        if plan.is_empty() && report.is_empty() {
            report = "nothing in common".to_owned();
        }
        if !report.is_empty() {
            return Err(Error::new(ErrorKind::Input, "the file does not fit the parameters")
                .found(report)
                .fix("choose another file or prefix, or allow missing or unexpected names"));
        }
        let load = |(path, name, dtype, device): (String, String, DType, crate::Device)| {
            Ok((path, source.tensor(&name, dtype)?.to_device(&device)?))
        };
        let loaded: Vec<(String, Tensor)> = plan.into_iter().map(load).collect::<Result<_>>()?;
        loaded.into_iter().for_each(|(path, tensor)| self.set(path, tensor));
        Ok(())
    }

    /// Adds all parameters to a file, under their paths.
    ///
    /// ```
    /// use gradreel::io::TensorFile;
    /// use gradreel::optim::{Load, Params};
    /// use gradreel::{DType, Tensor};
    /// let mut saved = Params::new();
    /// saved.set("weight", Tensor::full(2.0, [1], DType::F64));
    /// let mut file = TensorFile::default();
    /// saved.save(&mut file)?;
    /// assert_eq!(file.get("weight")?.item()?, 2.0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a path under `optimizer` or `ema`, which are the names of a training's states.
    pub fn save(&self, file: &mut TensorFile) -> Result<()> {
        if let Some((path, _)) = self.iter().find(|(path, _)| is_state(path)) {
            return Err(Error::new(ErrorKind::Input, "a parameter has the name of a training's state")
                .at(path)
                .wanted(format!("a path that does not begin with one of {RESERVED:?}")));
        }
        file.tensors.extend(self.iter().map(|(path, value)| (path.to_owned(), value.clone())));
        Ok(())
    }
}

/// `3 missing: a, b, c`, of which ten are named.
fn list(report: &mut String, what: &str, names: &[String]) {
    if names.is_empty() {
        return;
    }
    let separator = if report.is_empty() { "" } else { "; " };
    let more = if names.len() > 10 { ", …" } else { "" };
    let first = names[..names.len().min(10)].join(", ");
    write!(report, "{separator}{} {what}: {first}{more}", names.len()).expect("a String takes all");
}
