//! Parameters by dotted path: stored, viewed, frozen and cast by prefix.

use std::collections::BTreeMap;

use crate::optim::prefix::{ByPrefix, check_prefix, under};
use crate::{DType, Error, ErrorKind, Result, Tensor};

/// Tensors by dotted path, in the order of their paths.
///
/// A *prefix* of a path ends where one of its components ends: `line` and `line.slope` are prefixes of `line.slope`, and
/// `line.s` is not. The empty prefix is one of every path.
///
/// ```
/// use gradreel::optim::{Adam, Params};
/// use gradreel::{Tape, Tensor};
///
/// let mut params = Params::new();
/// params.set("line.slope", Tensor::from_vec(vec![0.0f32], [1]));
/// let mut adam = Adam::new(0.1);
/// for _ in 0..200 {
///     let tape = Tape::new();
///     let bound = params.bind(&tape);
///     let loss = (bound.get("line.slope")? - 3.0).square().sum_all();
///     adam.step(&mut params, &bound.gradients(&loss.backward()?)?)?;
/// }
/// assert!((params.get("line.slope")?.item()? - 3.0).abs() < 1e-2);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Params {
    tensors: BTreeMap<String, Tensor>,
    frozen: ByPrefix<bool>,
}

impl Params {
    /// An empty store.
    ///
    /// ```
    /// assert_eq!(gradreel::optim::Params::new().count(), 0);
    /// ```
    pub fn new() -> Self {
        Self::default()
    }

    /// Stores a tensor under a path, replacing what was there.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(params.count(), 6);
    /// ```
    pub fn set(&mut self, path: impl Into<String>, value: Tensor) {
        self.tensors.insert(path.into(), value);
    }

    /// The tensor at a path.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(params.get("net.weight")?.dims(), [2, 3]);
    /// assert!(params.get("net.bias").is_err());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when there is none.
    pub fn get(&self, path: &str) -> Result<&Tensor> {
        self.tensors.get(path).ok_or_else(|| missing(path, self.tensors.keys()))
    }

    /// Every path with its tensor.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(params.iter().next().map(|(path, _)| path), Some("net.weight"));
    /// ```
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.tensors.iter().map(|(path, value)| (path.as_str(), value))
    }

    /// Number of scalars in all tensors.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(params.count(), 6);
    /// ```
    pub fn count(&self) -> usize {
        self.tensors.values().map(Tensor::len).sum()
    }

    /// Number of scalars in the tensors that are not frozen.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// params.freeze("net")?;
    /// assert_eq!(params.count_trainable(), 0);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn count_trainable(&self) -> usize {
        self.iter().filter(|(path, _)| !self.is_frozen(path)).map(|(_, value)| value.len()).sum()
    }

    /// The parameters under a prefix, by the rest of their paths.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(params.scope("net").get("weight")?.len(), 6);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn scope(&self, prefix: impl Into<String>) -> Scope<'_> {
        Scope { params: self, prefix: prefix.into() }
    }

    /// Treats every path under this prefix as constant from now on. The longest prefix counts: part of what is frozen can be
    /// thawed.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// params.freeze("net")?;
    /// assert!(params.is_frozen("net.weight"));
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when no path has this prefix.
    pub fn freeze(&mut self, prefix: &str) -> Result<()> {
        self.set_frozen(prefix, true)
    }

    /// Treats every path under this prefix as variable from now on.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// params.freeze("net")?;
    /// params.thaw("net.weight")?;
    /// assert!(!params.is_frozen("net.weight"));
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when no path has this prefix.
    pub fn thaw(&mut self, prefix: &str) -> Result<()> {
        self.set_frozen(prefix, false)
    }

    fn set_frozen(&mut self, prefix: &str, frozen: bool) -> Result<()> {
        check_prefix(if frozen { "freezing" } else { "thawing" }, prefix, &self.tensors)?;
        self.frozen.insert(prefix, frozen);
        Ok(())
    }

    /// Whether a path is constant.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// assert!(!params.is_frozen("net.weight"));
    /// ```
    pub fn is_frozen(&self, path: &str) -> bool {
        self.frozen.get(path).copied().unwrap_or(false)
    }

    /// Stores all floats under a prefix in another dtype; `f16` halves the memory of weights that are not trained.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// params.cast("net", DType::F16)?;
    /// assert_eq!(params.get("net.weight")?.bytes(), 12);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when no path has this prefix, or `dtype` holds no floats; [`ErrorKind::Device`] when a tensor
    /// cannot be read back.
    pub fn cast(&mut self, prefix: &str, dtype: DType) -> Result<()> {
        check_prefix("a cast", prefix, &self.tensors)?;
        if dtype == DType::U32 {
            return Err(Error::new(ErrorKind::Input, "parameters are not cast to integers").at(prefix));
        }
        let paths: Vec<String> = under(&self.tensors, prefix).map(|(path, _)| path.clone()).collect();
        for path in paths {
            let value = self.get_mut(&path)?;
            if value.dtype() != DType::U32 {
                *value = value.cast(dtype)?;
            }
        }
        Ok(())
    }

    pub(super) fn get_mut(&mut self, path: &str) -> Result<&mut Tensor> {
        if self.tensors.contains_key(path) {
            return Ok(self.tensors.get_mut(path).expect("it is there"));
        }
        Err(missing(path, self.tensors.keys()))
    }

    pub(super) fn tensors(&self) -> &BTreeMap<String, Tensor> {
        &self.tensors
    }
}

