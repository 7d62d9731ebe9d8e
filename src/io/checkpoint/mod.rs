//! PyTorch checkpoints (`.ckpt`, `.pt`, `.pth`), read without executing anything.
//!
//! A checkpoint is a *pickle*, a program for a small stack machine that may call any Python function, with the numbers of its
//! tensors beside it. The machine here knows the opcodes of protocols 0 to 5 and calls **nothing**: the handful of calls
//! that make up a tensor (`torch._utils._rebuild_tensor_v2` and its kin, `collections.OrderedDict`, `torch.Size`) are read as
//! descriptions, and every other call leaves an opaque value that remembers the name of what was to be called, and what it was
//! to be filled with. Of a module (`torch.save(model)`), the tensors of its `state_dict()` are listed; of other objects, those
//! among their attributes. Asking for a tensor that turns out to be opaque is an error that says so; opaque values elsewhere
//! (hyper-parameters, callbacks) do no harm.
//!
//! Both containers are read: the ZIP archive of PyTorch 1.6 and later, whose entries are stored uncompressed and read in
//! place, and the stream of pickles of earlier versions. The tensors of `top["state_dict"]` are listed if the top value has
//! that key, else all tensors of the top value, by dotted path. Where two values would have one path, asking for it is an
//! error that names both. Storages may be shared; views may be strided, and have PyTorch's negative bit.
//!
//! What a file claims is checked before it is believed: that every storage is as long as its entry, that every view lies
//! within its storage, that entries do not overlap, how deep values nest, how much the pickle builds.

mod children;
mod machine;
mod persistent;
mod rebuild;
mod stream;
mod text;
mod tree;
mod value;

use std::collections::BTreeMap;
use std::ops::Range;

use crate::io::archive::Contents;
use crate::io::source::Source;
use crate::{Error, ErrorKind, Result};

use machine::{LARGEST_PICKLE, run};
use value::Storage;

pub(super) use stream::{LONGEST_START, in_stream, is_stream};

/// Lists the checkpoint in a ZIP archive, if there is one.
pub(super) fn in_zip(
    source: &Source,
    directory: &BTreeMap<String, Range<usize>>,
    keys: &[&str],
) -> Result<Option<Contents>> {
    let mut tops = directory.keys().filter_map(|name| name.strip_suffix("data.pkl"));
    let mut tops = tops.by_ref().filter(|top| top.find('/').is_none_or(|slash| slash + 1 == top.len()));
    let Some(top) = tops.next() else { return Ok(None) };
    if let Some(second) = tops.next() {
        return Err(Error::new(ErrorKind::Input, "the archive holds two checkpoints")
            .found(format!("{top}data.pkl and {second}data.pkl")));
    }
    let of = |name: &str| directory.get(&format!("{top}{name}")).cloned();
    if let Some(order) = of("byteorder")
        && let order = source.read(order.start..order.end.min(order.start + 16))?
        && order.trim_ascii() != b"little"
    {
        let found = String::from_utf8_lossy(&order).into_owned();
        return Err(Error::new(ErrorKind::Unsupported, "the checkpoint is not little-endian")
            .at(format!("{top}byteorder"))
            .found(format!("{found:?}")));
    }
    let pickle = of("data.pkl").expect("the entry by which the top was found");
    let pickle = source.read(pickle.start..pickle.end.min(pickle.start.saturating_add(LARGEST_PICKLE)))?;
    let (graph, _) = run(&pickle).map_err(|e| e.within(format!("{top}data.pkl")))?;
    let locate = |storage: &Storage<'_>| {
        let name = format!("data/{}", storage.key);
        let missing = || Error::new(ErrorKind::Input, "a storage is missing").at(format!("{top}{name}"));
        let place = of(&name).ok_or_else(missing)?;
        storage.check_len(place.len()).map_err(|e| e.at(format!("{top}{name}")))?;
        Ok(place)
    };
    tree::list(&graph, keys, &locate).map(Some)
}
