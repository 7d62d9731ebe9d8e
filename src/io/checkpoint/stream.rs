//! The container before PyTorch 1.6: five pickles, then the storages one after the other.
//!
//! A magic number, the version 1001, a dict with `little_endian`, the values, the keys of the storages in their order; then
//! for each key a count of elements (`i64`) and the raw numbers.

use std::collections::HashMap;
use std::ops::Range;

use super::machine::{LARGEST_PICKLE, run};
use super::tree;
use super::value::{Graph, Storage, Value};
use crate::io::archive::Contents;
use crate::io::source::Source;
use crate::{Error, ErrorKind, Result};

/// 0x1950a86a20f9469cfc6c, as a pickle writes it.
const MAGIC: [u8; 10] = [0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];
/// The same in digits, as the text protocols write it.
const MAGIC_DIGITS: &str = "119547037146038801333356";
/// The pickles at the start of a file \[bytes\].
const LARGEST_HEAD: usize = 5 * LARGEST_PICKLE;

/// As much of a file as tells whether it is of this kind.
pub(in crate::io) const LONGEST_START: usize = 32;

/// Whether a file with this start is a pickle, or five of them.
pub(in crate::io) fn is_stream(start: &[u8]) -> bool {
    let digits = start.strip_prefix(b"L").is_some_and(|start| start.starts_with(MAGIC_DIGITS.as_bytes()));
    // eight bytes of a safetensors file are the length of its header, whose lowest may be anything
    let header = matches!(start, [_, _, _, _, 0, 0, 0, 0, b'{', ..]);
    digits || (matches!(start, [0x80, 0..=5, ..]) && !header)
}

/// Lists the checkpoint.
pub(in crate::io) fn in_stream(source: &Source, keys: &[&str]) -> Result<Contents> {
    let bytes = source.head(LARGEST_HEAD)?;
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
    let is_magic = match *top(&next("the magic number")?) {
        Value::Big(magic) => *magic == MAGIC,
        Value::Digits(magic) => magic == MAGIC_DIGITS,
        _ => false,
    };
    if !is_magic {
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
    let (places, unknown) = places(source, at, &graph, &order)?;
    tree::list(&graph, keys, &|storage| {
        let missing = || {
            let missing = Error::new(ErrorKind::Input, "a storage is missing").at(storage.key);
            unknown.clone().unwrap_or(missing)
        };
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

/// Where storages are, by key, and why those behind a certain one cannot be found.
type Places<'a> = (HashMap<&'a str, Range<usize>>, Option<Error>);

/// The bytes of each storage by key.
fn places<'a>(source: &Source, mut at: usize, graph: &Graph<'a>, order: &Graph<'a>) -> Result<Places<'a>> {
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
        let Some(storage) = known.get(key) else {
            return Err(damaged("a storage of which the values know nothing".to_owned()).at(key));
        };
        let Some(size) = storage.kind.size() else {
            let unknown = Error::new(ErrorKind::Unsupported, "storages behind one of unknown size are not found")
                .at(key)
                .found(storage.kind.name())
                .wanted("storages of bool, integers, floats or complex numbers")
                .fix("leave that tensor out, or save the file with PyTorch 1.6 or later, without its old container");
            return Ok((places, Some(unknown)));
        };
        let count = source.get(at..at.saturating_add(8))?;
        let count = count.and_then(|count| count.first_chunk().map(|b| i64::from_le_bytes(*b)));
        let start = at + 8;
        let len = count.and_then(|count| usize::try_from(count).ok()).and_then(|count| count.checked_mul(size));
        let end = len.and_then(|len| start.checked_add(len)).filter(|end| *end <= source.len());
        let Some(end) = end else {
            let found = format!("{count:?} elements of {size} bytes from byte {start}, in a file of {}", source.len());
            return Err(damaged(found).at(key).fix("copy or download the file again: it may be cut short"));
        };
        if places.insert(*key, start..end).is_some() {
            return Err(damaged("two storages of one key".to_owned()).at(key));
        }
        at = end;
    }
    Ok((places, None))
}
