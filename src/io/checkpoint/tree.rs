//! From what a pickle built to tensors by dotted path.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry as Place;
use std::ops::Range;

use super::children::{Key, children};
use super::value::{Graph, Id, Storage, Value, View};
use crate::io::archive::{Contents, Entry};
use crate::{Error, ErrorKind, Result};

/// Dictionaries within dictionaries; a state dict has one level.
const DEEPEST: usize = 64;
/// Constants of a dictionary or list that are kept as metadata; one with more is data.
const MOST_CONSTANTS: usize = 256;
/// What can be done about objects of a program.
const TENSORS_ALONE: &str = "save the tensors alone: torch.save(model.state_dict(), \"weights.pt\"), where `model` is the object that was saved";

/// Where the bytes of a storage are in the file.
type Locate<'l> = &'l dyn Fn(&Storage<'_>) -> Result<Range<usize>>;

/// Lists the tensors under the keys; without keys under `state_dict` where there is one, else all.
pub(super) fn list(graph: &Graph<'_>, keys: &[&str], locate: Locate<'_>) -> Result<Contents> {
    let budget = 16 * graph.values.len() + (1 << 20);
    let mut tree = Tree { graph, locate, contents: Contents::default(), origins: BTreeMap::new(), budget };
    let mut root = graph.top;
    if keys.is_empty() {
        let top = tree.children(graph.top)?.unwrap_or_default();
        let is_state = |(key, id): &&(Key<'_>, Id)| {
            matches!(key, Key::Text("state_dict")) && children(graph, *id).is_some_and(|inside| !inside.is_empty())
        };
        let mut states = top.iter().filter(is_state);
        if let (Some((_, state)), None) = (states.next(), states.next()) {
            for (key, id) in top.iter().take(MOST_CONSTANTS) {
                tree.constant(&key.name(), &key.access(), *id);
            }
            root = *state;
        }
    }
    for (depth, key) in keys.iter().enumerate() {
        let inside = tree.children(root)?.unwrap_or_default();
        let mut found = inside.iter().filter(|(name, _)| name.name() == **key);
        root = match (found.next(), found.next()) {
            (Some((_, id)), None) => *id,
            (Some((first, _)), Some((second, _))) => {
                return Err(one_name(&first.access(), &second.access()).at(format!("{:?}", &keys[..=depth])));
            }
            (None, _) => {
                let known: Vec<_> = inside.iter().take(8).map(|(name, _)| name.name()).collect();
                return Err(Error::new(ErrorKind::Input, "the checkpoint has nothing at these keys")
                    .at(format!("{:?}", &keys[..=depth]))
                    .found(format!("{known:?} in {}", graph.get(root).describe())));
            }
        };
    }
    if !matches!(graph.get(root), Value::Tensor(_)) && children(graph, root).is_none() {
        return Err(Error::new(ErrorKind::Input, "the checkpoint holds no tensors by name")
            .found(graph.get(root).describe())
            .wanted("a dict of tensors, such as a state dict, or a module")
            .fix(TENSORS_ALONE));
    }
    tree.walk(root, "", "", 0)?;
    Ok(tree.contents)
}

struct Tree<'g> {
    graph: &'g Graph<'g>,
    locate: Locate<'g>,
    contents: Contents,
    /// How a program gets to each entry.
    origins: BTreeMap<String, String>,
    /// What may still be visited: a small pickle can refer to the same dictionary from everywhere.
    budget: usize,
}

impl<'g> Tree<'g> {
    fn walk(&mut self, id: Id, path: &str, origin: &str, depth: usize) -> Result<()> {
        if depth > DEEPEST {
            return Err(Error::new(ErrorKind::Input, "the checkpoint is nested too deeply")
                .at(path.chars().take(200).collect::<String>())
                .wanted(format!("at most {DEEPEST} levels")));
        }
        if let Value::Tensor(view) = self.graph.get(id) {
            let name = if path.is_empty() && depth == 0 { "tensor" } else { path };
            let entry = self.entry(view, name)?;
            self.insert(name, origin, entry);
            return Ok(());
        }
        let Some(inside) = self.children(id)? else {
            let error = Error::new(ErrorKind::Input, "an entry of the checkpoint is no tensor")
                .at(path)
                .found(self.graph.get(id).describe())
                .fix(TENSORS_ALONE);
            self.insert(path, origin, Err(error));
            return Ok(());
        };
        let mut kept = 0;
        let is_data =
            inside.iter().filter(|(_, id)| text_of(self.graph.get(*id)).is_some()).nth(MOST_CONSTANTS).is_some();
        for (key, id) in inside {
            let constant = text_of(self.graph.get(id)).is_some();
            if constant && (is_data || kept == MOST_CONSTANTS) {
                continue;
            }
            let (name, access) = (key.name(), key.access());
            let name = if depth == 0 { name } else { format!("{path}.{name}") };
            self.spend(name.len() + origin.len() + access.len() + if constant { 16 } else { 64 })?;
            let origin = format!("{origin}{access}");
            if constant {
                kept += 1;
                self.constant(&name, &origin, id);
            } else {
                self.walk(id, &name, &origin, depth + 1)?;
            }
        }
        Ok(())
    }

