//! References to storages, as a tuple or as the text that protocol 0 has in its place.

use super::machine::Machine;
use super::text;
use super::value::{Global, Id, Kind, Storage, Value};
use crate::Result;

const WANTED: &str = "(\"storage\", class, key, location, length)";

impl<'a> Machine<'a> {
    /// A reference to a storage: `("storage", class, key, location, length[, view])`, or, in the old container,
    /// `("module", class, file, source)`, which stands for the class.
    pub(super) fn persistent(&mut self) -> Result<Value<'a>> {
        let id = self.pop()?;
        let Value::Tuple(parts) = &self.values[id as usize] else {
            return Err(self.fault("a reference to something that is no storage").wanted(WANTED));
        };
        let part = |i: usize| parts.get(i).map_or(&Value::None, |id| &self.values[*id as usize]);
        if let (Value::Str("module"), Value::Global(class)) = (part(0), part(1)) {
            return Ok(Value::Global(class.clone()));
        }
        let (Value::Str("storage"), Value::Global(class), Value::Str(key), Value::Int(len)) =
            (part(0), part(1), part(2), part(4))
        else {
            return Err(self.fault("a reference to something that is no storage").wanted(WANTED));
        };
        let view = match part(5) {
            Value::Tuple(view) => Some(&view[..]),
            _ => None,
        };
        let view = match view {
            Some([_, first, len]) => match (&self.values[*first as usize], &self.values[*len as usize]) {
                (Value::Int(first), Value::Int(len)) => Some([*first, *len]),
                _ => return Err(self.fault("a view of a storage without numbers")),
            },
            _ => None,
        };
        self.storage(class, key, *len, view)
    }

    /// The same as one line of text: `('storage', <class 'torch.FloatStorage'>, '0', 'cpu', 6)`.
    pub(super) fn persistent_text(&mut self) -> Result<Value<'a>> {
        let line = self.line()?;
        let parts = text::tuple(line).unwrap_or_default();
        let [
            text::Part::Text("storage"),
            text::Part::Class(module, name),
            text::Part::Text(key),
            _,
            text::Part::Int(len),
            ..,
        ] = parts[..]
        else {
            return Err(self.fault("a reference to something that is no storage").wanted(WANTED));
        };
        let view = match parts[5..] {
            [text::Part::Open, _, text::Part::Int(first), text::Part::Int(len), text::Part::Close] => {
                Some([first, len])
            }
            _ => None,
        };
        self.storage(&Global { module, name }, key, len, view)
    }

    /// `view` is the first element and the number of elements: files before version 0.4 have views of storages.
    fn storage(&self, class: &Global<'a>, key: &'a str, len: i64, view: Option<[i64; 2]>) -> Result<Value<'a>> {
        let mut storage = Storage { key, kind: Kind::of(class), len: self.count(len)?, first: 0 };
        if let Some([first, len]) = view {
            storage.first = self.count(first)?;
            let end = storage.first.checked_add(self.count(len)?);
            if end.is_none_or(|end| end > storage.len) {
                return Err(self.fault("a view beyond its storage"));
            }
        }
        Ok(Value::Storage(Box::new(storage)))
    }

    /// What a call or a reference of an unknown kind leaves.
    pub(super) fn opaque(&mut self, class: Global<'a>) -> Result<Id> {
        self.add(Value::Opaque(Box::new(super::value::Object::of(class))))
    }
}
