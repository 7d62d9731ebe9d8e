//! What a pickle builds: plain values in an arena, so that shared and circular references are numbers.

use crate::io::Stored;
use crate::{Error, ErrorKind, Result};

/// A place in the arena.
pub(super) type Id = u32;

/// A value. Text and bytes stay where they are in the pickle.
pub(super) enum Value<'a> {
    None,
    Bool(bool),
    Int(i64),
    /// An integer of more than eight bytes, little-endian.
    Big(&'a [u8]),
    Float(f64),
    /// An integer that does not fit, in digits.
    Digits(&'a str),
    Str(&'a str),
    /// A text that stands in the pickle with escapes.
    Escaped(Box<str>),
    Bytes,
    List(Vec<Id>),
    Tuple(Vec<Id>),
    Set(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    Global(Box<Global<'a>>),
    Storage(Box<Storage<'a>>),
    Tensor(Box<View<'a>>),
    /// What a call would have returned that is not made, or an object of an unknown class.
    Opaque(Box<Object<'a>>),
}

/// An object that is not made, and what it was to be filled with.
pub(super) struct Object<'a> {
    pub class: Global<'a>,
    /// Its attributes: dictionaries, or tuples of them.
    pub states: Vec<Id>,
    /// What it holds by key, if it is a kind of dictionary.
    pub pairs: Vec<(Id, Id)>,
    /// What it holds, if it is a kind of list.
    pub items: Vec<Id>,
}

impl<'a> Object<'a> {
    pub fn of(class: Global<'a>) -> Self {
        Self { class, states: Vec::new(), pairs: Vec::new(), items: Vec::new() }
    }
}

/// A name of something in Python.
#[derive(Clone)]
pub(super) struct Global<'a> {
    pub module: &'a str,
    pub name: &'a str,
}

/// Numbers beside the pickle.
#[derive(Clone)]
pub(super) struct Storage<'a> {
    pub key: &'a str,
    pub kind: Kind<'a>,
    /// Elements, or bytes where untyped.
    pub len: usize,
    /// Where this view of the storage starts, in elements (old files only).
    pub first: usize,
}

/// The type of a storage.
#[derive(Clone, Copy)]
pub(super) enum Kind<'a> {
    Typed(Stored),
    /// Bytes, to which the tensor gives a type.
    Untyped,
    /// A class of storages that is not read.
    Other(&'a str),
}

impl Kind<'_> {
    /// The type by the class of the storage.
    pub fn of<'a>(global: &Global<'a>) -> Kind<'a> {
        if !matches!(global.module, "torch" | "torch.storage" | "torch.cuda") {
            return Kind::Other(global.name);
        }
        Kind::Typed(match global.name {
            "FloatStorage" => Stored::F32,
            "DoubleStorage" => Stored::F64,
            "HalfStorage" => Stored::F16,
            "BFloat16Storage" => Stored::Bf16,
            "LongStorage" => Stored::I64,
            "IntStorage" => Stored::I32,
            "ShortStorage" => Stored::I16,
            "CharStorage" => Stored::I8,
            "ByteStorage" => Stored::U8,
            "BoolStorage" => Stored::Bool,
            "UntypedStorage" | "_UntypedStorage" => return Kind::Untyped,
            other => return Kind::Other(other),
        })
    }

    /// Bytes per element, if it is known: also of storages that are not read, because others lie behind them.
    pub fn size(self) -> Option<usize> {
        Some(match self {
            Kind::Typed(stored) => stored.size(),
            Kind::Untyped => 1,
            Kind::Other("ComplexDoubleStorage") => 16,
            Kind::Other("ComplexFloatStorage") => 8,
            Kind::Other("ComplexHalfStorage" | "QInt32Storage") => 4,
            Kind::Other("QInt8Storage" | "QUInt8Storage" | "QUInt4x2Storage" | "QUInt2x4Storage") => 1,
            Kind::Other(_) => return None,
        })
    }
}

impl<'a> Kind<'a> {
    /// The class of a storage that is not read.
    pub fn name(self) -> &'a str {
        match self {
            Kind::Other(name) => name,
            Kind::Typed(_) | Kind::Untyped => "a storage",
        }
    }
}

impl Storage<'_> {
    /// Checks the claimed length against the bytes that are there.
    pub fn check_len(&self, bytes: usize) -> Result<()> {
        let Some(size) = self.kind.size() else { return Ok(()) };
        if self.len.checked_mul(size) == Some(bytes) {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "a storage is not as long as the pickle says")
            .found(format!("{bytes} bytes"))
            .wanted(format!("{} elements of {size} bytes", self.len)))
    }
}

/// A tensor: a strided view of a storage.
pub(super) struct View<'a> {
    pub storage: Storage<'a>,
    /// The element type, or the name of what is not read.
    pub stored: Result<Stored, &'a str>,
    /// Whether the tensor is the negative of what is stored.
    pub negative: bool,
    pub offset: usize,
    pub dims: Vec<usize>,
    pub strides: Vec<usize>,
}

/// Everything that a pickle built.
pub(super) struct Graph<'a> {
    pub values: Vec<Value<'a>>,
    pub top: Id,
}

impl<'a> Graph<'a> {
    pub fn get(&self, id: Id) -> &Value<'a> {
        &self.values[id as usize]
    }
}

impl Value<'_> {
    /// What to call it in an error.
    pub fn describe(&self) -> String {
        match self {
            Self::None => "None".to_owned(),
            Self::Bool(_) => "a bool".to_owned(),
            Self::Int(_) | Self::Big(_) | Self::Digits(_) => "an int".to_owned(),
            Self::Float(_) => "a float".to_owned(),
            Self::Str(_) | Self::Escaped(_) => "a text".to_owned(),
            Self::Bytes => "bytes".to_owned(),
            Self::List(_) => "a list".to_owned(),
            Self::Tuple(_) => "a tuple".to_owned(),
            Self::Set(_) => "a set".to_owned(),
            Self::Dict(_) => "a dict".to_owned(),
            Self::Storage(_) => "a bare storage".to_owned(),
            Self::Tensor(_) => "a tensor".to_owned(),
            Self::Global(global) => format!("a reference to {}", global.full_name()),
            Self::Opaque(object) => {
                format!("the result of a call to {}, which is never made", object.class.full_name())
            }
        }
    }
}

impl Global<'_> {
    pub fn full_name(&self) -> String {
        let short = |text: &str| text.chars().take(80).collect::<String>();
        format!("{}.{}", short(self.module), short(self.name))
    }
}
