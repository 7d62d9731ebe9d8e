//! NumPy's archive of arrays: a ZIP archive with one `.npy` per name.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::io::archive::Contents;
use crate::io::npy;
use crate::io::source::Source;
use crate::{Error, ErrorKind, Result};

/// Lists the arrays.
pub(super) fn list(source: &Source, directory: BTreeMap<String, Range<usize>>) -> Result<Contents> {
    let mut contents = Contents::default();
    for (file, range) in directory {
        let Some(name) = file.strip_suffix(".npy") else {
            return Err(Error::new(ErrorKind::Input, "the archive holds something other than arrays or a checkpoint")
                .at(&file)
                .wanted("the .npy files of numpy.savez, or the data.pkl of torch.save")
                .fix("unpack the archive, and give the path of a file of weights in it"));
        };
        let entry = npy::entry(source, range).map_err(|e| e.within(name));
        contents.entries.insert(name.to_owned(), entry);
    }
    Ok(contents)
}
