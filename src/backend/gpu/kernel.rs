//! A kernel: WGSL text and what naga reads out of it.
//!
//! Bindings, element types, workgroup sizes and the constants that the host needs are read from the validated module;
//! the host states only the names of the buffers in the order in which it gives them.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::OnceLock;

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, Literal, Module, ScalarKind, StorageAccess, TypeInner};

use crate::backend::gpu::source::Source;
use crate::{DType, Error, ErrorKind, Result};

/// A compute kernel in WGSL, for [`Gpu::launch`](crate::backend::gpu::Gpu::launch).
///
/// All bindings are in group 0: at most one uniform struct of 32-bit words (the parameters), and storage buffers that
/// are arrays of `f32` or `u32`, of vectors of these, or of atomic `u32`.
///
/// ```
/// use gradreel::backend::gpu::Kernel;
///
/// static TWICE: Kernel = Kernel::new("twice", "main", "
///     @group(0) @binding(0) var<storage, read_write> y: array<f32>;
///     @group(0) @binding(1) var<storage, read> x: array<f32>;
///     @compute @workgroup_size(64)
///     fn main(@builtin(global_invocation_id) id: vec3<u32>) {
///         if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
///     }", &["y", "x"]);
///
/// assert_eq!(TWICE.reflect()?.invocations(), 64);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug)]
pub struct Kernel {
    name: Cow<'static, str>,
    entry: &'static str,
    text: &'static str,
    program: Option<String>,
    buffers: &'static [&'static str],
    reflected: OnceLock<Result<Reflection>>,
}

/// A storage buffer of a kernel.
///
/// ```
/// use gradreel::DType;
/// use gradreel::backend::gpu::Kernel;
/// static DOUBLE: Kernel = Kernel::new("double", "main", "
/// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
/// @group(0) @binding(1) var<storage, read> x: array<f32>;
/// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
/// }", &["y", "x"]);
/// let y = &DOUBLE.reflect()?.buffers()[0];
/// assert_eq!((y.name.as_str(), y.slot, y.element, y.written), ("y", 0, DType::F32, true));
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Binding {
    /// Its name in the shader.
    pub name: String,
    /// Its binding number in group 0.
    pub slot: u32,
    /// Type of its elements; one of `u32` takes the bits of any type of four bytes.
    pub element: DType,
    /// Whether the kernel may write to it.
    pub written: bool,
}

impl Binding {
    /// Whether it takes `f16` tensors, two numbers to a word: the shader says so by a name that ends in `_f16`.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// assert!(!DOUBLE.reflect()?.buffers()[0].holds_halves());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn holds_halves(&self) -> bool {
        self.element == DType::U32 && self.name.ends_with("_f16")
    }
}

/// What the validated module says about a kernel.
///
/// ```
/// use gradreel::backend::gpu::Kernel;
/// static DOUBLE: Kernel = Kernel::new("double", "main", "
/// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
/// @group(0) @binding(1) var<storage, read> x: array<f32>;
/// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
/// }", &["y", "x"]);
/// assert_eq!(DOUBLE.reflect()?.buffers().len(), 2);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug)]
pub struct Reflection {
    text: String,
    buffers: Vec<Binding>,
    parameters: Option<(u32, usize)>,
    workgroup: [u32; 3],
    constants: BTreeMap<String, u32>,
}

