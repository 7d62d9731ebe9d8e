//! From what a pickle built to tensors by dotted path.

use std::collections::BTreeMap;
use std::ops::Range;

use super::value::{Graph, Id, Storage, Value, View};
use crate::io::archive::{Contents, Entry};
use crate::{Error, ErrorKind, Result};

/// Dictionaries within dictionaries; a state dict has one level.
const DEEPEST: usize = 64;

/// Where the bytes of a storage are in the file.
type Locate<'l> = &'l dyn Fn(&Storage<'_>) -> Result<Range<usize>>;

/// Lists the tensors under the keys; without keys under `state_dict` where there is one, else all.
pub(super) fn list(graph: &Graph<'_>, keys: &[&str], locate: Locate<'_>) -> Result<Contents> {
    let budget = 64 * graph.values.len() + (1 << 20);
    let mut tree = Tree { graph, locate, contents: Contents::default(), budget };
    let mut root = graph.top;
    if keys.is_empty() {
        let children = tree.children(graph.top)?.unwrap_or_default();
        if let Some(state) = children.get("state_dict") {
            for (key, id) in &children {
                tree.constant(key, *id);
            }
            root = *state;
        }
    }
    for (depth, key) in keys.iter().enumerate() {
        let children = tree.children(root)?.unwrap_or_default();
        root = *children.get(*key).ok_or_else(|| {
            let known: Vec<_> = children.keys().take(8).collect();
            Error::new(ErrorKind::Input, "the checkpoint has nothing at these keys")
                .at(format!("{:?}", &keys[..=depth]))
                .found(format!("{known:?} in {}", graph.get(root).describe()))
        })?;
    }
    tree.walk(root, "", 0)?;
    Ok(tree.contents)
}

struct Tree<'g> {
    graph: &'g Graph<'g>,
    locate: Locate<'g>,
    contents: Contents,
    /// Characters of paths that may still be visited: a small pickle can refer to the same dictionary from everywhere.
    budget: usize,
}

impl Tree<'_> {
    fn walk(&mut self, id: Id, path: &str, depth: usize) -> Result<()> {
        if depth > DEEPEST {
            return Err(Error::new(ErrorKind::Input, "the checkpoint is nested too deeply")
                .at(path.chars().take(200).collect::<String>())
                .wanted(format!("at most {DEEPEST} levels")));
        }
        if self.constant(path, id) {
            return Ok(());
        }
        if let Value::Tensor(view) = self.graph.get(id) {
            let name = if path.is_empty() { "tensor" } else { path };
            let entry = self.entry(view, name)?;
            return self.insert(name, entry);
        }
        let Some(children) = self.children(id)? else {
            let error = Error::new(ErrorKind::Input, "an entry of the checkpoint is no tensor")
                .at(path)
                .found(self.graph.get(id).describe());
            return self.insert(path, Err(error));
        };
        for (key, id) in children {
            let child = if path.is_empty() { key } else { format!("{path}.{key}") };
            self.spend(child.len())?;
            self.walk(id, &child, depth + 1)?;
        }
        Ok(())
    }

    fn insert(&mut self, path: &str, entry: Result<Entry>) -> Result<()> {
        if self.contents.entries.insert(path.to_owned(), entry).is_some() {
            return Err(Error::new(ErrorKind::Input, "two entries of the checkpoint have one path").at(path));
        }
        Ok(())
    }

    /// Children by key or position, if the value has any; of equal keys the last counts, as in Python.
    fn children(&mut self, id: Id) -> Result<Option<BTreeMap<String, Id>>> {
        let mut children = BTreeMap::new();
        match self.graph.get(id) {
            Value::Dict(pairs) => {
                for (key, value) in pairs {
                    let key = match self.graph.get(*key) {
                        Value::Str(key) => {
                            self.spend(key.len())?;
                            (*key).to_owned()
                        }
                        Value::Int(key) => key.to_string(),
                        other => format!("<{}>", other.describe()),
                    };
                    self.spend(key.len())?;
                    children.insert(key, *value);
                }
            }
            Value::List(items) | Value::Tuple(items) => {
                for (position, item) in items.iter().enumerate() {
                    self.spend(8)?;
                    children.insert(position.to_string(), *item);
                }
            }
            _ => return Ok(None),
        }
        Ok(Some(children))
    }

    fn spend(&mut self, characters: usize) -> Result<()> {
        self.budget = self.budget.checked_sub(characters + 8).ok_or_else(|| {
            Error::new(ErrorKind::Input, "the checkpoint repeats itself without end")
                .found("dictionaries that contain each other, or very many paths")
        })?;
        Ok(())
    }

    /// Keeps a number or a text as metadata; tells whether it was one.
    fn constant(&mut self, path: &str, id: Id) -> bool {
        let text = match self.graph.get(id) {
            Value::None => "None".to_owned(),
            Value::Bool(value) => value.to_string(),
            Value::Int(value) => value.to_string(),
            Value::Float(value) => value.to_string(),
            Value::Str(value) if value.len() <= 1 << 12 => (*value).to_owned(),
            Value::Str(_) | Value::Big(_) | Value::Bytes => return true,
            _ => return false,
        };
        self.contents.metadata.insert(path.to_owned(), text);
        true
    }

    /// The place of a tensor. A type that is not read is a fault of the entry; a view that does not fit is one of the file.
    fn entry(&self, view: &View<'_>, path: &str) -> Result<Result<Entry>> {
        let stored = match view.stored {
            Ok(stored) => stored,
            Err(found) => {
                let error = Error::new(ErrorKind::Unsupported, "a tensor has a type that is not read");
                return Ok(Err(error.at(path).found(found).wanted("bool, an integer type, f16, bf16, f32 or f64")));
            }
        };
        let place = (self.locate)(&view.storage).map_err(|e| e.within(path))?;
        let entry = Entry::new(stored, view.dims.clone(), view.strides.clone(), view.offset, place);
        Ok(Ok(entry.map_err(|e| e.at(path))?))
    }
}