    /// Of two entries with one path neither is given: which one was meant, nobody can tell.
    fn insert(&mut self, path: &str, origin: &str, entry: Result<Entry>) {
        match self.contents.entries.entry(path.to_owned()) {
            Place::Vacant(place) => {
                place.insert(entry);
                self.origins.insert(path.to_owned(), origin.to_owned());
            }
            Place::Occupied(mut place) => {
                let first = self.origins.get(path).map_or("", String::as_str);
                *place.get_mut() = Err(one_name(first, origin).at(path));
            }
        }
    }

    fn children(&mut self, id: Id) -> Result<Option<Vec<(Key<'g>, Id)>>> {
        let graph = self.graph;
        let count = match graph.get(id) {
            Value::Dict(pairs) => pairs.len(),
            Value::List(items) | Value::Tuple(items) | Value::Set(items) => items.len(),
            Value::Opaque(object) => object.pairs.len() + object.items.len(),
            _ => 0,
        };
        self.spend(count)?;
        Ok(children(graph, id))
    }

    fn spend(&mut self, cost: usize) -> Result<()> {
        self.budget = self.budget.checked_sub(cost).ok_or_else(|| {
            Error::new(ErrorKind::Input, "the checkpoint repeats itself without end")
                .found("dictionaries that contain each other, or very many paths")
                .fix(TENSORS_ALONE)
        })?;
        Ok(())
    }

    /// Keeps a number or a text as metadata.
    fn constant(&mut self, path: &str, origin: &str, id: Id) {
        if let Some(Some(text)) = text_of(self.graph.get(id)) {
            let metadata = &mut self.contents.metadata;
            // a number and a text with the same digits are two keys
            let name = if metadata.contains_key(path) { origin } else { path };
            metadata.insert(name.to_owned(), text);
        }
    }

    /// The place of a tensor. What is not read is a fault of the entry; a view that does not fit is one of the file.
    fn entry(&self, view: &View<'_>, path: &str) -> Result<Result<Entry>> {
        let stored = match view.stored {
            Ok(stored) => stored,
            Err(found) => {
                let error = Error::new(ErrorKind::Unsupported, "a tensor has a type that is not read");
                let fix = match found.starts_with("Complex") || found.contains("conj") {
                    true => "save it as two real ones, torch.view_as_real(x.resolve_conj()), or leave it out",
                    false => "save it in another type, such as x.float(), or leave it out",
                };
                let wanted = "bool, an integer type, f16, bf16, f32 or f64";
                return Ok(Err(error.at(path).found(found).wanted(wanted).fix(fix)));
            }
        };
        let place = match (self.locate)(&view.storage) {
            Err(error) if error.kind() == ErrorKind::Unsupported => return Ok(Err(error.within(path))),
            place => place.map_err(|e| e.within(path))?,
        };
        let entry = Entry::new(stored, view.dims.clone(), view.strides.clone(), view.offset, place);
        let entry = entry.map_err(|e| e.at(path))?;
        Ok(Ok(Entry { negative: view.negative, ..entry }))
    }
}

/// The text of a constant; an empty one of what is a constant and is not kept.
fn text_of(value: &Value<'_>) -> Option<Option<String>> {
    Some(match value {
        Value::None => Some("None".to_owned()),
        Value::Bool(value) => Some(value.to_string()),
        Value::Int(value) => Some(value.to_string()),
        Value::Float(value) => Some(value.to_string()),
        Value::Str(value) if value.len() <= 1 << 12 => Some((*value).to_owned()),
        Value::Escaped(value) if value.len() <= 1 << 12 => Some((**value).to_owned()),
        Value::Global(class) => Some(class.full_name()),
        Value::Str(_) | Value::Escaped(_) | Value::Big(_) | Value::Digits(_) | Value::Bytes => None,
        _ => return None,
    })
}

fn one_name(first: &str, second: &str) -> Error {
    Error::new(ErrorKind::Input, "two entries of the checkpoint have one name")
        .found(format!("top{first} and top{second}"))
        .wanted("one entry for each name")
        .fix("rename one of them before torch.save")
}