impl FromIterator<(String, Tensor)> for Params {
    fn from_iter<I: IntoIterator<Item = (String, Tensor)>>(tensors: I) -> Self {
        Self { tensors: tensors.into_iter().collect(), frozen: ByPrefix::default() }
    }
}

/// The parameters under a prefix, by the rest of their paths.
///
/// ```
/// use gradreel::optim::Params;
/// use gradreel::{DType, Tensor};
/// let mut params = Params::new();
/// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
/// let net = params.scope("net");
/// assert_eq!(net.count(), 6);
/// ```
#[derive(Debug, Clone)]
pub struct Scope<'p> {
    params: &'p Params,
    prefix: String,
}

impl<'p> Scope<'p> {
    /// The tensor at the rest of a path.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(params.scope("net").get("weight")?.dims(), [2, 3]);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when there is none.
    pub fn get(&self, path: &str) -> Result<&'p Tensor> {
        self.params.get(&join(&self.prefix, path))
    }

    /// The parameters under a longer prefix.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.first.weight", Tensor::zeros([2], DType::F32));
    /// assert_eq!(params.scope("net").scope("first").count(), 2);
    /// ```
    #[must_use]
    pub fn scope(&self, prefix: &str) -> Self {
        Self { params: self.params, prefix: join(&self.prefix, prefix) }
    }

    /// The rest of every path with its tensor.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(params.scope("net").iter().next().map(|(path, _)| path), Some("weight"));
    /// ```
    pub fn iter(&self) -> impl Iterator<Item = (&'p str, &'p Tensor)> {
        let cut = if self.prefix.is_empty() { 0 } else { self.prefix.len() + 1 };
        under(&self.params.tensors, &self.prefix).map(move |(path, value)| (path.get(cut..).unwrap_or(""), value))
    }

    /// Number of scalars in all tensors.
    ///
    /// ```
    /// use gradreel::optim::Params;
    /// use gradreel::{DType, Tensor};
    /// let mut params = Params::new();
    /// params.set("net.weight", Tensor::zeros([2, 3], DType::F32));
    /// assert_eq!(params.scope("net").count(), 6);
    /// ```
    pub fn count(&self) -> usize {
        self.iter().map(|(_, value)| value.len()).sum()
    }
}

/// A path below a prefix.
pub(super) fn join(prefix: &str, path: &str) -> String {
    match (prefix, path) {
        ("", path) => path.to_owned(),
        (prefix, "") => prefix.to_owned(),
        _ => format!("{prefix}.{path}"),
    }
}

/// The error for a path that there is not; names some that are near.
pub(super) fn missing<'a>(path: &str, known: impl Iterator<Item = &'a String>) -> Error {
    let known: Vec<_> = known.take(8).map(String::as_str).collect();
    Error::new(ErrorKind::Input, "no parameter at this path").at(path).found(format!("paths such as {known:?}"))
}
