//! The calls that are read as descriptions. Nothing is called.

use super::machine::Machine;
use super::value::{Id, Kind, Value, View};
use crate::Result;
use crate::io::Stored;

impl<'a> Machine<'a> {
    /// What a call describes: a dict, a tuple, a tensor, or something opaque.
    pub fn call(&mut self, mut callee: Id, mut arguments: Id) -> Result<Id> {
        loop {
            let (global, given) = match (&self.values[callee as usize], &self.values[arguments as usize]) {
                (Value::Global(global), Value::Tuple(given)) => (global, &given[..]),
                (Value::Global(class), _) => {
                    let class = (**class).clone();
                    return self.opaque(class);
                }
                (Value::Opaque(object), _) => {
                    let class = object.class.clone();
                    return self.opaque(class);
                }
                (other, _) => {
                    let found = format!("a call of {}", other.describe());
                    return Err(self.fault(&found));
                }
            };
            return match (global.module, global.name, given) {
                ("collections", "OrderedDict", []) => self.add(Value::Dict(Vec::new())),
                ("collections", "OrderedDict", [pairs]) => self.ordered_dict(*pairs),
                ("collections", "defaultdict", [] | [_]) => self.add(Value::Dict(Vec::new())),
                ("builtins" | "__builtin__", "set" | "frozenset" | "list" | "tuple", [items])
                    if matches!(self.values[*items as usize], Value::List(_) | Value::Tuple(_)) =>
                {
                    Ok(*items)
                }
                ("_codecs", "encode", _) | ("builtins" | "__builtin__", "bytes" | "bytearray" | "complex", _) => {
                    self.add(Value::Bytes)
                }
                ("torch", "Size", [sizes]) => Ok(*sizes),
                ("torch._utils", "_rebuild_tensor_v2", [storage, offset, size, stride, _, _, more @ ..])
                | ("torch._utils", "_rebuild_tensor", [storage, offset, size, stride, more @ ..]) => {
                    self.tensor([*storage, *offset, *size, *stride], None, more.first().copied())
                }
                ("torch._utils", "_rebuild_tensor_v3", [storage, offset, size, stride, _, _, dtype, more @ ..]) => {
                    self.tensor([*storage, *offset, *size, *stride], Some(*dtype), more.first().copied())
                }
                ("torch._utils", "_rebuild_parameter" | "_rebuild_parameter_with_state", [tensor, ..]) => Ok(*tensor),
                ("torch._tensor", "_rebuild_from_type_v2", [function, _, inner, ..]) => {
                    // the same rules again, for what is inside; a loop, because a file may nest this as often as it likes
                    (callee, arguments) = (*function, *inner);
                    continue;
                }
                _ => {
                    let class = (**global).clone();
                    self.opaque(class)
                }
            };
        }
    }

    fn ordered_dict(&mut self, pairs: Id) -> Result<Id> {
        let items = match &self.values[pairs as usize] {
            Value::List(items) | Value::Tuple(items) => items.len(),
            other => {
                let found = format!("an OrderedDict of {}", other.describe());
                return Err(self.fault(&found));
            }
        };
        self.copying(2 * items)?;
        let (Value::List(items) | Value::Tuple(items)) = &self.values[pairs as usize] else { unreachable!("as above") };
        let pair = |id: &Id| match &self.values[*id as usize] {
            Value::List(pair) | Value::Tuple(pair) if pair.len() == 2 => Ok((pair[0], pair[1])),
            _ => Err(self.fault("an OrderedDict of something other than pairs")),
        };
        let pairs = items.iter().map(pair).collect::<Result<Vec<_>>>()?;
        self.add(Value::Dict(pairs))
    }

    /// A view of a storage; `dtype` where the storage is untyped, `bits` with what is to be done with its numbers.
    fn tensor(&mut self, [storage, offset, size, stride]: [Id; 4], dtype: Option<Id>, bits: Option<Id>) -> Result<Id> {
        let (dims, strides) = (self.sizes(size)?, self.sizes(stride)?);
        if dims.len() != strides.len() {
            return Err(self.fault(&format!("{} sizes with {} strides", dims.len(), strides.len())));
        }
        self.copying(2 * dims.len())?;
        let (Value::Storage(storage), Value::Int(offset)) =
            (&self.values[storage as usize], &self.values[offset as usize])
        else {
            return Err(self.fault("a tensor without a storage and an offset"));
        };
        let stored = match (storage.kind, dtype.map(|id| &self.values[id as usize])) {
            (Kind::Other(class), _) => Err(class),
            (Kind::Typed(stored), None) => Ok(stored),
            (Kind::Untyped, None) => Err("an untyped storage"),
            (_, Some(Value::Global(global))) if global.module == "torch" => of_dtype(global.name).ok_or(global.name),
            (_, Some(_)) => return Err(self.fault("a tensor with a type that is none")),
        };
        let (negative, unread) = match bits.map(|id| &self.values[id as usize]) {
            None => (false, None),
            Some(bits) => self.bits(bits),
        };
        let stored = stored.and_then(|stored| unread.map_or(Ok(stored), Err));
        let offset = self.count(*offset)?.checked_add(storage.first);
        let offset = offset.ok_or_else(|| self.fault("an offset beyond all memory"))?;
        let view = View { storage: (**storage).clone(), stored, negative, offset, dims, strides };
        self.add(Value::Tensor(Box::new(view)))
    }

    /// Whether a tensor is the negative of what is stored, and what else its metadata asks for, which is not read.
    fn bits(&self, bits: &Value<'a>) -> (bool, Option<&'a str>) {
        let pairs = match bits {
            Value::None => return (false, None),
            Value::Dict(pairs) => pairs,
            _ => return (false, Some("metadata of a tensor that is no dict")),
        };
        let (mut negative, mut unread) = (false, None);
        for (key, value) in pairs {
            match (&self.values[*key as usize], &self.values[*value as usize]) {
                (Value::Str("neg"), Value::Bool(bit)) => negative = *bit,
                (_, Value::Bool(false) | Value::None) => {}
                (Value::Str("conj"), _) => unread = Some("a tensor with PyTorch's conjugate bit"),
                _ => unread = Some("metadata of a tensor other than its negative bit"),
            }
        }
        (negative, unread)
    }

    fn sizes(&self, id: Id) -> Result<Vec<usize>> {
        let (Value::Tuple(items) | Value::List(items)) = &self.values[id as usize] else {
            return Err(self.fault("sizes or strides that are no tuple"));
        };
        if items.len() > 64 {
            return Err(self.fault(&format!("a tensor of {} axes", items.len())).wanted("at most 64"));
        }
        let size = |item: &Id| match self.values[*item as usize] {
            Value::Int(size) => self.count(size),
            _ => Err(self.fault("a size or stride that is no integer")),
        };
        items.iter().map(size).collect()
    }
}

/// The element type of `torch.<name>`.
fn of_dtype(name: &str) -> Option<Stored> {
    Some(match name {
        "float32" => Stored::F32,
        "float64" => Stored::F64,
        "float16" => Stored::F16,
        "bfloat16" => Stored::Bf16,
        "int64" => Stored::I64,
        "int32" => Stored::I32,
        "int16" => Stored::I16,
        "int8" => Stored::I8,
        "uint64" => Stored::U64,
        "uint32" => Stored::U32,
        "uint16" => Stored::U16,
        "uint8" => Stored::U8,
        "bool" => Stored::Bool,
        _ => return None,
    })
}