impl Kernel {
    /// A kernel with this entry point; `buffers` names its storage buffers in the order in which the host gives them,
    /// the written one first.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// DOUBLE.reflect()?; // parsed and validated, without a GPU
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub const fn new(
        name: &'static str,
        entry: &'static str,
        text: &'static str,
        buffers: &'static [&'static str],
    ) -> Self {
        let name = Cow::Borrowed(name);
        Self { name, entry, text, program: None, buffers, reflected: OnceLock::new() }
    }

    /// A kernel with the entry point `main` whose text has a line `#import "program"`, where `program` is put in: for text that
    /// is made at run time, such as [`Program::wgsl`](crate::scalar::Program::wgsl).
    ///
    /// ```
    /// // `Map::kernel` is the caller of this: a kernel around a program's WGSL
    /// use gradreel::{ops::Map, scalar::Program};
    /// let square = Map::new(Program::trace("square", &["x"], &["y"], |x| vec![x[0].square()]));
    /// square.kernel()?.reflect()?;
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn around(program: String, name: String, text: &'static str, buffers: &'static [&'static str]) -> Self {
        let name = Cow::Owned(name);
        Self { name, entry: "main", text, program: Some(program), buffers, reflected: OnceLock::new() }
    }

    /// Its name in errors and labels.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// assert_eq!(DOUBLE.name(), "double");
    /// ```
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The entry point that it runs.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// assert_eq!(DOUBLE.entry(), "main");
    /// ```
    pub fn entry(&self) -> &'static str {
        self.entry
    }

    /// What the module says about it, parsed and validated at the first call; needs no GPU.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// assert_eq!(DOUBLE.reflect()?.invocations(), 64);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Input`] with file and line for a text that does not parse or validate, a buffer that is not there
    /// under its name, or one that the host does not give.
    pub fn reflect(&self) -> Result<&Reflection> {
        self.reflected.get_or_init(|| self.read()).as_ref().map_err(Clone::clone)
    }

    fn read(&self) -> Result<Reflection> {
        let source = Source::expand(&self.name, self.text, self.program.as_deref())?;
        let wrong = |what: String, line: Option<u32>| {
            let place = line.map_or_else(|| format!("{}.wgsl", self.name), |line| source.origin(line as usize));
            Error::new(ErrorKind::Input, format!("the kernel {} is not valid WGSL", self.name)).at(place).found(what)
        };
        let module = naga::front::wgsl::parse_str(&source.text)
            .map_err(|e| wrong(e.message().to_owned(), e.location(&source.text).map(|l| l.line_number)))?;
        // without capabilities: what WebGPU guarantees everywhere
        let info = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module).map_err(|e| {
            let line = e.location(&source.text).map(|l| l.line_number);
            let causes = std::iter::successors(Some(e.as_inner() as &dyn std::error::Error), |e| e.source());
            wrong(causes.map(ToString::to_string).collect::<Vec<_>>().join(": "), line)
        })?;
        self.describe(&module, &info, source.text.clone()).map_err(|what| wrong(what, None))
    }

    /// Collects the bindings that the entry point uses.
    fn describe(&self, module: &Module, info: &ModuleInfo, text: String) -> Result<Reflection, String> {
        let position = module.entry_points.iter().position(|e| e.name == self.entry);
        let position = position.ok_or_else(|| format!("no entry point {}", self.entry))?;
        let (mut found, mut parameters) = (Vec::new(), None);
        for (handle, variable) in module.global_variables.iter() {
            let Some(binding) = &variable.binding else { continue };
            if info.get_entry_point(position)[handle].is_empty() {
                continue;
            }
            let name = variable.name.clone().unwrap_or_default();
            match variable.space {
                AddressSpace::Uniform if binding.group == 0 && parameters.is_none() => {
                    let bytes = module.types[variable.ty].inner.size(module.to_ctx());
                    parameters = Some((binding.binding, bytes as usize));
                }
                AddressSpace::Storage { access } if binding.group == 0 => found.push(Binding {
                    element: element(module, variable.ty).ok_or_else(|| format!("{name} is no array of f32 or u32"))?,
                    name,
                    slot: binding.binding,
                    written: access.contains(StorageAccess::STORE),
                }),
                _ => return Err(format!("{name} is neither a storage buffer nor the only uniform of group 0")),
            }
        }
        let mut buffers = Vec::with_capacity(found.len());
        for name in self.buffers {
            let at = found.iter().position(|binding| binding.name == *name);
            buffers.push(found.swap_remove(at.ok_or_else(|| format!("it uses no storage buffer {name}"))?));
        }
        if let Some(extra) = found.first() {
            return Err(format!("the host gives no storage buffer {}", extra.name));
        }
        let workgroup = module.entry_points[position].workgroup_size;
        Ok(Reflection { text, buffers, parameters, workgroup, constants: constants(module) })
    }
}

impl Reflection {
    /// The whole text, imports included.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// assert!(DOUBLE.reflect()?.text().contains("@compute"));
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The storage buffers in the order in which the host gives them.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// assert_eq!(DOUBLE.reflect()?.buffers().len(), 2);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn buffers(&self) -> &[Binding] {
        &self.buffers
    }

    /// Binding number and size in bytes of the uniform struct, if there is one.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// assert_eq!(DOUBLE.reflect()?.parameters(), None);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn parameters(&self) -> Option<(u32, usize)> {
        self.parameters
    }

    /// Invocations of one workgroup.
    ///
    /// ```
    /// use gradreel::backend::gpu::Kernel;
    /// static DOUBLE: Kernel = Kernel::new("double", "main", "
    /// @group(0) @binding(0) var<storage, read_write> y: array<f32>;
    /// @group(0) @binding(1) var<storage, read> x: array<f32>;
    /// @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    ///     if id.x < arrayLength(&y) { y[id.x] = 2.0 * x[id.x]; }
    /// }", &["y", "x"]);
    /// assert_eq!(DOUBLE.reflect()?.invocations(), 64);
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    pub fn invocations(&self) -> usize {
        self.workgroup.iter().map(|&n| n as usize).product()
    }

    /// The value of a `const NAME: u32` of the module.
    ///
    /// ```
    /// let kernels = gradreel::ops::kernels();
    /// let softmax = kernels.iter().find(|kernel| kernel.name() == "softmax").expect("it is listed");
    /// println!("{}", softmax.reflect()?.invocations());
    /// # Ok::<(), gradreel::Error>(())
    /// ```
    ///
    /// # Panics
    /// When the module has none of this name.
    #[track_caller]
    pub fn constant(&self, name: &str) -> usize {
        match self.constants.get(name) {
            Some(value) => *value as usize,
            None => panic!("the kernel has no constant {name}; it has {:?}", self.constants),
        }
    }
}

/// The element type of a runtime-sized array of 32-bit numbers, of vectors of them, or of atomic ones.
fn element(module: &Module, array: naga::Handle<naga::Type>) -> Option<DType> {
    let TypeInner::Array { base, .. } = module.types[array].inner else { return None };
    let scalar = match module.types[base].inner {
        TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) | TypeInner::Vector { scalar, .. } => scalar,
        _ => return None,
    };
    match (scalar.kind, scalar.width) {
        (ScalarKind::Float, 4) => Some(DType::F32),
        (ScalarKind::Uint, 4) => Some(DType::U32),
        _ => None,
    }
}

/// The unsigned constants of a module by name.
fn constants(module: &Module) -> BTreeMap<String, u32> {
    let value = |constant: &naga::Constant| match module.global_expressions[constant.init] {
        naga::Expression::Literal(Literal::U32(value)) => Some((constant.name.clone()?, value)),
        _ => None,
    };
    module.constants.iter().filter_map(|(_, constant)| value(constant)).collect()
}
