//! The container before PyTorch 1.6: five pickles, then the storages one after the other.
//!
//! A magic number, the version 1001, a dict with `little_endian`, the values, the keys of the storages in their order; then
//! for each key a count of elements (`i64`) and the raw numbers.

use std::collections::HashMap;
use std::ops::Range;

use super::machine::run;
use super::tree;
use super::value::{Graph, Storage, Value};
use crate::io::archive::Contents;
use crate::{Error, ErrorKind, Result};

/// 0x1950a86a20f9469cfc6c, as a pickle writes it.
const MAGIC: [u8; 10] = [0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];

/// Lists the checkpoint.
pub(in crate::io) fn in_stream(bytes: &[u8], keys: &[&str]) -> Result<Contents> {
    let mut at = 0;
    let mut next = |what: &str| {
        let (graph, len) = run(&bytes[at..]).map_err(|e| e.within(format!("{what}, from byte {at} of the file")))?;
        at += len;
        Ok::<_, Error>(graph)
    };
    let wrong = |what: &str| {
        Error::new(ErrorKind::Input, "not a PyTorch checkpoint")
            .found(what)
            .wanted("a file written by torch.save, or safetensors")
            .fix("a plain pickle can hold anything; save its tensors with torch.save or safetensors")
    };
    if !matches!(top(&next("the magic number")?), Value::Big(magic) if **magic == MAGIC) {
        return Err(wrong("a pickle without PyTorch's magic number"));
    }
    if !matches!(top(&next("the version")?), Value::Int(1001)) {
        return Err(wrong("another version than 1001 of the old container"));
    }
    let about = next("the description of the machine")?;
    if !is_little_endian(&about) {
        return Err(wrong("numbers that are not little-endian"));
    }
    let graph = next("the values")?;
    let order = next("the list of storages")?;
    let places = places(bytes, at, &graph, &order)?;
    tree::list(&graph, keys, &|storage| {
        let missing = || Error::new(ErrorKind::Input, "a storage is missing").at(storage.key);
        let place = places.get(storage.key).cloned().ok_or_else(missing)?;
        storage.check_len(place.len()).map_err(|e| e.at(storage.key))?;
        Ok(place)
    })
}

fn top<'g, 'a>(graph: &'g Graph<'a>) -> &'g Value<'a> {
    graph.get(graph.top)
}

fn is_little_endian(about: &Graph<'_>) -> bool {
    let Value::Dict(pairs) = top(about) else { return false };
    let is_key = |id| matches!(about.get(id), Value::Str("little_endian"));
    pairs.iter().any(|(key, value)| is_key(*key) && matches!(about.get(*value), Value::Bool(true)))
}

/// The bytes of each storage by key.
fn places<'a>(
    bytes: &[u8],
    mut at: usize,
    graph: &Graph<'a>,
    order: &Graph<'a>,
) -> Result<HashMap<&'a str, Range<usize>>> {
    let damaged =
        |found: String| Error::new(ErrorKind::Input, "the storages of the checkpoint are damaged").found(found);
    let Value::List(keys) = top(order) else {
        return Err(damaged("no list of storages".to_owned()));
    };
    let known: HashMap<&str, &Storage<'_>> = graph
        .values
        .iter()
        .filter_map(|value| match value {
            Value::Storage(storage) => Some((storage.key, &**storage)),
            _ => None,
        })
        .collect();
    let mut places = HashMap::new();
    for key in keys {
        let Value::Str(key) = order.get(*key) else {
            return Err(damaged("a key that is no text".to_owned()));
        };
        let size = known.get(key).and_then(|storage| storage.kind.size());
        let size = size.ok_or_else(|| damaged("a storage of unknown type".to_owned()).at(key))?;
        let count = bytes.get(at..).and_then(|rest| rest.first_chunk()).map(|b| i64::from_le_bytes(*b));
        let start = at + 8;
        let len = count.and_then(|count| usize::try_from(count).ok()).and_then(|count| count.checked_mul(size));
        let end = len.and_then(|len| start.checked_add(len)).filter(|end| *end <= bytes.len());
        let Some(end) = end else {
            let found = format!("{count:?} elements of {size} bytes from byte {start}, in a file of {}", bytes.len());
            return Err(damaged(found).at(key).fix("copy or download the file again: it may be cut short"));
        };
        if places.insert(*key, start..end).is_some() {
            return Err(damaged("two storages of one key".to_owned()).at(key));
        }
        at = end;
    }
    Ok(places)
}
