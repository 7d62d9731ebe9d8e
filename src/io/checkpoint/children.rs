//! What a value holds, and by which names.

use super::value::{Graph, Id, Object, Value};

/// The name of a value within the one that holds it.
pub(super) enum Key<'g> {
    /// A key of a dictionary that is text.
    Text(&'g str),
    /// A key of another type, in Python's notation.
    Other(String),
    /// A place in a list.
    Position(usize),
    /// An attribute of an object, or a part of a module.
    Attribute(&'g str),
}

impl Key<'_> {
    /// Its part of a dotted path.
    pub fn name(&self) -> String {
        match self {
            Self::Text(text) | Self::Attribute(text) => (*text).to_owned(),
            Self::Other(text) => text.clone(),
            Self::Position(position) => position.to_string(),
        }
    }

    /// How a program gets there, which tells the text "1" from the number.
    pub fn access(&self) -> String {
        match self {
            Self::Text(text) => format!("[{text:?}]"),
            Self::Other(text) => format!("[{text}]"),
            Self::Position(position) => format!("[{position}]"),
            Self::Attribute(name) => format!(".{name}"),
        }
    }
}

/// What a value holds, in order; `None` for a value that holds nothing by name.
pub(super) fn children<'g>(graph: &'g Graph<'_>, id: Id) -> Option<Vec<(Key<'g>, Id)>> {
    match graph.get(id) {
        Value::Dict(pairs) => Some(pairs.iter().map(|(key, value)| (self::key(graph, *key), *value)).collect()),
        Value::List(items) | Value::Tuple(items) | Value::Set(items) => Some(positions(items).collect()),
        Value::Opaque(object) => of_object(graph, object),
        _ => None,
    }
}

fn positions<'g>(items: &'g [Id]) -> impl Iterator<Item = (Key<'g>, Id)> {
    items.iter().enumerate().map(|(position, id)| (Key::Position(position), *id))
}

fn of_object<'g>(graph: &'g Graph<'_>, object: &'g Object<'_>) -> Option<Vec<(Key<'g>, Id)>> {
    let attributes = attributes(graph, object);
    if attributes.is_none() && object.pairs.is_empty() && object.items.is_empty() {
        return None;
    }
    let attributes = attributes.unwrap_or_default();
    if let Some(parts) = of_module(graph, &attributes) {
        return Some(parts);
    }
    let pairs = object.pairs.iter().map(|(key, value)| (self::key(graph, *key), *value));
    let attributes = attributes.into_iter().map(|(name, value)| (Key::Attribute(name), value));
    Some(pairs.chain(positions(&object.items)).chain(attributes).collect())
}

/// The attributes of an object: a dictionary, or a tuple of such.
fn attributes<'g>(graph: &'g Graph<'_>, object: &Object<'_>) -> Option<Vec<(&'g str, Id)>> {
    let mut found = None;
    let mut add = |id: Id| {
        if let Value::Dict(pairs) = graph.get(id) {
            let named = pairs.iter().filter_map(|(key, value)| Some((text(graph, *key)?, *value)));
            found.get_or_insert_with(Vec::new).extend(named);
        }
    };
    for state in &object.states {
        match graph.get(*state) {
            // a state and the slots
            Value::Tuple(parts) if parts.len() == 2 => parts.iter().copied().for_each(&mut add),
            _ => add(*state),
        }
    }
    found
}

/// Of a PyTorch module, what its `state_dict()` would have.
fn of_module<'g>(graph: &'g Graph<'_>, attributes: &[(&'g str, Id)]) -> Option<Vec<(Key<'g>, Id)>> {
    let attribute = |name: &str| attributes.iter().rev().find(|(key, _)| *key == name).map(|(_, value)| *value);
    let pairs = |name: &str| match graph.get(attribute(name)?) {
        Value::Dict(pairs) => Some(&pairs[..]),
        _ => None,
    };
    let (parameters, modules) = (pairs("_parameters")?, pairs("_modules")?);
    let passing = match attribute("_non_persistent_buffers_set").map(|id| graph.get(id)) {
        Some(Value::Set(names) | Value::List(names) | Value::Tuple(names)) => &names[..],
        _ => &[],
    };
    let passing: std::collections::HashSet<&str> = passing.iter().filter_map(|name| text(graph, *name)).collect();
    let lasting = |key: Id| text(graph, key).is_none_or(|name| !passing.contains(name));
    let buffers = pairs("_buffers").unwrap_or_default().iter().filter(|(key, _)| lasting(*key));
    let all = parameters.iter().chain(buffers).chain(modules);
    let given = all.filter(|(_, value)| !matches!(graph.get(*value), Value::None));
    let part = |key: Id| text(graph, key).map_or_else(|| self::key(graph, key), Key::Attribute);
    Some(given.map(|(key, value)| (part(*key), *value)).collect())
}

fn text<'g>(graph: &'g Graph<'_>, id: Id) -> Option<&'g str> {
    match graph.get(id) {
        Value::Str(text) => Some(text),
        Value::Escaped(text) => Some(text),
        _ => None,
    }
}

fn key<'g>(graph: &'g Graph<'_>, id: Id) -> Key<'g> {
    match text(graph, id) {
        Some(text) => Key::Text(text),
        None => {
            let mut notation = String::new();
            write(graph, id, &mut notation, 0);
            Key::Other(notation)
        }
    }
}

/// The longest notation of a key. Longer ones are cut; if two become the same, they are refused like all such.
const LONGEST_KEY: usize = 200;

/// Writes a key in Python's notation.
fn write(graph: &Graph<'_>, id: Id, to: &mut String, depth: usize) {
    if to.len() > LONGEST_KEY || depth > 4 {
        return to.push('…');
    }
    match graph.get(id) {
        Value::None => to.push_str("None"),
        Value::Bool(true) => to.push_str("True"),
        Value::Bool(false) => to.push_str("False"),
        Value::Int(value) => to.push_str(&value.to_string()),
        Value::Digits(digits) => to.extend(digits.chars().take(LONGEST_KEY)),
        Value::Float(value) => to.push_str(&format!("{value:?}")),
        Value::Str(text) => to.extend(format!("{text:?}").chars().take(LONGEST_KEY)),
        Value::Escaped(text) => to.extend(format!("{text:?}").chars().take(LONGEST_KEY)),
        Value::Tuple(items) => {
            to.push('(');
            for (i, item) in items.iter().enumerate().take(LONGEST_KEY) {
                to.push_str(if i > 0 { ", " } else { "" });
                write(graph, *item, to, depth + 1);
            }
            to.push_str(if items.len() == 1 { ",)" } else { ")" });
        }
        Value::Global(global) => to.push_str(&global.full_name()),
        other => to.push_str(&format!("<{}>", other.describe())),
    }
}
